"""How goals begin, replace each other and end, on a vehicle that flies every window exactly."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import dist, hypot
from typing import Any

import pytest
from support.trajectory_rig import INPUTS, LIMITS, TICK_S, Rig, run

from daemon.frames import add, norm, scale, subtract
from daemon.guidance.convergence import Tolerance
from daemon.guidance.goals import HoldGoal, PathGoal, StreamGoal, Through, WaypointGoal
from daemon.guidance.stream import StreamSample
from daemon.messages import AutopilotStatus, FrameShift, Reference, RequestKind, Vec3
from daemon.safety.supervisor import State

FAR: Vec3 = (30.0, 10.0, -12.0)
NEAR: Vec3 = (2.0, -1.0, -10.0)
CORNERS = tuple(WaypointGoal(position_ned_m=p) for p in ((8.0, 0.0, -10.0), (8.0, 8.0, -12.0), (0.0, 8.0, -10.0)))
FLY_BY = PathGoal(waypoints=CORNERS, through=Through.FLY_BY)


def to(position: Vec3, **waypoint: Any) -> WaypointGoal:
    return WaypointGoal(position_ned_m=position, **waypoint)


def assert_smooth(history: list[Reference]) -> None:
    """p, v and a go on from tick to tick but for what the jerk allowed changes."""
    for one, two in pairwise(history):
        dt = two.time_s - one.time_s
        p = add(add(one.position_ned_m, scale(one.velocity_ned_m_s, dt)), scale(one.acceleration_ned_m_s2, dt * dt / 2))
        v = add(one.velocity_ned_m_s, scale(one.acceleration_ned_m_s2, dt))
        for was, now, jerk_time in (
            (p, two.position_ned_m, dt**3 / 6.0),
            (v, two.velocity_ned_m_s, dt**2 / 2.0),
            (one.acceleration_ned_m_s2, two.acceleration_ned_m_s2, dt),
        ):
            x, y, z = subtract(now, was)
            assert max(hypot(x, y), abs(z)) <= LIMITS.jerk_m_s3 * jerk_time + 1e-6, (one, two)


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
        etas = [one.eta_s + 0.1 * i for i, one in enumerate(rig.progress)]
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


def test_the_newest_goal_wins_and_tells_whom_it_ended() -> None:
    async def scenario(rig: Rig) -> None:
        first = rig.submit(to(FAR))
        await rig.wait(1.03)
        second = rig.submit(to(NEAR))
        assert [(e.goal_id, e.outcome, e.by) for e in rig.ended] == [(first, "preempted", second)]
        third = rig.submit(HoldGoal(duration_s=0.5))
        assert (await rig.end_of(second)).by == third
        assert (await rig.end_of(third)).outcome == "succeeded"
        assert len(rig.ended) == 3
        assert_smooth(rig.history)

    run(scenario)


def test_a_new_window_begins_in_the_reference_that_is_being_flown() -> None:
    async def scenario(rig: Rig) -> None:
        rig.submit(to(FAR))
        for n in range(20):
            await rig.wait(0.17)
            rig.submit(to((3.0 * n % 7.0, -2.0 * n % 5.0, -10.0)))
            await asyncio.sleep(0)
            first = rig.window.samples[0]
            assert rig.window.goal_id == f"g{n + 2}"
            assert dist(first.position_ned_m, rig.flown.position_ned_m) < 1e-9
            assert dist(first.velocity_ned_m_s, rig.flown.velocity_ned_m_s) < 1e-9
            assert dist(first.acceleration_ned_m_s2, rig.flown.acceleration_ned_m_s2) < 1e-9
        assert_smooth(rig.history)

    run(scenario)


def test_an_updated_goal_goes_on_under_its_id() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        order = rig.task.order
        assert order is not None
        rig.task.update(replace(order, goal=to(NEAR)))
        entry = await rig.end_of(goal_id)
        assert entry.outcome == "succeeded"
        assert dist(rig.flown.position_ned_m, NEAR) < 0.3
        assert len(rig.ended) == 1
        rig.task.update(order)
        await rig.wait(0.2)
        assert rig.task.goal_id is None
        assert_smooth(rig.history)

    run(scenario)


def test_an_update_while_a_goal_is_held_begins_anew() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(NEAR, hold_s=1.0))
        await rig.until(lambda: dist(rig.flown.position_ned_m, NEAR) < 1e-3)
        await rig.wait(0.8)
        order = rig.task.order
        assert order is not None
        rig.task.update(replace(order, goal=to(FAR, hold_s=1.0)))
        assert (await rig.end_of(goal_id)).outcome == "succeeded"
        assert dist(rig.flown.position_ned_m, FAR) < 0.3

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


def test_a_goal_that_waits_to_be_engaged_is_flown_from_where_the_vehicle_is_then() -> None:
    async def scenario(rig: Rig) -> None:
        rig.state = State.READY
        await rig.wait(0.5)
        goal_id = rig.submit(to(NEAR))
        rig.state = State.ENGAGING
        await rig.wait(0.5)
        assert not rig.ended and rig.task.window.value is None
        rig.state = State.HOLDING
        assert (await rig.end_of(goal_id)).outcome == "succeeded"

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


def slow_planning(monkeypatch: pytest.MonkeyPatch, takes_s: list[float]) -> list[float]:
    """Planning beside the loop takes that long, one number for each attempt; returns when each began."""
    loop, begun = asyncio.get_running_loop(), list[float]()

    def run_in_executor(_executor: None, work: Callable[..., object], *args: object) -> "asyncio.Task[object]":
        async def slowly() -> object:
            begun.append(loop.time())
            await asyncio.sleep(takes_s[len(begun) - 1])
            return work(*args)

        return asyncio.ensure_future(slowly())

    monkeypatch.setattr(loop, "run_in_executor", run_in_executor)
    return begun


def passes(rig: Rig) -> bool:
    return all(
        min(dist(r.position_ned_m, corner.position_ned_m or NEAR) for r in rig.history) < 0.05 for corner in CORNERS
    )


@pytest.mark.parametrize("takes_s", [[0.3], [0.7, 0.8]])
def test_the_vehicle_goes_on_while_a_long_path_is_planned(
    monkeypatch: pytest.MonkeyPatch, takes_s: list[float]
) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, takes_s)
        first = rig.submit(to((0.0, -15.0, -10.0)))
        await rig.wait(1.5)
        goal_id = rig.submit(FLY_BY)
        assert (await rig.end_of(first)).by == goal_id
        await rig.wait(0.12)
        assert rig.flown.acceleration_ned_m_s2[1] == pytest.approx(-3.0)
        entry = await rig.end_of(goal_id)
        assert entry.outcome == "succeeded"
        assert len(begun) == len(takes_s)
        assert passes(rig)
        assert_smooth(rig.history)

    run(scenario)


def test_a_cancel_brakes_at_once_whatever_is_being_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        slow_planning(monkeypatch, [0.45])
        rig.submit(to((0.0, -15.0, -10.0)))
        await rig.wait(1.5)
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.05)
        rig.task.cancel()
        await rig.wait(0.35)
        assert rig.flown.velocity_ned_m_s[1] < -4.0
        assert rig.flown.acceleration_ned_m_s2[1] > 0.3
        assert (await rig.end_of(goal_id)).outcome == "canceled"
        assert_smooth(rig.history)

    run(scenario)


@pytest.mark.parametrize("then", ["newer", "cancel", "pilot"])
def test_an_unfinished_plan_is_dropped(monkeypatch: pytest.MonkeyPatch, then: str) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, [0.4])
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.1)
        assert len(begun) == 1
        if then == "newer":
            newer = rig.submit(to(NEAR))
            assert (await rig.end_of(newer)).outcome == "succeeded"
        elif then == "cancel":
            rig.task.cancel()
        else:
            rig.state, rig.left = State.PILOT, "pilot_override"
        entry = await rig.end_of(goal_id)
        expected = {"newer": ("preempted", None), "cancel": ("canceled", None), "pilot": ("aborted", "pilot_override")}
        assert (entry.outcome, entry.reason) == expected[then]
        await rig.wait(1.0)
        assert len(begun) == 1
        assert min(dist(r.position_ned_m, (8.0, 0.0, -10.0)) for r in rig.history) > 5.0
        assert_smooth(rig.history)

    run(scenario)


def test_a_path_is_planned_anew_when_the_estimate_jumped_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, [0.3, 0.3])
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.1)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=(0.0, 0.0, 0.0), yaw_rad=0.1)
        assert (await rig.end_of(goal_id)).outcome == "succeeded"
        assert len(begun) == 2

    run(scenario)


def test_a_goal_keeps_its_physical_place_when_the_estimate_jumps() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        jump = (0.5, -0.25, 0.1)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=jump)
        await rig.end_of(goal_id)
        await rig.wait(1.0)
        assert dist(rig.flown.position_ned_m, add(FAR, jump)) < 1e-6

    run(scenario)


def test_a_place_on_the_globe_is_made_anew_when_the_estimate_jumps() -> None:
    async def scenario(rig: Rig) -> None:
        places = [(6.0, 0.0, -10.0), (6.5, 0.0, -10.0)]

        def resolve(_status: AutopilotStatus) -> WaypointGoal:
            return to(places[rig.shift.count])

        goal_id = rig.submit(to(places[0]), resolve=resolve)
        await rig.wait(1.0)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=(9.0, 9.0, 9.0))
        await rig.end_of(goal_id)
        assert dist(rig.flown.position_ned_m, places[1]) < 0.3

    run(scenario)


@pytest.mark.parametrize("goal", [to(NEAR), FLY_BY])
def test_a_failure_of_planning_is_a_failure_of_the_task(goal: WaypointGoal | PathGoal) -> None:
    def fails(_status: AutopilotStatus) -> WaypointGoal:
        raise ZeroDivisionError("a mistake")

    async def scenario(rig: Rig) -> None:
        rig.submit(goal, resolve=fails)
        await rig.wait(5.0)
        pytest.fail("the task went on")

    with pytest.raises(ZeroDivisionError, match="a mistake"):
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
