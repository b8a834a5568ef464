"""Taking the vehicle: what hinders it, when it is done, and what ends it elsewhere."""

import asyncio
from dataclasses import replace
from typing import Any

import pytest
from support.commander_rig import AIR, Vehicle, answers, play, refused

from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError
from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState, ModeRefusal, RequestKind, SystemStatus
from daemon.safety.supervisor import State


def test_an_engage_that_the_autopilot_refuses_says_why() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def engage() -> None:
            refusal = ModeRefusal(FlightMode.OFFBOARD, "no offboard signal", 0.1)
            vehicle.set(State.ENGAGING, mode_refusal=refusal)
            vehicle.later(0.5, State.READY, "engage_refused")

        answers(vehicle, {RequestKind.ENGAGE: engage})
        with pytest.raises(CommandRefusedError, match=r"did not go to offboard within 2 s \(no offboard signal\)"):
            await vehicle.commander.engage()

    play(scenario, AIR, State.READY)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"armed": False}, "the vehicle is not armed"),
        ({"landed": LandedState.LANDING}, "landed state is landing"),
        ({"mode": FlightMode.RETURN, "intended_mode": FlightMode.RETURN}, "the mode is return, not hold"),
        ({"intended_mode": FlightMode.OFFBOARD}, "the autopilot intends offboard: a failsafe acts"),
        ({"system_status": SystemStatus.CRITICAL}, "system status is critical"),
    ],
)
def test_engaging_names_what_is_missing(change: dict[str, Any], words: str) -> None:
    refused(f"cannot engage: .*{words}", replace(AIR, **change), State.READY, Commander.engage)


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        ({"state_usable": False}, "there is no fresh estimate"),
        ({"estimate_poor": True}, "estimate is too uncertain"),
        ({"attitude_disagrees": True}, "attitude and its accelerometer disagree"),
    ],
)
def test_engaging_needs_an_estimate(conditions: dict[str, bool], words: str) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.see(**conditions)
        with pytest.raises(NotPossibleError, match=words):
            await vehicle.commander.engage()
        assert vehicle.asked == []

    play(scenario, AIR, State.READY)


def test_a_daemon_that_stops_engages_no_more() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.commander.stop()
        with pytest.raises(NotPossibleError, match="the daemon is stopping"):
            await vehicle.commander.engage()

    play(scenario, AIR, State.READY)


def test_an_engage_goes_on_when_the_autopilot_is_heard_again_within_a_second() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.ENGAGE: lambda: vehicle.set(State.HOLDING, mode=FlightMode.OFFBOARD)})
        vehicle.later(0.5, State.READY, heard=True)
        await vehicle.commander.engage()

    assert play(scenario, replace(AIR, heard=False), State.READY) == pytest.approx(0.5, abs=0.1)


def test_engaging_opens_the_gate_and_is_done_when_the_vehicle_is_ours() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        def engage() -> None:
            vehicle.set(State.ENGAGING)
            vehicle.later(0.4, State.HOLDING, mode=FlightMode.OFFBOARD)

        vehicle.gate.latch()
        answers(vehicle, {RequestKind.ENGAGE: engage})
        await vehicle.commander.engage()
        assert not vehicle.gate.latched
        await vehicle.commander.engage()
        assert vehicle.asked == [RequestKind.ENGAGE]

    assert play(scenario, AIR, State.READY) == pytest.approx(0.4, abs=0.1)


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
