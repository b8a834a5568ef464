"""Whoever flies in a mode keeps the vehicle: also in modes that came to PX4 later, and in those that nobody knows."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.autopilot.port import CommandRefusedError
from daemon.autopilot.px4 import set_mode
from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import Link, PilotTakesOver

POSITION = 3 << 16
POSITION_SLOW, ALTITUDE_CRUISE, RATTITUDE = 3 << 16 | 2 << 24, 11 << 16, 8 << 16  # px4_custom_mode.h
NOBODY_KNOWS = 42 << 16


def show(flight: Flight, shown: int, instead_of: int | None = None) -> None:
    """From now on the autopilot's messages have this ``custom_mode``, everywhere or where it was another."""
    take = flight.px4.take_outgoing

    def taken() -> list[tuple[str, dict[str, object]]]:
        return [
            (
                name,
                {
                    key: shown if key.endswith("custom_mode") and instead_of in (None, value) else value
                    for key, value in fields.items()
                },
            )
            for name, fields in take()
        ]

    flight.px4.take_outgoing = taken  # type: ignore[method-assign]


@pytest.mark.parametrize("request_of", [Commander.hold, Commander.land, Commander.return_home])
@pytest.mark.parametrize("word", [POSITION, POSITION_SLOW, ALTITUDE_CRUISE, RATTITUDE, NOBODY_KNOWS])
def test_no_request_takes_the_vehicle_from_whoever_flies_it(
    word: int, request_of: Callable[[Commander], Awaitable[None]]
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        show(flight, word, instead_of=POSITION)
        flight.px4.inject(PilotTakesOver(mode="position"))
        await flight.until(lambda: flight.state is State.PILOT)
        asked = len(flight.asked)
        with pytest.raises(NotPossibleError, match="a pilot flies in mode"):
            await request_of(flight.vehicle.commander)
        await asyncio.sleep(1.0)
        assert (flight.px4.mode, flight.state, flight.asked[asked:]) == (FlightMode.POSITION, State.PILOT, [])

    fly(scenario)


def test_what_a_pilot_gives_back_in_hold_is_taken_when_asked_for() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        flight.px4.inject(PilotTakesOver(mode="position_slow"))
        await flight.until(lambda: flight.state is State.PILOT)
        assert flight.autopilot.status.value.mode is FlightMode.POSITION_SLOW
        flight.px4.inject(PilotTakesOver(mode="hold"))
        await flight.until(lambda: flight.autopilot.status.value.mode is FlightMode.HOLD)
        await flight.vehicle.commander.engage()
        assert flight.state is State.HOLDING

    fly(scenario)


def test_an_unknown_mode_on_the_ground_is_nobodys_and_the_take_off_goes_through_hold() -> None:
    async def scenario(flight: Flight) -> None:
        show(flight, NOBODY_KNOWS)
        await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
        assert flight.autopilot.status.value.mode is FlightMode.UNKNOWN
        takeoff = asyncio.ensure_future(flight.vehicle.commander.takeoff(5.0))
        await flight.until(lambda: FlightMode.HOLD in [mode for _, mode in flight.asked])
        del flight.px4.take_outgoing  # type: ignore[attr-defined]
        await takeoff
        assert flight.state is State.READY

    fly(scenario)


def lose_a_request(flight: Flight, number: int, first_parameter: float) -> None:
    """The first command of this kind never arrives."""
    receive, lost = flight.px4.receive, []

    def heard(name: str, fields: dict[str, Any], **sender: Any) -> None:
        if not lost and fields.get("command") == number and fields.get("param1") == first_parameter:
            lost.append(flight.now_s)
            return
        receive(name, fields, **sender)

    flight.px4.receive = heard  # type: ignore[method-assign]


def test_a_switch_is_seen_at_once_though_the_request_for_the_mode_was_lost() -> None:
    """PX4 sends CURRENT_MODE every 2 s by itself, and HEARTBEAT every 1 s."""

    async def scenario(flight: Flight) -> None:
        lose_a_request(flight, number=511, first_parameter=436)
        await flight.airborne()
        await asyncio.sleep(2.0)
        since_s = flight.now_s
        flight.px4.inject(PilotTakesOver(mode="position"))
        await flight.until(lambda: flight.state is State.PILOT)
        assert flight.now_s - since_s < 0.1
        assert max(time_s for time_s, _ in flight.sent) - since_s < 0.1

    fly(scenario)


def test_hold_is_seen_and_not_followed_by_a_landing_though_the_request_for_the_mode_was_lost() -> None:
    async def scenario(flight: Flight) -> None:
        lose_a_request(flight, number=511, first_parameter=436)
        await flight.airborne()
        await asyncio.sleep(2.0)
        asked = len(flight.asked)
        await flight.vehicle.commander.hold()
        assert {mode for _, mode in flight.asked[asked:]} == {FlightMode.HOLD}
        assert flight.state is State.READY

    fly(scenario)


@pytest.mark.parametrize("short_s", [0.02, 0.04])
def test_a_return_that_a_pilot_chooses_as_the_daemon_takes_the_vehicle_is_flown(short_s: float) -> None:
    """PX4 takes Return, and then the OFFBOARD that was on its way."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(direction="up", delay_s=0.05))
        engage = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: any(mode is FlightMode.OFFBOARD for _, mode in flight.asked))
        await asyncio.sleep(0.05 - short_s)
        flight.px4.pilot_switches_to(FlightMode.RETURN)
        seen = set()
        for _ in range(200):
            seen.add(flight.px4.mode)
            await asyncio.sleep(0.004)
        await asyncio.gather(engage, return_exceptions=True)
        assert FlightMode.OFFBOARD in seen, "it did come over the pilot's mode"
        assert (flight.px4.mode, flight.state) == (FlightMode.RETURN, State.PILOT)

    fly(scenario)


@pytest.mark.parametrize("lasts_ms", [12, 16, 24, 32, 40])
def test_a_mode_that_another_one_replaces_soon_is_told_all_the_same(lasts_ms: int) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        told: list[FlightMode] = []
        flight.vehicle.control.listeners.append(lambda inputs, _record: told.append(inputs.status.mode))
        await asyncio.sleep(0.5)
        flight.px4.receive(*set_mode(FlightMode.RETURN, armed=True), sender_system=255)
        await asyncio.sleep(1e-3 * lasts_ms)
        flight.px4.receive(*set_mode(FlightMode.LAND, armed=True), sender_system=255)
        await flight.until(lambda: told[-1] is FlightMode.LAND, 0.03)
        assert FlightMode.RETURN in told

    fly(scenario)


def test_a_hold_that_gets_lost_while_a_pilot_takes_the_vehicle_is_answered_soon_and_in_words() -> None:
    async def scenario(flight: Flight) -> float:
        await flight.airborne()
        flight.px4.inject(Link(direction="up", silent=True, duration_s=0.4))
        hold = asyncio.ensure_future(flight.vehicle.commander.hold())
        since_s = flight.now_s
        await asyncio.sleep(0.1)
        flight.px4.inject(PilotTakesOver(mode="position"))
        with pytest.raises(CommandRefusedError, match="a pilot chose position meanwhile"):
            await hold
        assert flight.state is State.PILOT
        return flight.now_s - since_s

    assert fly(scenario) < 0.8
