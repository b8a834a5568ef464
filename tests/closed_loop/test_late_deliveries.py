"""What waits in the link and is delivered after the vehicle is not ours any more."""

import asyncio
from math import degrees
from typing import Any

import pytest
from support.flight import Flight, fly

from daemon import frames
from daemon.autopilot.px4 import set_mode
from daemon.goals.errors import ProtocolError
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import BatteryLow, Link, PilotTakesOver


class StalledUpLink:
    """The up-link takes everything and delivers nothing, until it delivers all of it in order."""

    def __init__(self, flight: Flight) -> None:
        self._receive = flight.px4.receive
        self._waiting: list[tuple[str, Any, dict[str, Any]]] = []
        self._px4 = flight.px4
        flight.px4.receive = self._hold_back  # type: ignore[method-assign]

    def _hold_back(self, name: str, fields: Any, **sender: Any) -> None:
        self._waiting.append((name, fields, sender))

    async def deliver(self) -> None:
        self._px4.receive = self._receive  # type: ignore[method-assign]
        for name, fields, sender in self._waiting:
            self._receive(name, fields, **sender)
            await asyncio.sleep(0.001)


async def _passes(flight: Flight, seconds: float) -> None:
    since_s = flight.now_s
    await flight.until(lambda: flight.now_s - since_s >= seconds)


@pytest.mark.parametrize("waits_s", [1.3, 2.5])
def test_setpoints_delivered_after_the_autopilots_failsafe_do_not_tumble_the_vehicle(waits_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0)
        await flight.goto(40.0, 0.0, -20.0)
        await _passes(flight, 2.5)
        link = StalledUpLink(flight)
        await _passes(flight, waits_s)
        assert (flight.px4.mode, flight.state) == (FlightMode.HOLD, State.FAULT)
        await link.deliver()
        tilt_rad, offboard_s = 0.0, 0.0
        for _ in range(300):
            tilt_rad = max(tilt_rad, frames.tilt_of(flight.px4.truth.attitude_wb))
            offboard_s += 0.01 * (flight.px4.mode is FlightMode.OFFBOARD)
            await asyncio.sleep(0.01)
        assert (flight.px4.mode, flight.state) == (FlightMode.HOLD, State.FAULT)
        assert degrees(tilt_rad) < 15.0
        assert offboard_s < 0.2

    fly(scenario, parameters={"COM_OBL_RC_ACT": 5})


@pytest.mark.parametrize("delay_s", [0.15, 0.3])
def test_a_battery_landing_goes_on_when_the_offboard_of_an_engage_comes_later(delay_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(direction="up", delay_s=delay_s))
        engage = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: any(mode is FlightMode.OFFBOARD for _, mode in flight.asked))
        flight.px4.inject(BatteryLow(fraction=0.04))
        await flight.until(lambda: flight.px4.mode is FlightMode.LAND)
        offboard_s = 0.0
        for _ in range(200):
            offboard_s += 0.01 * (flight.px4.mode is FlightMode.OFFBOARD)
            await asyncio.sleep(0.01)
        await asyncio.gather(engage, return_exceptions=True)
        assert flight.px4.mode is FlightMode.LAND
        assert 0.0 < offboard_s < delay_s + 0.1

    fly(scenario, parameters={"COM_LOW_BAT_ACT": 3, "COM_FAIL_ACT_T": 0.0})


@pytest.mark.parametrize(("delay_s", "direction"), [(0.16, "both"), (0.33, "up")])
def test_a_vehicle_that_was_to_hold_does_not_land_for_a_slow_link(delay_s: float, direction: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.goto(30.0, 0.0, -5.0)
        await _passes(flight, 2.0)
        flight.px4.inject(Link(direction=direction, delay_s=delay_s))
        hold = asyncio.ensure_future(flight.vehicle.commander.hold())
        await _passes(flight, 0.4)
        flight.px4.faults.clear()
        await hold
        await flight.until(lambda: flight.px4.mode is FlightMode.LAND, 1.0)
        await _passes(flight, 3.0)
        assert (flight.px4.mode, flight.state) == (FlightMode.HOLD, State.READY)
        assert flight.position[2] < -4.0

    fly(scenario)


@pytest.mark.parametrize("delay_s", [0.3, 0.75])
def test_a_vehicle_is_not_taken_over_a_link_that_takes_too_long_to_fly_by(delay_s: float) -> None:
    """It would sink by metres: the estimate's age does not show what even the quickest sample took."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0, engage=False)
        for direction in ("up", "down"):
            flight.px4.inject(Link(direction=direction, delay_s=delay_s))
        await _passes(flight, 12.0)
        with pytest.raises(NotPossibleError, match="too slow to fly by"):
            await flight.vehicle.commander.engage()
        with pytest.raises(ProtocolError, match="too slow to fly by"):
            await flight.goto(10.0, 0.0, -20.0)
        await _passes(flight, 3.0)
        assert (flight.px4.mode, flight.sent) == (FlightMode.HOLD, [])

    fly(scenario)


@pytest.mark.parametrize(("mode", "ends_in"), [("return", "return"), ("position", "hold")])
@pytest.mark.parametrize("late_s", [0.06, 0.2, 0.5, 0.95, 1.05, 1.5, 2.0])
def test_stale_setpoints_and_an_offboard_among_them_that_overtake_nobody_for_long(
    late_s: float, mode: str, ends_in: str
) -> None:
    """The link delivers half a second of a hard start again, behind a pilot's mode."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0)
        await flight.goto(40.0, 0.0, -20.0)
        await _passes(flight, 0.35)
        receive, stale = flight.px4.receive, list[tuple[str, Any]]()

        def noted(name: str, fields: Any, **sender: Any) -> None:
            if name == "SET_ATTITUDE_TARGET":
                stale.append((name, fields))
            receive(name, fields, **sender)

        flight.px4.receive = noted  # type: ignore[method-assign]
        await _passes(flight, 0.5)
        flight.px4.receive = receive  # type: ignore[method-assign]
        stale.insert(3, set_mode(FlightMode.OFFBOARD, armed=True))
        flight.px4.inject(PilotTakesOver(mode=mode))
        await _passes(flight, late_s)
        tilt_rad, offboard_s = 0.0, 0.0
        for tick in range(300):
            if tick < len(stale):
                receive(*stale[tick])
            tilt_rad = max(tilt_rad, frames.tilt_of(flight.px4.truth.attitude_wb))
            offboard_s += 0.01 * (flight.px4.mode is FlightMode.OFFBOARD)
            await asyncio.sleep(0.01)
        answered = late_s < 1.0
        assert flight.px4.mode is (FlightMode(ends_in) if answered else FlightMode.HOLD)
        assert 0.0 < offboard_s < (0.05 if answered else 1.6)
        assert degrees(tilt_rad) < 35.0

    fly(scenario, parameters={"COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3})
