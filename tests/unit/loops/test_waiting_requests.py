"""A vehicle request that waits: for how long, what it lets end first, and what ends it early."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest
from support.commander_rig import AIR, GROUND, TIMEOUTS, Vehicle, answers, play

from daemon.autopilot.port import Command, CommandRefusedError, CommandTimeoutError
from daemon.loops.commander import Commander, NotPossibleError
from daemon.messages import AutopilotStatus, FlightMode, LandedState, ModeRefusal, RequestKind
from daemon.safety.supervisor import State


@pytest.mark.parametrize(
    ("ask", "status", "state", "limit_s", "words"),
    [
        (Commander.arm, GROUND, State.STANDBY, TIMEOUTS.arm_s, "not armed after 3 s; it may still come"),
        (Commander.disarm, replace(GROUND, armed=True), State.STANDBY, TIMEOUTS.arm_s, "not disarmed after 3 s"),
        (lambda c: c.takeoff(5.0), replace(GROUND, armed=True), State.STANDBY, TIMEOUTS.mode_s, "not taking off"),
        (Commander.engage, AIR, State.ENGAGING, TIMEOUTS.engage_s, "not engaged after 3 s"),
        (
            Commander.hold,
            replace(AIR, mode=FlightMode.MISSION),
            State.READY,
            TIMEOUTS.mode_s,
            "not in mode hold after 2.5 s",
        ),
        (Commander.hold, AIR, State.RELEASING, TIMEOUTS.mode_s, "not released after 2.5 s"),
        (Commander.hold, AIR, State.TAKING_OFF, TIMEOUTS.mode_s, "not in Hold after 2.5 s"),
        (Commander.land, AIR, State.READY, TIMEOUTS.mode_s, "not in mode land after 2.5 s"),
        (
            Commander.land,
            replace(AIR, mode=FlightMode.LAND),
            State.LANDING,
            TIMEOUTS.land_s + 10.0 / TIMEOUTS.descend_m_s,
            "not landed and disarmed",
        ),
        (
            lambda c: c.takeoff(10.0),
            replace(GROUND, armed=True),
            State.TAKING_OFF,
            TIMEOUTS.takeoff_s + 10.0 / TIMEOUTS.climb_m_s,
            "not in the air",
        ),
    ],
)
def test_every_wait_is_bounded(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, limit_s: float, words: str
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        if state is State.TAKING_OFF and status.landed is LandedState.ON_GROUND:  # it begins on the ground
            vehicle.set(State.STANDBY)
            vehicle.script = lambda _asked: vehicle.set(State.TAKING_OFF)
        with pytest.raises(CommandTimeoutError, match=words):
            await ask(vehicle.commander)

    assert play(scenario, status, state) == pytest.approx(limit_s, abs=0.1)


def test_an_engage_waits_half_a_second_for_the_supervisor_to_read_it() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.reads = False
        with pytest.raises(CommandTimeoutError, match=r"not engaging after 0\.5 s"):
            await vehicle.commander.engage()

    assert play(scenario, AIR, State.READY) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ((State.READY, "released", {}), "engage ended in state ready"),
        ((State.PILOT, "pilot_override", {"mode": FlightMode.ACRO}), "the mode is acro, not hold"),
        ((State.DISCONNECTED, "link_lost", {"connected": False}), "no autopilot is connected"),
    ],
)
def test_an_engage_that_is_over_between_two_looks_is_answered_at_once_and_does_not_come_any_more(
    after: tuple[State, str, dict[str, Any]], words: str
) -> None:
    state, reason, status = after

    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.ENGAGE: lambda: vehicle.set(state, reason, **status)})
        with pytest.raises((NotPossibleError, CommandRefusedError), match=words):
            await vehicle.commander.engage()

    assert play(scenario, AIR, State.READY) < 0.1


def test_a_newer_request_ends_a_pending_one() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.5)
        answers(vehicle, {RequestKind.HOLD: lambda: vehicle.later(0.1, State.READY, mode=FlightMode.HOLD)})
        await vehicle.commander.hold()
        with pytest.raises(NotPossibleError, match="superseded by a newer vehicle request"):
            await landing
        assert vehicle.asked == [RequestKind.LAND, RequestKind.HOLD]

    assert play(scenario, replace(AIR, mode=FlightMode.MISSION), State.READY) < 1.0


def test_a_request_that_is_refused_at_once_ends_none() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.LAND: lambda: vehicle.later(1.0, State.LANDING, mode=FlightMode.LAND)})
        landing = asyncio.ensure_future(vehicle.commander.land())
        await asyncio.sleep(0.5)
        for ask in (vehicle.commander.disarm(), vehicle.commander.takeoff(5.0)):
            with pytest.raises(NotPossibleError):
                await ask
        vehicle.later(2.0, State.STANDBY, armed=False)
        await landing

    play(scenario, AIR, State.READY)


def test_an_acknowledgement_that_comes_after_a_newer_request_does_not_count() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        async def slowly(_command: Command, _timeout_s: float) -> None:
            await asyncio.sleep(1.0)
            raise CommandRefusedError("no")

        vehicle.command = slowly  # type: ignore[method-assign]
        arming = asyncio.ensure_future(vehicle.commander.arm())
        await asyncio.sleep(0.5)
        newer = asyncio.ensure_future(vehicle.commander.arm())
        with pytest.raises(NotPossibleError, match="superseded"):
            await arming
        with pytest.raises(CommandRefusedError, match="no"):
            await newer

    play(scenario)


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


def test_an_engage_for_a_goal_ends_with_the_goal() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        wanted = [True]
        vehicle.commander.ask_engage()
        assert vehicle.withdrawn == 1, "no command may come after it"
        engage = asyncio.ensure_future(vehicle.commander.engaged(lambda: wanted[0]))
        answers(vehicle, {RequestKind.ENGAGE: lambda: vehicle.set(State.ENGAGING)})
        await asyncio.sleep(0.3)
        wanted[0] = False
        with pytest.raises(NotPossibleError, match="superseded"):
            await engage

    assert play(scenario, AIR, State.READY) < 0.5
