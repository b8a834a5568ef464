"""How a goal ends: in success, by cancel, out of time, in silence, or because the vehicle changes hands."""

from dataclasses import replace
from math import dist

import pytest
from support.trajectory_rig import FAR, INPUTS, NEAR, ORIGIN, TICK_S, Rig, assert_smooth, run, to

from daemon.frames import from_yaw, norm
from daemon.guidance.convergence import Tolerance
from daemon.guidance.goals import Goal, HoldGoal, PathGoal, StreamGoal, Through
from daemon.guidance.stream import StreamSample
from daemon.messages import AutopilotStatus, FrameShift, GlobalPosition, Reference, RequestKind, Vec3
from daemon.safety.supervisor import State


def test_a_waypoint_succeeds_after_its_dwell_and_its_hold() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(NEAR, convergence=Tolerance(dwell_s=0.4), hold_s=2.0))
        entry = await rig.end_of(goal_id)
        assert (entry.outcome, entry.by, entry.reason) == ("succeeded", None, None)
        near = next(r.time_s for r in rig.history if dist(r.position_ned_m, NEAR) < 0.3 and _speed(r) < 0.3)
        assert rig.now_s - near == pytest.approx(2.4, abs=0.2)
        assert entry.error_m is not None and entry.error_m < 0.3
        assert entry.duration_s == pytest.approx(rig.now_s - entry.accepted_s, abs=0.02)
        await rig.wait(1.0)
        assert dist(rig.flown.position_ned_m, NEAR) < 1e-6
        assert rig.window.goal_id is None

    run(scenario)


@pytest.mark.parametrize("through", Through)
@pytest.mark.parametrize("hold_s", [0.0, 15.0])
def test_the_last_waypoint_of_a_path_is_held_as_a_waypoint_alone(through: Through, hold_s: float) -> None:
    async def scenario(rig: Rig) -> None:
        waypoints = (to((3.0, 0.0, -10.0)), to((3.0, 3.0, -10.0), hold_s=hold_s))
        goal_id = rig.submit(PathGoal(waypoints=waypoints, through=through))
        entry = await rig.end_of(goal_id)
        assert entry.outcome == "succeeded"
        near = next(r.time_s for r in rig.history if dist(r.position_ned_m, (3.0, 3.0, -10.0)) < 0.05)
        assert rig.now_s - near == pytest.approx(hold_s + 0.8, abs=0.5)

    run(scenario)


@pytest.mark.parametrize(
    "goal",
    [
        to(NEAR, hold_s=6.0),
        to(NEAR, hold_s=6.0, attitude_wb=from_yaw(3.0), convergence=Tolerance(angle_rad=3.0, dwell_s=0.0)),
        PathGoal(waypoints=(to(FAR, hold_s=2.0), to(NEAR, hold_s=6.0))),
        PathGoal(waypoints=(to(FAR), to(NEAR, hold_s=6.0)), through=Through.FLY_BY),
        HoldGoal(duration_s=4.0),
    ],
)
def test_the_time_to_go_counts_the_hold_and_is_never_negative(goal: Goal) -> None:
    async def scenario(rig: Rig) -> None:
        entry = await rig.end_of(rig.submit(goal))
        assert entry.outcome == "succeeded"
        assert all(one.eta_s >= 0.0 for one in rig.progress)
        left_s = [rig.now_s - 0.1 * i for i in range(len(rig.progress), 0, -1)]
        told_s = [s + one.eta_s for s, one in zip(left_s, rig.progress, strict=True)]
        assert all(-1.5 < told - rig.now_s < 1.5 for told in told_s)
        assert rig.progress[-1].eta_s < 0.7

    run(scenario)


def test_a_cancelled_hold_has_nothing_to_go() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(NEAR, hold_s=60.0))
        await rig.wait(10.0)
        assert 50.0 < rig.progress[-1].eta_s < 60.0
        rig.progress.clear()
        rig.task.cancel()
        await rig.end_of(goal_id)
        assert all(one.eta_s < 0.5 for one in rig.progress)

    run(scenario)


