"""The spine: take-off, goals, preemption, landing, through the real tasks in virtual time."""

from dataclasses import replace
from itertools import pairwise
from math import dist, radians

import pytest
from support.flight import Flight, fly

from daemon import frames
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.messages import FlightMode, LandedState
from daemon.safety.supervisor import State


@pytest.mark.parametrize("noise", [False, True], ids=["noise-free", "noise"])
@pytest.mark.parametrize("profile", ["reference_filter", "jerk_limited"])
def test_three_goals_with_a_preemption_and_a_landing(noise: bool, profile: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(5.0, engage=False)
        assert flight.state is State.READY
        first = await flight.goto(10.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 3.0)
        second = await flight.goto(0.0, 8.0, -8.0)
        third_ends = await flight.result(second)
        assert third_ends.outcome == "succeeded"
        assert flight.ended[0].goal_id == first
        assert (flight.ended[0].outcome, flight.ended[0].by) == ("preempted", second)
        entry = await flight.result(await flight.goto(0.0, 0.0, -5.0, yaw_deg=120.0))
        assert entry.outcome == "succeeded"
        assert entry.error_m is not None and entry.error_m < 0.3
        assert entry.error_deg is not None and entry.error_deg < 5.0
        await flight.until(lambda: flight.state is State.HOLDING, 0.1)
        await flight.vehicle.commander.land()
        assert flight.state is State.STANDBY

    fly(scenario, noise=noise, config={"guidance": {"profile": profile}})


def test_the_reference_goes_on_without_a_step_when_goals_preempt() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        for n, e, d in ((10, 0, -5), (0, 9, -8), (-6, -6, -4), (4, 4, -6)):
            await flight.goto(n, e, d)
            await flight.until(lambda since=flight.now_s: flight.now_s - since > 1.3)
        jerk = flight.vehicle.parameters.value.limits.jerk_m_s3
        flown = [r.reference for r in flight.records if r.reference is not None]
        assert len(flown) > 400
        for before, after in pairwise(flown):
            dt = after.time_s - before.time_s
            drawn = frames.add(before.position_ned_m, frames.scale(before.velocity_ned_m_s, dt))
            drawn = frames.add(drawn, frames.scale(before.acceleration_ned_m_s2, 0.5 * dt * dt))
            assert dist(drawn, after.position_ned_m) < 2.0 * jerk * dt**3
            speed = frames.add(before.velocity_ned_m_s, frames.scale(before.acceleration_ned_m_s2, dt))
            assert dist(speed, after.velocity_ned_m_s) < 2.0 * jerk * dt**2
            assert dist(before.acceleration_ned_m_s2, after.acceleration_ned_m_s2) < 2.0 * jerk * dt + 1e-6

    fly(scenario)


def test_nothing_leaves_before_engage_and_nothing_after_release() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        await flight.until(lambda: flight.now_s > 25.0)
        assert flight.sent == []
        await flight.vehicle.commander.engage()
        assert len(flight.sent) >= 20
        await flight.vehicle.commander.hold()
        count = len(flight.sent)
        since = flight.now_s
        await flight.until(lambda: flight.now_s - since > 3.0)
        assert len(flight.sent) == count
        assert flight.autopilot.status.value.mode is FlightMode.HOLD

    fly(scenario)


def test_engaging_and_releasing_move_the_vehicle_by_less_than_a_hand() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        await flight.until(lambda: flight.now_s > 30.0)
        place = flight.position
        await flight.vehicle.commander.engage()
        await flight.until(lambda: flight.now_s > 35.0)
        assert dist(place, flight.position) < 0.1
        await flight.vehicle.commander.hold()
        assert dist(place, flight.position) < 0.1
        tilts = [frames.tilt_of(r.estimate.newest.attitude_wb) for r in flight.records[-600:] if r.estimate.newest]
        assert max(tilts) < radians(5.0)

    fly(scenario)


def test_a_refused_goal_changes_nothing() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(20.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 2.0)
        for bad, field in (
            ({"waypoint": {"position": [0.0, 0.0, -250.0]}}, "waypoint.position[2]"),
            ({"waypoint": {"position": [0.0, 700.0, -5.0]}}, "waypoint.position[1]"),
            ({"waypoint": {"position": [5000.0, 0.0, -5.0]}}, "waypoint.position"),
        ):
            with pytest.raises(ProtocolError) as error:
                await flight.submit(**bad)
            assert error.value.code is ErrorCode.REFUSED
            assert error.value.field == field
        assert flight.vehicle.trajectory.goal_id == goal_id
        assert (await flight.result(goal_id)).outcome == "succeeded"

    fly(scenario)


def test_a_canceled_goal_brakes_within_the_limits_and_holds() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(60.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 15.0)
        place = flight.position
        flight.vehicle.trajectory.cancel()
        assert flight.ended == []
        entry = await flight.result(goal_id)
        assert entry.outcome == "canceled"
        assert flight.state in (State.HOLDING, State.TRACKING)
        limits = flight.vehicle.parameters.value.limits
        stop_m = limits.speed_m_s**2 / (2 * limits.acceleration_m_s2)
        assert 0.5 * stop_m < flight.position[0] - place[0] < 2.0 * stop_m + 2.0
        await flight.until(lambda: flight.state is State.HOLDING, 2.0)

    fly(scenario)


def test_a_goal_that_takes_too_long_is_aborted_and_the_vehicle_holds() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        entry = await flight.result(await flight.submit(waypoint={"position": [80.0, 0.0, -5.0]}, timeout_s=3.0))
        assert (entry.outcome, entry.reason) == ("aborted", "timeout")
        assert entry.duration_s == pytest.approx(3.0, abs=0.11)
        await flight.until(lambda: flight.state is State.HOLDING, 5.0)
        await flight.until(lambda: frames.norm(flight.px4.truth.velocity_ned_m_s) < 0.1, 10.0)

    fly(scenario)


def test_vehicle_hold_ends_the_goal_as_canceled_with_its_name() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(30.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 2.0)
        await flight.vehicle.commander.hold()
        entry = await flight.result(goal_id, 1.0)
        assert (entry.outcome, entry.reason) == ("canceled", "vehicle.hold")

    fly(scenario)


def test_hold_s_holds_before_success() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        short = await flight.result(await flight.goto(2.0, 0.0, -5.0))
        long = await flight.result(await flight.goto(4.0, 0.0, -5.0, hold_s=3.0))
        assert short.duration_s is not None and long.duration_s is not None
        assert long.duration_s - short.duration_s == pytest.approx(3.0, abs=0.6)

    fly(scenario)


def test_a_take_off_asked_for_before_the_landed_state_has_come_waits_for_it() -> None:
    """It comes in a message of its own, up to 0.1 s after the one by which the vehicle is known."""

    async def scenario(flight: Flight) -> None:
        await flight.until(lambda: flight.state is State.STANDBY)
        status = flight.autopilot.status
        status.set(replace(status.value, landed=LandedState.UNDEFINED))
        await flight.vehicle.commander.takeoff(5.0)
        assert flight.state is State.READY

    fly(scenario)
