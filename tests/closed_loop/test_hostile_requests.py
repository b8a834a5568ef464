"""Requests that cross each other, at the worst tick: the newest counts, none is lost, and replies are true."""

import asyncio

import pytest
from support.flight import CALLER, Flight, fly
from support.wire import slow_planner

from daemon.autopilot.port import Command, CommandKind, CommandRefusedError
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import ConfigSet, GoalUpdate
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import GpsLoss, Link, ModesRefused, PilotTakesOver

PATH = {"waypoints": [{"position": [5, 0, -5]}, {"position": [5, 5, -5]}], "through": "fly_by"}


async def _wait(flight: Flight, time_s: float) -> None:
    await flight.until(lambda since_s=flight.now_s: flight.now_s - since_s >= time_s)


async def _on_ground(flight: Flight) -> None:
    await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)


@pytest.mark.parametrize("request_name", ["hold", "land"])
@pytest.mark.parametrize("one_way_s", [0.0, 0.03])
def test_a_request_in_any_tick_of_an_engage_is_done_and_nothing_leaves_after_it(
    request_name: str, one_way_s: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(30.0 if request_name == "land" else 5.0, engage=False)
        if one_way_s:
            flight.px4.inject(Link(delay_s=one_way_s))
        commander = flight.vehicle.commander
        for ticks in range(20, 26):
            engage = asyncio.ensure_future(commander.engage())
            await _wait(flight, 0.01 * ticks)
            if request_name == "hold":
                await commander.hold()
            else:
                landing = asyncio.ensure_future(commander.land())
                await flight.until(lambda: flight.px4.mode is FlightMode.LAND, 1.0)
                await flight.until(lambda: flight.state is State.LANDING, 1.0)
                landing.cancel()
            mode = flight.px4.mode
            await asyncio.gather(engage, return_exceptions=True)
            count = len(flight.sent)
            await _wait(flight, 1.5)
            assert mode is flight.px4.mode is (FlightMode.HOLD if request_name == "hold" else FlightMode.LAND)
            assert len(flight.sent) == count
            await commander.hold()
            await flight.until(lambda: flight.autopilot.status.value.landed is LandedState.IN_AIR)

    fly(scenario)


@pytest.mark.parametrize(("first", "second"), [("hold", "land"), ("land", "hold")])
def test_the_newer_of_two_requests_wins_while_the_vehicle_is_released(first: str, second: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(30.0)
        commander = flight.vehicle.commander
        for delay_s in (0.0, 0.01, 0.03):
            older = asyncio.ensure_future(getattr(commander, first)())
            await asyncio.sleep(delay_s)
            newer = asyncio.ensure_future(getattr(commander, second)())
            await _wait(flight, 1.5)
            assert flight.px4.mode is (FlightMode.LAND if second == "land" else FlightMode.HOLD), delay_s
            newer.cancel()
            await asyncio.gather(older, newer, return_exceptions=True)
            await commander.hold()
            await flight.until(lambda: flight.autopilot.status.value.landed is LandedState.IN_AIR)
            await commander.engage()

    fly(scenario)


@pytest.mark.parametrize("ticks", [0, 1, 10, 21, 22, 23])
@pytest.mark.parametrize("what", ["engage", "submit"])
def test_a_stop_at_any_tick_of_an_engage_leaves_the_vehicle_in_hold(ticks: int, what: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        if what == "engage":
            engage = asyncio.ensure_future(flight.vehicle.commander.engage())
            engage.add_done_callback(lambda done: done.exception())
        else:
            await flight.goto(10.0, 0.0, -5.0)
        await asyncio.sleep(0)
        if ticks:
            await _wait(flight, 0.01 * ticks)
        await flight.vehicle.release()
        assert flight.state not in OURS
        count = len(flight.sent)
        await _wait(flight, 1.0)
        assert len(flight.sent) == count
        assert flight.px4.mode is FlightMode.HOLD
        assert len(flight.ended) == (what == "submit")
        with pytest.raises(NotPossibleError, match="stopping"):
            await flight.vehicle.commander.engage()

    fly(scenario)


def test_a_goal_submitted_while_somebody_else_engages_ends_when_the_engage_is_refused() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(ModesRefused(modes=("offboard",)))
        engage = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: flight.state is State.ENGAGING)
        entry = await flight.result(await flight.goto(10.0, 0.0, -5.0), 5.0)
        assert entry.outcome == "aborted"
        with pytest.raises(CommandRefusedError):
            await engage

    fly(scenario)


def test_a_goal_whose_planning_outlasts_the_vehicles_release_is_refused_and_never_flown() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        slow_planner(1.0)
        submitted = asyncio.ensure_future(flight.submit(path=PATH))
        await _wait(flight, 0.2)
        await flight.vehicle.commander.hold()
        with pytest.raises(ProtocolError, match="released"):
            await submitted
        await flight.vehicle.commander.engage()
        await _wait(flight, 2.0)
        assert flight.vehicle.trajectory.goal_id is None
        assert flight.state is State.HOLDING

    fly(scenario)


def test_a_pilot_who_takes_over_while_a_path_is_planned_ends_its_goal_at_once() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        slow_planner(5.0, after=1)
        goal_id = await flight.submit(path=PATH)
        await _wait(flight, 0.3)
        flight.px4.inject(PilotTakesOver(mode="position"))
        entry = await flight.result(goal_id, 0.5)
        assert (entry.outcome, entry.reason) == ("aborted", "pilot_override")
        await _wait(flight, 6.0)
        assert len(flight.ended) == 1

    fly(scenario)


@pytest.mark.parametrize("before_s", [0.02, 0.05])
def test_a_pilot_who_takes_over_just_before_offboard_is_not_left_without_sticks(before_s: float) -> None:
    """On a slow link OFFBOARD takes effect after the pilot's mode: until it is undone, nobody flies."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(delay_s=0.03))
        await _wait(flight, 1.0)
        engaging = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: FlightMode.OFFBOARD in {mode for _, mode in flight.asked[-1:]})
        await _wait(flight, 0.03 - before_s)
        flight.px4.inject(PilotTakesOver(mode="position"))
        since_s, offboard_s = flight.now_s, 0.0
        while flight.now_s - since_s < 3.0:
            await _wait(flight, 0.01)
            offboard_s += 0.01 * (flight.px4.mode is FlightMode.OFFBOARD)
        assert offboard_s < 0.3
        assert flight.state is State.PILOT
        with pytest.raises(CommandRefusedError, match="pilot"):
            await engaging

    fly(scenario)


def test_a_cancel_brakes_at_once_while_a_path_is_still_being_planned() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.goto(80.0, 0.0, -5.0)
        await _wait(flight, 3.0)
        slow_planner(5.0, after=1)
        goal_id = await flight.submit(path=PATH)
        await _wait(flight, 0.2)
        place = flight.position
        flight.vehicle.trajectory.cancel()
        assert (await flight.result(goal_id, 5.0)).outcome == "canceled"
        assert flight.position[0] - place[0] < 8.0

    fly(scenario)


def test_a_canceled_goal_cannot_be_moved() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(30.0, 0.0, -5.0)
        await _wait(flight, 2.0)
        flight.vehicle.trajectory.cancel()
        update = {"goal_id": goal_id, "waypoint": {"position": [0.0, 10.0, -5.0]}}
        with pytest.raises(ProtocolError) as error:
            await flight.service.goal_update(GoalUpdate.model_validate(update), CALLER)
        assert error.value.code is ErrorCode.WRONG_STATE

    fly(scenario)


@pytest.mark.parametrize("request_name", ["hold", "land"])
def test_a_request_that_ends_a_goal_before_it_is_flown_is_named_as_its_end(request_name: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        goal_id = await flight.goto(10.0, 0.0, -5.0)
        await _wait(flight, 0.1)
        request = asyncio.ensure_future(getattr(flight.vehicle.commander, request_name)())
        entry = await flight.result(goal_id, 1.0)
        request.cancel()
        assert (entry.outcome, entry.reason) == ("canceled", f"vehicle.{request_name}")

    fly(scenario)


def test_a_request_that_is_refused_does_not_end_a_pending_one() -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight)
        takeoff = asyncio.ensure_future(flight.vehicle.commander.takeoff(5.0))
        await flight.until(lambda: flight.state is State.TAKING_OFF)
        for refused in (flight.vehicle.commander.engage, lambda: flight.vehicle.commander.takeoff(3.0)):
            with pytest.raises(NotPossibleError):
                await refused()
        await takeoff
        assert flight.state is State.READY

    fly(scenario)


def test_take_off_does_not_take_the_vehicle_from_a_pilot_who_has_armed_it() -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight)
        await flight.vehicle.commander.arm()
        flight.px4.inject(PilotTakesOver(mode="position"))
        await flight.until(lambda: flight.autopilot.status.value.mode is FlightMode.POSITION)
        with pytest.raises(NotPossibleError, match="pilot"):
            await flight.vehicle.commander.takeoff(5.0)
        assert flight.px4.mode is FlightMode.POSITION

    fly(scenario)


def test_a_take_off_that_was_superseded_while_arming_is_not_commanded() -> None:
    async def scenario(flight: Flight) -> None:
        await _on_ground(flight)
        commanded: list[CommandKind] = []
        command, disarming = flight.autopilot.command, asyncio.Event()

        async def acknowledged_late(what: Command, timeout_s: float) -> None:
            commanded.append(what.kind)
            await command(what, timeout_s)
            await disarming.wait()

        flight.autopilot.command = acknowledged_late  # type: ignore[method-assign]
        takeoff = asyncio.ensure_future(flight.vehicle.commander.takeoff(5.0))
        await flight.until(lambda: flight.autopilot.status.value.armed)
        flight.px4.inject(Link(delay_s=0.2))
        await _wait(flight, 0.4)
        disarm = asyncio.ensure_future(flight.vehicle.commander.disarm())
        await flight.until(lambda: commanded[-1] is CommandKind.DISARM)
        disarming.set()
        with pytest.raises(NotPossibleError, match="superseded"):
            await takeoff
        await disarm
        assert commanded == [CommandKind.ARM, CommandKind.DISARM]

    fly(scenario)


def test_what_the_reference_is_timed_by_cannot_be_changed_while_it_is_flown() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        with pytest.raises(ProtocolError) as error:
            await flight.service.config_set(ConfigSet(path="loops.command_latency_s", value=0.2), CALLER)
        assert error.value.code is ErrorCode.REFUSED

    fly(scenario)


def test_a_landing_asked_for_while_a_failsafe_lands_is_answered_when_the_vehicle_is_down() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(8.0, engage=False)
        flight.px4.inject(GpsLoss())
        await flight.until(lambda: flight.state is State.FAULT)
        assert flight.px4.mode is FlightMode.LAND
        states = len(flight.records)
        await flight.vehicle.commander.land()
        assert flight.px4.truth.on_ground
        assert not flight.px4.armed
        seen = {record.supervision.state for record in flight.records[states:]}
        assert seen == {State.FAULT, State.LANDING, State.STANDBY}

    fly(scenario)
