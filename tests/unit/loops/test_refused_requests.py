"""A vehicle request that does not fit, or that the autopilot refuses, is refused in words."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest
from support.commander_rig import AIR, GROUND, TIMEOUTS, Vehicle, answers, play, refused

from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError
from daemon.loops.commander import Commander, NotPossibleError
from daemon.messages import AutopilotStatus, FlightMode, LandedState, ModeRefusal, RequestKind, SystemStatus
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


@pytest.mark.parametrize(
    ("ask", "status", "state", "words"),
    [
        (Commander.arm, replace(GROUND, connected=False), State.DISCONNECTED, "no autopilot is connected"),
        (Commander.disarm, replace(GROUND, connected=False), State.STANDBY, "no autopilot is connected"),
        (lambda c: c.takeoff(5.0), GROUND, State.DISCONNECTED, "no autopilot is connected"),
        (Commander.engage, replace(AIR, connected=False), State.READY, "no autopilot is connected"),
        (Commander.hold, replace(AIR, connected=False), State.READY, "no autopilot is connected"),
        (Commander.arm, GROUND, State.FAULT, "cannot arm in state fault"),
        (Commander.disarm, AIR, State.READY, "the vehicle is not landed; land it first"),
        (lambda c: c.takeoff(5.0), AIR, State.READY, "needs a vehicle on the ground; the state is ready"),
        (
            lambda c: c.takeoff(5.0),
            replace(GROUND, armed=True, mode=FlightMode.POSITION),
            State.STANDBY,
            "a pilot has armed the vehicle and flies in mode position",
        ),
        (lambda c: c.takeoff(5.0), replace(GROUND, global_position=None), State.STANDBY, "no global position yet"),
        (Commander.engage, GROUND, State.STANDBY, "cannot engage in state standby; take off first"),
        (Commander.hold, GROUND, State.STANDBY, "cannot hold: the vehicle is not in the air"),
        (Commander.land, GROUND, State.STANDBY, "cannot land: the vehicle is not in the air"),
        (Commander.return_home, GROUND, State.STANDBY, "cannot return: the vehicle is not in the air"),
        (Commander.land, replace(AIR, mode=FlightMode.ACRO), State.PILOT, "a pilot flies in mode acro"),
        (Commander.hold, replace(AIR, mode=FlightMode.POSITION), State.PILOT, "a pilot flies in mode position"),
    ],
)
def test_what_does_not_fit_the_state_is_refused_in_words(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, words: str
) -> None:
    refused(words, status, state, ask)


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


def test_a_daemon_that_stops_engages_no_more() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.commander.stopping = True
        with pytest.raises(NotPossibleError, match="the daemon is stopping"):
            await vehicle.commander.engage()

    play(scenario, AIR, State.READY)


def test_without_a_record_nothing_is_connected() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.record.set(None)
        assert vehicle.commander.state is State.DISCONNECTED
        with pytest.raises(NotPossibleError, match="no autopilot is connected"):
            await vehicle.commander.arm()

    play(scenario)


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


TAKING: list[Any] = [
    (Commander.arm, GROUND, State.STANDBY, "cannot arm"),
    (lambda c: c.takeoff(5.0), GROUND, State.STANDBY, "cannot take off"),
    (Commander.engage, AIR, State.READY, "cannot engage"),
]


@pytest.mark.parametrize(("ask", "status", "state", "words"), TAKING)
def test_what_takes_a_vehicle_of_which_only_the_past_is_known_is_refused_after_a_second(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, words: str
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        with pytest.raises(NotPossibleError, match=f"{words}: nothing shows what the autopilot does now"):
            await ask(vehicle.commander)
        assert vehicle.asked == []

    assert play(scenario, replace(status, heard=False), state) == pytest.approx(TIMEOUTS.heard_s, abs=0.1)


@pytest.mark.parametrize("meanwhile", ["hold", "stood_still"])
@pytest.mark.parametrize(("ask", "status", "state", "words"), TAKING)
def test_and_overtakes_nothing_that_came_while_it_waited(
    ask: Callable[[Commander], Awaitable[None]], status: AutopilotStatus, state: State, words: str, meanwhile: str
) -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.HOLD: lambda: vehicle.set(State.READY, mode=FlightMode.HOLD)})
        taking = asyncio.ensure_future(ask(vehicle.commander))
        await asyncio.sleep(0.1)
        if meanwhile == "hold":
            vehicle.set(State.HOLDING, armed=True, landed=LandedState.IN_AIR)
            hold = asyncio.ensure_future(vehicle.commander.hold())
            await asyncio.sleep(0.1)
            await hold
        else:
            vehicle.commander.stood_still()
        asked = list(vehicle.asked)
        vehicle.set(state, heard=True)
        with pytest.raises(NotPossibleError, match=f"{words}: the vehicle was released, or the daemon stood still"):
            await taking
        assert vehicle.asked == asked

    play(scenario, replace(status, heard=False), state)


def test_an_engage_goes_on_when_the_autopilot_is_heard_again_within_a_second() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        answers(vehicle, {RequestKind.ENGAGE: lambda: vehicle.set(State.HOLDING, mode=FlightMode.OFFBOARD)})
        vehicle.later(0.5, State.READY, heard=True)
        await vehicle.commander.engage()

    assert play(scenario, replace(AIR, heard=False), State.READY) == pytest.approx(0.5, abs=0.1)
