"""A vehicle request that does not fit is refused in words."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest
from support.commander_rig import AIR, GROUND, TIMEOUTS, Vehicle, answers, play, refused

from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import AutopilotStatus, FlightMode, LandedState, RequestKind
from daemon.safety.supervisor import State

ROVER = replace(GROUND, airframe="a rover (MAV_TYPE 10)")


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
        (lambda c: c.takeoff(5.0), ROVER, State.STANDBY, "cannot take off: .* multirotors, .* a rover"),
        (Commander.arm, ROVER, State.STANDBY, "cannot arm: .* multirotors, .* a rover"),
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


def test_without_a_record_nothing_is_connected() -> None:
    async def scenario(vehicle: Vehicle) -> None:
        vehicle.record.set(None)
        assert vehicle.commander.state is State.DISCONNECTED
        with pytest.raises(NotPossibleError, match="no autopilot is connected"):
            await vehicle.commander.arm()

    play(scenario)


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