def test_the_reference_goes_on_to_the_goal_itself_after_its_success() -> None:
    async def scenario(rig: Rig) -> None:
        wide = Tolerance(position_m=1.8, speed_m_s=5.0, dwell_s=0.0)
        await rig.end_of(rig.submit(to(NEAR, convergence=wide)))
        assert dist(rig.flown.position_ned_m, NEAR) > 1.0
        await rig.wait(2.0)
        assert dist(rig.flown.position_ned_m, NEAR) < 1e-6

    run(scenario)


def test_progress_is_told_ten_times_a_second_until_the_end() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        entry = await rig.end_of(goal_id)
        assert entry.duration_s is not None
        assert len(rig.progress) == pytest.approx(10.0 * entry.duration_s, abs=2.0)
        shares = [one.progress for one in rig.progress]
        assert shares == sorted(shares)
        assert {one.goal_id for one in rig.progress} == {goal_id}
        etas = [one.eta_s + 0.1 * i for i, one in enumerate(rig.progress) if one.eta_s > 0.0]
        assert max(etas) - min(etas) < 0.05
        told = len(rig.progress)
        await rig.wait(1.0)
        assert len(rig.progress) == told

    run(scenario)


def test_a_goal_out_of_time_is_aborted_and_the_vehicle_brakes() -> None:
    async def scenario(rig: Rig) -> None:
        entry = await rig.end_of(rig.submit(to(FAR), timeout_s=2.0))
        assert (entry.outcome, entry.reason) == ("aborted", "timeout")
        assert entry.duration_s == pytest.approx(2.0, abs=0.11)
        await rig.wait(4.0)
        assert _speed(rig.flown) == 0.0
        assert dist(rig.flown.position_ned_m, FAR) > 5.0
        assert_smooth(rig.history)

    run(scenario)


def test_a_cancelled_goal_ends_when_the_vehicle_rests() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(2.5)
        assert _speed(rig.flown) > 2.0
        rig.task.cancel()
        rig.task.cancel()
        assert not rig.ended
        entry = await rig.end_of(goal_id)
        assert (entry.outcome, entry.reason) == ("canceled", None)
        assert _speed(rig.flown) < 0.05
        place = rig.flown.position_ned_m
        await rig.wait(1.0)
        assert dist(rig.flown.position_ned_m, place) < 0.05
        assert_smooth(rig.history)

    run(scenario)


@pytest.mark.parametrize(
    ("left", "request_kind", "outcome", "reason"),
    [
        ("pilot_override", None, "aborted", "pilot_override"),
        ("autopilot_failsafe", None, "aborted", "autopilot_failsafe"),
        ("requested", RequestKind.LAND, "canceled", "vehicle.land"),
        ("requested", RequestKind.HOLD, "canceled", "vehicle.hold"),
    ],
)
def test_a_vehicle_that_changes_hands_ends_its_goal(
    left: str, request_kind: RequestKind | None, outcome: str, reason: str
) -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        if request_kind is not None:
            rig.asks(request_kind)
        rig.state, rig.left = State.PILOT, left
        await rig.wait(2 * TICK_S)
        entry = await rig.end_of(goal_id)
        assert (entry.outcome, entry.reason) == (outcome, reason)
        assert rig.task.window.value is None
        assert rig.task.plan.value is None

    run(scenario)


def test_crossing_the_fence_aborts_the_goal_and_not_the_one_that_leads_back() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        record = rig.record.value
        assert record is not None
        seen = replace(record, conditions=replace(record.conditions, fence_crossed=True))
        rig.task.on_control_tick(INPUTS, seen)
        assert [(e.goal_id, e.outcome, e.reason) for e in rig.ended] == [(goal_id, "aborted", "geofence")]
        back = rig.submit(to(NEAR))
        rig.task.on_control_tick(INPUTS, seen)
        assert (await rig.end_of(back)).outcome == "succeeded"

    run(scenario)


def sample(rig: Rig, position: Vec3, velocity: Vec3 = (0.0, 0.0, 0.0)) -> StreamSample:
    return StreamSample(stamp_s=rig.now_s, position_ned_m=position, velocity_ned_m_s=velocity)


