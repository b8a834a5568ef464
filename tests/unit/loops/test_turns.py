"""A vehicle request that waits: for how long, and what ends it early."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest
from support.commander_rig import AIR, GROUND, TIMEOUTS, Vehicle, answers, play

from daemon.autopilot.port import Command, CommandRefusedError, CommandTimeoutError
from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import AutopilotStatus, FlightMode, LandedState, RequestKind
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
