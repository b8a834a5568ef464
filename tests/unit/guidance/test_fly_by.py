"""Paths flown by: about as quick as with stops, near the straight legs, and stopped at where that cannot be had."""

from itertools import pairwise
from math import dist, hypot
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.guidance.goals import PathGoal, Through, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.planner import plan
from daemon.messages import Reference, Vec3

LIMITS = MotionLimits()
ORIGIN = (0.0, 0.0, -20.0)
LAWNMOWER = [(30.0, 0.0, -20.0), (30.0, 4.0, -20.0), (0.0, 4.0, -20.0), (0.0, 8.0, -20.0), (30.0, 8.0, -20.0)]
SQUARE = [(20.0, 0.0, -20.0), (20.0, 20.0, -20.0), (0.0, 20.0, -20.0), ORIGIN]
FIELD = [(5.0 * (i // 2), 100.0 * ((i + 1) // 2 % 2), -20.0) for i in range(1, 50)]
PATHS = {
    "lawnmower": LAWNMOWER,
    "square": SQUARE,
    "a field of 50 points": FIELD,
    "two points close together": [(40.0, 0.0, -20.0), (42.0, 3.0, -20.0), (40.0, 35.0, -20.0)],
    "far apart, two of them near": [(-26.0, 38.0, -22.0), (30.0, -20.0, -18.0), (33.0, -22.0, -22.0), (-10, -30, -19)],
}


def flown(start: Reference, corners: list[Vec3], through: Through, limits: MotionLimits = LIMITS) -> Plan:
    waypoints = tuple(WaypointGoal(position_ned_m=corner) for corner in corners)
    return plan(start, PathGoal(waypoints=waypoints, through=through), limits, GuidanceParameters())


def aside_m(path: Plan, corners: list[Vec3]) -> float:
    """The farthest that a path goes from the straight lines from corner to corner."""
    places = np.array([reference.position_ned_m for reference in path.outline(1500)])
    distances = []
    for begin, end in pairwise(corners):
        way = np.subtract(end, begin)
        along = np.clip((places - begin) @ way / max(way @ way, 1e-9), 0.0, 1.0)
        distances.append(np.linalg.norm(places - begin - along[:, None] * way, axis=1))
    return float(np.min(distances, axis=0).max())


def assert_passed_in_order(path: Plan, corners: list[Vec3]) -> None:
    time_s = path.start_s
    for corner in corners:
        while dist(path.path.sample(time_s).position_ned_m, corner) > 0.05:
            time_s += 0.01
            assert time_s <= path.end_s + 0.02, corner


def slowest_m_s(path: Plan) -> float:
    """The least speed on the way, the first and the last second apart."""
    times = np.arange(path.start_s + 1.0, path.end_s - 1.0, 0.02)
    return min(hypot(*path.path.sample(float(time)).velocity_ned_m_s) for time in times)


@pytest.mark.parametrize("corners", PATHS.values(), ids=PATHS.keys())
def test_flying_by_is_as_quick_as_stopping_and_stays_near_the_legs(corners: list[Vec3]) -> None:
    start = Reference(time_s=5e5, position_ned_m=ORIGIN)
    by, stopping = (flown(start, corners, through) for through in (Through.FLY_BY, Through.STOP))
    assert by.end_s - 5e5 < 1.08 * (stopping.end_s - 5e5)
    assert aside_m(by, [ORIGIN, *corners]) < 1.1
    assert slowest_m_s(by) > 0.1


points = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-30.0, -2.0))
velocities = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))


@settings(max_examples=30, deadline=None)
@given(corners=st.lists(points, min_size=1, max_size=9), jerk=st.sampled_from([1.0, 10.0]))
def test_any_path_is_passed_in_order_within_limits_and_hardly_slower_than_with_stops(
    checks: SimpleNamespace, corners: list[Vec3], jerk: float
) -> None:
    start, limits = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -5.0)), LIMITS.tightened(jerk_m_s3=jerk)
    by, stopping = (flown(start, corners, through, limits) for through in (Through.FLY_BY, Through.STOP))
    assert by.end_s <= 1.15 * stopping.end_s + 1e-6
    assert aside_m(by, [start.position_ned_m, *corners]) <= 3.0
    assert_passed_in_order(by, corners)
    for reference in by.outline(400):
        checks.within(limits, reference, slack=5e-3)


@settings(max_examples=20, deadline=None)
@given(corners=st.lists(points, min_size=1, max_size=6), velocity=velocities)
def test_a_moving_start_is_hardly_slower_either(checks: SimpleNamespace, corners: list[Vec3], velocity: Vec3) -> None:
    start = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -15.0), velocity_ned_m_s=velocity)
    by, stopping = (flown(start, corners, through) for through in (Through.FLY_BY, Through.STOP))
    checks.continuous(start, by.sample(0.0))
    assert by.end_s <= 1.15 * stopping.end_s + 1e-6
    assert aside_m(by, [start.position_ned_m, *corners]) <= 3.0 + 4.0  # and the way in which it brakes
    assert_passed_in_order(by, corners)


NEAR_TO_EACH_OTHER = [(30.0, 0.0, -20.0), (30.1, 0.0, -20.0), (30.1, 30.0, -20.0)]
GENTLE = LIMITS.tightened(jerk_m_s3=1.0)


def test_where_flying_by_is_clearly_slower_each_point_is_stopped_at() -> None:
    start = Reference(time_s=0.0, position_ned_m=ORIGIN)
    by, stopping = (flown(start, NEAR_TO_EACH_OTHER, way, GENTLE) for way in (Through.FLY_BY, Through.STOP))
    assert by.end_s == stopping.end_s
    for one, other in zip(by.outline(200), stopping.outline(200), strict=True):
        assert one.position_ned_m == other.position_ned_m


def test_waiting_at_the_points_does_not_make_stopping_the_slower_way() -> None:
    start = Reference(time_s=0.0, position_ned_m=ORIGIN)
    waypoints = tuple(WaypointGoal(position_ned_m=corner, hold_s=60.0) for corner in NEAR_TO_EACH_OTHER)
    by = plan(start, PathGoal(waypoints=waypoints, through=Through.FLY_BY), GENTLE, GuidanceParameters())
    assert by.end_s > 120.0


def test_points_too_uneven_for_one_curve_are_all_flown_to() -> None:
    start = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -5.0))
    corners = [(0.0, 0.0, -2.0), (0.0, 0.0, -30.0), (0.0, 0.0, -29.0), (0.0, 0.0, -30.0)]
    assert_passed_in_order(flown(start, corners, Through.FLY_BY), corners)
