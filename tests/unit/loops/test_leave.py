"""Holding and coming down: what is let end first, when each is done, and what ends it elsewhere."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest
from support.commander_rig import AIR, TIMEOUTS, Vehicle, answers, play

from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError
from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState, ModeRefusal, RequestKind
from daemon.safety.supervisor import State


def test_a_failsafe_that_has_the_vehicle_is_not_called_a_pilot() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.see(failsafe=True)
        with pytest.raises(NotPossibleError, match="cannot hold: a failsafe of the autopilot acts, in mode position"):
            await vehicle.commander.hold()

    play(scenario, replace(AIR, mode=FlightMode.POSITION, intended_mode=FlightMode.OFFBOARD), State.FAULT)


def test_a_mode_that_the_autopilot_refuses_is_told_in_its_words() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def no() -> None:
            now_s = asyncio.get_running_loop().time()
            vehicle.set(State.READY, mode_refusal=ModeRefusal(FlightMode.LAND, "no position", now_s))

        answers(vehicle, {RequestKind.LAND: no})
        with pytest.raises(CommandRefusedError, match="the autopilot refused land: no position"):
            await vehicle.commander.land()

    assert play(scenario, AIR, State.READY) < 0.2


def test_a_refusal_from_before_the_request_is_not_held_against_it() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        await asyncio.sleep(1.0)
        vehicle.set(State.READY, mode_refusal=ModeRefusal(FlightMode.LAND, "no position", 0.5))
        with pytest.raises(CommandTimeoutError):
            await vehicle.commander.land()

    play(scenario, AIR, State.READY)


LEAVING = (Commander.hold, Commander.land, Commander.return_home)


@pytest.mark.parametrize("ask", LEAVING)
def test_who_wants_the_vehicle_down_waits_until_it_is_known_who_has_it(
    ask: Callable[[Commander], Awaitable[None]],
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.later(0.3, State.READY, heard=True, mode=FlightMode.POSITION)
        with pytest.raises(NotPossibleError, match="a pilot flies in mode position"):
            await ask(vehicle.commander)
        assert vehicle.asked == []

    assert play(scenario, replace(AIR, heard=False), State.READY) == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("ask", LEAVING)
def test_and_is_told_when_nothing_shows_it(ask: Callable[[Commander], Awaitable[None]]) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        with pytest.raises(NotPossibleError, match="nothing shows what the autopilot does now"):
            await ask(vehicle.commander)
        assert (vehicle.asked, vehicle.commander.releases) == ([], 0)

    assert play(scenario, replace(AIR, heard=False), State.READY) == pytest.approx(TIMEOUTS.mode_s, abs=0.1)


def test_a_vehicle_that_is_ours_is_given_away_whether_the_autopilot_is_heard_or_not() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.HOLD: lambda: vehicle.set(State.READY, mode=FlightMode.HOLD)})
        await vehicle.commander.hold()

    assert play(scenario, replace(AIR, heard=False, mode=FlightMode.OFFBOARD), State.HOLDING) < 0.1


def test_hold_is_done_when_the_supervisor_has_let_go() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def hold() -> None:
            vehicle.later(0.1, State.RELEASING, mode=FlightMode.HOLD)
            vehicle.later(0.2, State.READY)

        answers(vehicle, {RequestKind.HOLD: hold})
        await vehicle.commander.hold()
        assert vehicle.commander.state is State.READY

    assert play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.HOLDING) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    ("ask", "kind", "mode"),
    [
        (Commander.land, RequestKind.LAND, FlightMode.LAND),
        (Commander.return_home, RequestKind.RETURN, FlightMode.RETURN),
    ],
)
def test_coming_down_is_done_when_disarmed(
    ask: Callable[[Commander], Awaitable[None]], kind: RequestKind, mode: FlightMode
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def down() -> None:
            vehicle.later(0.1, State.LANDING, mode=mode)
            vehicle.later(30.0, State.LANDING, landed=LandedState.ON_GROUND)
            vehicle.later(32.0, State.STANDBY, armed=False)

        answers(vehicle, {kind: down})
        await ask(vehicle.commander)
        assert vehicle.commander.state is State.STANDBY

    assert play(scenario, AIR, State.READY) == pytest.approx(32.0, abs=0.1)


def test_a_landing_that_a_pilot_ends_says_so() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def down() -> None:
            vehicle.later(0.1, State.LANDING, mode=FlightMode.LAND)
            vehicle.later(3.0, State.PILOT, "pilot_override", mode=FlightMode.POSITION)

        answers(vehicle, {RequestKind.LAND: down})
        with pytest.raises(NotPossibleError, match="land ended in state pilot: somebody else changed the mode"):
            await vehicle.commander.land()

    assert play(scenario, AIR, State.READY) == pytest.approx(3.0, abs=0.1)


def test_a_landing_is_waited_for_over_a_standstill() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.LAND: lambda: vehicle.later(0.1, State.LANDING, mode=FlightMode.LAND)})
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.5)
        vehicle.commander.stood_still()
        vehicle.later(0.5, State.STANDBY, armed=False)
        await landing

    play(scenario, AIR, State.READY)


def test_a_release_under_way_is_let_end_before_another_mode_is_asked() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.later(0.4, State.READY, mode=FlightMode.HOLD)
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.3)
        assert vehicle.asked == []
        await asyncio.sleep(0.2)
        assert vehicle.asked == [RequestKind.LAND]
        landing.cancel()

    play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.RELEASING)


def test_a_pilot_who_takes_over_during_a_release_is_asked_for_no_other_mode() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.later(0.2, State.PILOT, "pilot_override", mode=FlightMode.POSITION)
        with pytest.raises(NotPossibleError, match="a pilot flies in mode position"):
            await vehicle.commander.land()
        await asyncio.sleep(0.1)
        assert vehicle.asked == []

    play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.RELEASING)


def test_a_hold_that_is_refused_at_first_may_still_come_while_the_vehicle_is_released() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def refuse() -> None:
            refusal = ModeRefusal(FlightMode.HOLD, "not now", asyncio.get_running_loop().time())
            vehicle.set(State.RELEASING, mode_refusal=refusal)
            vehicle.later(0.2, State.READY, mode=FlightMode.HOLD)

        answers(vehicle, {RequestKind.HOLD: refuse})
        await vehicle.commander.hold()

    play(scenario, replace(AIR, mode=FlightMode.OFFBOARD), State.HOLDING)