def test_a_stream_is_followed_and_its_silence_brakes_and_aborts() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(StreamGoal(timeout_s=0.5))
        for n in range(100):
            rig.task.stream(sample(rig, (0.05 * n, 0.0, -10.0), (1.0, 0.0, 0.0)))
            await rig.wait(0.05)
        last_s = rig.now_s
        assert rig.flown.velocity_ned_m_s[0] == pytest.approx(1.0, abs=0.01)
        assert rig.flown.position_ned_m[0] == pytest.approx(5.0, abs=0.05)
        entry = await rig.end_of(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "stream_timeout")
        assert rig.now_s - last_s == pytest.approx(0.5, abs=0.15)
        await rig.wait(2.0)
        assert _speed(rig.flown) == 0.0
        assert_smooth(rig.history)

    run(scenario)


def test_a_stream_that_never_speaks_is_aborted() -> None:
    async def scenario(rig: Rig) -> None:
        entry = await rig.end_of(rig.submit(StreamGoal(timeout_s=0.3)))
        assert (entry.outcome, entry.reason) == ("aborted", "stream_timeout")
        assert entry.duration_s == pytest.approx(0.35, abs=0.1)

    run(scenario)


def test_references_are_taken_for_an_active_stream_only() -> None:
    async def scenario(rig: Rig) -> None:
        rig.task.stream(sample(rig, NEAR))
        rig.submit(HoldGoal(duration_s=5.0))
        await rig.wait(0.1)
        rig.task.stream(sample(rig, NEAR))
        rig.submit(StreamGoal(timeout_s=0.5))
        await rig.wait(0.1)
        rig.task.cancel()
        rig.task.stream(sample(rig, NEAR))
        await rig.wait(1.0)
        assert dist(rig.flown.position_ned_m, (0.0, 0.0, -10.0)) < 1e-6

    run(scenario)


def test_what_became_of_a_goal_is_kept_for_the_newest_hundred() -> None:
    async def scenario(rig: Rig) -> None:
        await rig.wait(0.1)
        for _ in range(105):
            rig.submit()
        book = rig.task.book
        assert book.find("g5") is None
        kept = book.find("g6")
        assert kept is not None and (kept.outcome, kept.by) == ("preempted", "g7")
        newest = book.find("g105")
        assert newest is not None and newest.outcome is None
        assert len(rig.ended) == 104

    run(scenario)


def _speed(reference: Reference) -> float:
    return norm(reference.velocity_ned_m_s)


@pytest.mark.parametrize("through", [None, Through.FLY_BY])
def test_a_goal_on_the_globe_ends_when_it_must_be_made_anew_and_nobody_tells_the_origin(
    through: Through | None,
) -> None:
    goal = to(FAR) if through is None else PathGoal(waypoints=(to(NEAR), to(FAR)), through=through)

    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(goal, resolve=lambda _status: goal)
        await rig.wait(1.0)
        rig.status.set(AutopilotStatus())
        await rig.wait(1.0)
        assert rig.ended == []  # as long as nothing has jumped, its place is known
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=(0.5, 0.0, 0.0))
        entry = await rig.end_of(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "origin_unknown")
        await rig.wait(3.0)
        assert norm(rig.flown.velocity_ned_m_s) < 1e-6

    run(scenario)


def test_the_origins_rounding_moves_no_goal_and_an_origin_that_moved_does() -> None:
    made: list[GlobalPosition | None] = []

    def resolve(status: AutopilotStatus) -> Goal:
        made.append(status.global_origin)
        return to(FAR)

    async def scenario(rig: Rig) -> None:
        rig.submit(to(FAR), resolve=resolve)
        for latitude_deg in (ORIGIN.latitude_deg, ORIGIN.latitude_deg + 1e-7, ORIGIN.latitude_deg + 3e-6):
            rig.status.set(AutopilotStatus(global_origin=replace(ORIGIN, latitude_deg=latitude_deg)))
            await rig.wait(0.5)
        assert made == [ORIGIN, rig.status.value.global_origin]

    run(scenario)
