"""Shapes, polynomials, paths and headings: where they lead, within limits, without a bump."""

from math import atan2, cos, dist, hypot, pi, radians, sin, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.frames import from_yaw, wrap_pi
from daemon.guidance.brake import brake
from daemon.guidance.goals import Goal, HoldGoal, PathGoal, PolynomialGoal, ShapeGoal, Through, WaypointGoal
from daemon.guidance.heading import FixedHeading, HeadedPlan, PointHeading, TargetHeading, VelocityHeading
from daemon.guidance.limits import MotionLimits
from daemon.guidance.minimum_snap import through
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import HoldPlan
from daemon.guidance.planner import plan
from daemon.guidance.polynomial import candidates
from daemon.guidance.shapes import Circle, Lemniscate, plane_of
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.messages import ZERO3, Reference, Vec3

LIMITS = MotionLimits()
PARAMETERS = GuidanceParameters(omega_yaw_rad_s=2.0)
START = Reference(
    time_s=100.0,
    position_ned_m=(4.0, -3.0, -10.0),
    velocity_ned_m_s=(1.5, 0.5, -0.2),
    acceleration_ned_m_s2=(0.3, -0.2, 0.1),
    yaw_rad=2.8,
    yaw_rate_rad_s=0.2,
)
CIRCLE = Circle(center_ned_m=(0.0, 10.0, -12.0), radius_m=5.0)
EIGHT = Lemniscate(center_ned_m=(5.0, 5.0, -10.0), size_m=(8.0, 3.0))


def path_of(*points: Vec3, through: Through) -> PathGoal:
    waypoints = tuple(WaypointGoal(position_ned_m=p, attitude_wb=from_yaw(0.5 * i)) for i, p in enumerate(points))
    return PathGoal(waypoints=waypoints, through=through)


CORNERS = ((10.0, 0.0, -10.0), (10.0, 12.0, -13.0), (-4.0, 12.0, -8.0), (0.0, 0.0, -10.0))
GOALS: dict[str, Goal] = {
    "circle": ShapeGoal(shape=CIRCLE, speed_m_s=3.0, turns=2.0, heading=VelocityHeading()),
    "circle ccw about a level axis": ShapeGoal(
        shape=Circle(center_ned_m=(0.0, 0.0, -15.0), radius_m=3.0, axis_ned=(0.0, 1.0, 0.0)),
        period_s=16.0,
        clockwise=False,
        heading=TargetHeading(),
    ),
    "lemniscate": ShapeGoal(shape=EIGHT, speed_m_s=3.0, turns=1.5, heading=PointHeading((30.0, 0.0, 0.0))),
    "lemniscate short": ShapeGoal(shape=EIGHT, period_s=30.0, turns=0.1),
    "polynomial": PolynomialGoal(jerk_ned_m_s3=(1.0, -0.5, 0.2), duration_s=1.5),
    "hold": HoldGoal(duration_s=4.0),
    "stop": path_of(*CORNERS, through=Through.STOP),
    "fly by": path_of(*CORNERS, through=Through.FLY_BY),
}


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS.keys())
def test_every_goal_starts_bump_less_keeps_the_limits_and_ends_at_rest(checks: SimpleNamespace, goal: Goal) -> None:
    flown = plan(START, goal, LIMITS, PARAMETERS)
    checks.continuous(START, flown.sample(START.time_s))
    before = flown.sample(START.time_s)
    time = START.time_s
    while time < flown.end_s + 6.0:
        time += 0.01
        reference = flown.sample(time)
        checks.within(LIMITS, reference, slack=2e-3)
        assert (
            dist(before.acceleration_ned_m_s2, reference.acceleration_ned_m_s2) <= LIMITS.jerk_m_s3 * sqrt(2) * 0.0101
        )
        assert dist(before.velocity_ned_m_s, reference.velocity_ned_m_s) <= 0.04
        assert dist(before.position_ned_m, reference.position_ned_m) <= 0.06
        assert abs(wrap_pi(before.yaw_rad - reference.yaw_rad)) <= LIMITS.yaw_rate_rad_s * 0.0101
        before = reference
    assert before.velocity_ned_m_s == ZERO3
    assert abs(before.yaw_rate_rad_s) < 1e-3
    assert before.position_ned_m == pytest.approx(flown.target.position_ned_m, abs=1e-6)
    assert wrap_pi(before.yaw_rad - flown.target.yaw_rad) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS.keys())
@settings(max_examples=12, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_derivatives_of_every_goal_belong_to_each_other(checks: SimpleNamespace, goal: Goal, share: float) -> None:
    flown = plan(START, goal, LIMITS, PARAMETERS)
    steps = int(share * (flown.end_s - START.time_s) / 0.01)
    checks.derivatives_agree(flown, START.time_s + (steps + 0.5) * 0.01)


@settings(max_examples=40, deadline=None)
@given(first=st.sampled_from(list(GOALS)), second=st.sampled_from(list(GOALS)), share=st.floats(0.0, 1.0))
def test_any_goal_replaces_any_other_without_a_bump(
    checks: SimpleNamespace, first: str, second: str, share: float
) -> None:
    flown = plan(START, GOALS[first], LIMITS, PARAMETERS)
    now = START.time_s + share * (flown.end_s - START.time_s)
    before = flown.sample(now)
    checks.continuous(before, plan(before, GOALS[second], LIMITS, PARAMETERS).sample(now))


def test_circle_runs_around_its_centre_at_its_speed() -> None:
    flown = plan(START, GOALS["circle"], LIMITS, PARAMETERS)
    half = flown.end_s - 0.5 * 2.0 * 2.0 * pi * 5.0 / 3.0
    for i in range(20):
        reference = flown.sample(half + 0.2 * i)
        assert dist(reference.position_ned_m, CIRCLE.center_ned_m) == pytest.approx(5.0)
        assert hypot(*reference.velocity_ned_m_s) == pytest.approx(3.0)
        assert hypot(*reference.acceleration_ned_m_s2) == pytest.approx(9.0 / 5.0)
        x, y, _ = reference.position_ned_m
        cross = x * reference.velocity_ned_m_s[1] - (y - 10.0) * reference.velocity_ned_m_s[0]
        assert cross > 0.0  # clockwise from above: from north to east


def test_lemniscate_follows_sine_and_double_sine_with_its_peak_speed_in_the_centre() -> None:
    for phase in np.linspace(0.0, 2.0 * pi, 17):
        position, first, second, third = EIGHT.at(float(phase))
        assert position == pytest.approx((5.0 + 8.0 * np.sin(phase), 5.0 + 3.0 * np.sin(2.0 * phase), -10.0))
        h = 1e-5
        later, earlier = EIGHT.at(float(phase) + h), EIGHT.at(float(phase) - h)
        for order, derivative in enumerate((first, second, third)):
            slope = [(b - a) / (2.0 * h) for a, b in zip(earlier[order], later[order], strict=True)]
            assert slope == pytest.approx(list(derivative), abs=1e-7)
    assert hypot(*EIGHT.at(0.0)[1]) == pytest.approx(EIGHT.path_speed_m)


@settings(max_examples=50, deadline=None)
@given(axis=st.tuples(*[st.floats(-5.0, 5.0)] * 3).filter(lambda a: hypot(*a) > 0.01))
def test_plane_is_right_handed_across_the_axis(axis: Vec3) -> None:
    first, second = plane_of(axis)
    along = np.array(axis) / np.linalg.norm(axis)
    assert np.stack((first, second, along)) @ np.stack((first, second, along)).T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.cross(first, second) == pytest.approx(along, abs=1e-9)


@pytest.mark.parametrize("name", ["circle", "lemniscate"])
def test_jerk_of_a_shape_is_the_derivative_of_its_acceleration_in_the_ramps_too(name: str) -> None:
    flown = plan(START, GOALS[name], LIMITS, PARAMETERS)
    for i in range(40):
        time, h = flown.end_s - 6.0 + 0.149 * i, 1e-5
        before, after = (flown.sample(t).acceleration_ned_m_s2 for t in (time - h, time + h))
        slope = [(b - a) / (2.0 * h) for a, b in zip(before, after, strict=True)]
        assert slope == pytest.approx(list(flown.sample(time).jerk_ned_m_s3), abs=1e-4)


def test_turns_too_short_for_the_ramps_are_flown_slower() -> None:
    start = Reference(time_s=0.0, position_ned_m=(5.0, 10.0, -12.0))
    flown = plan(start, ShapeGoal(shape=CIRCLE, speed_m_s=3.0, turns=0.02), LIMITS, PARAMETERS)
    phase = 2.0 * pi * 0.02
    assert flown.target.position_ned_m == pytest.approx((5.0 * cos(phase), 10.0 + 5.0 * sin(phase), -12.0))
    places = [flown.sample(flown.end_s * i / 100.0).position_ned_m for i in range(101)]
    assert sum(map(dist, places, places[1:])) == pytest.approx(5.0 * phase, rel=1e-3)


def test_hold_lasts_its_time_after_braking() -> None:
    assert plan(START, GOALS["hold"], LIMITS, PARAMETERS).end_s == pytest.approx(brake(START, LIMITS).end_s + 4.0)


def test_turns_and_direction_decide_where_a_circle_ends() -> None:
    on_circle = Reference(time_s=0.0, position_ned_m=(5.0, 10.0, -12.0))
    for clockwise, east in ((True, 15.0), (False, 5.0)):
        goal = ShapeGoal(shape=CIRCLE, speed_m_s=2.0, turns=1.25, clockwise=clockwise)
        end = plan(on_circle, goal, LIMITS, PARAMETERS).target.position_ned_m
        assert end == pytest.approx((0.0, east, -12.0), abs=1e-9)


def test_polynomial_has_the_jerk_it_says_and_seven_candidates() -> None:
    found = candidates(START, 2.0, 1.0)
    assert len(found) == 7
    jerks = {primitive.sample(START.time_s).jerk_ned_m_s3 for primitive in found}
    axes = {(2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0)}
    assert jerks == axes | {(-x, -y, -z) for x, y, z in axes} | {ZERO3}
    t, end = 1.0, found[1].sample(START.time_s + 1.0)
    assert end.position_ned_m[0] == pytest.approx(4.0 + 1.5 * t + 0.3 * t**2 / 2.0 + 2.0 * t**3 / 6.0)
    assert end.acceleration_ned_m_s2[0] == pytest.approx(2.3)


def test_stop_path_rests_in_every_waypoint_for_its_hold() -> None:
    waypoints = tuple(WaypointGoal(position_ned_m=p, hold_s=2.0) for p in CORNERS)
    flown = plan(START, PathGoal(waypoints=waypoints), LIMITS, PARAMETERS)
    resting = dict.fromkeys(CORNERS, 0.0)
    time = START.time_s
    while time < flown.end_s:
        time += 0.05
        reference = flown.sample(time)
        for p in CORNERS[:-1]:
            if dist(reference.position_ned_m, p) < 1e-6 and hypot(*reference.velocity_ned_m_s) < 1e-6:
                resting[p] += 0.05
    assert all(resting[p] == pytest.approx(2.0, abs=0.11) for p in CORNERS[:-1])
    assert flown.target.position_ned_m == CORNERS[-1]


def assert_passed_in_order(start: Reference, corners: list[Vec3]) -> None:
    """The path to be flown by, however it is flown, comes by each corner, one after the other."""
    waypoints = tuple(WaypointGoal(position_ned_m=corner) for corner in corners)
    flown = plan(start, PathGoal(waypoints=waypoints, through=Through.FLY_BY), LIMITS, PARAMETERS)
    time_s = start.time_s
    for corner in corners:
        while dist(flown.sample(time_s).position_ned_m, corner) > 0.05:
            time_s += 0.01
            assert time_s <= flown.end_s + 0.02, corner


points = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-30.0, -2.0))


@settings(max_examples=30, deadline=None)
@given(corners=st.lists(points, min_size=1, max_size=12))
def test_minimum_snap_passes_its_points_within_limits(checks: SimpleNamespace, corners: list[Vec3]) -> None:
    start = Reference(time_s=5e5, position_ned_m=(0.0, 0.0, -5.0))
    flown = through(start, tuple(corners), LIMITS)
    if flown is None:
        assert_passed_in_order(start, corners)
        return
    for point, time in zip(corners, flown.passes_s, strict=True):
        assert dist(flown.sample(time).position_ned_m, point) < 2e-3
    for i in range(150):
        checks.within(LIMITS, flown.sample(5e5 + i / 149.0 * (flown.end_s - 5e5)), slack=0.02)


def test_minimum_snap_is_smooth_to_the_sixth_derivative_and_cheaper_than_its_neighbours() -> None:
    start = Reference(time_s=0.0, position_ned_m=ZERO3)
    flown = through(start, ((5.0, 0.0, 0.0), (5.0, 5.0, 0.0), (0.0, 5.0, -2.0)), LIMITS)
    assert flown is not None
    times = np.linspace(0.0, flown.end_s, 4001)
    jerk = np.array([flown.sample(float(t)).jerk_ned_m_s3 for t in times])
    snap = np.gradient(jerk, times, axis=0)
    # a bump that is nothing, with its first three derivatives, at the ends and at every point changes only the snap
    bump = (np.prod([(times - t) ** 4 for t in (0.0, *flown.passes_s)], axis=0)[:, None] / 1e6) * [1.0, -0.5, 0.2]
    bump *= 0.01 / np.abs(bump).max()
    cost = np.trapezoid((snap**2).sum(axis=1), times)
    for sign in (1.0, -1.0):
        added = bump
        for _ in range(4):
            added = np.gradient(added, times, axis=0)
        assert np.trapezoid(((snap + sign * added) ** 2).sum(axis=1), times) > cost


def test_fly_by_does_not_stop_on_the_way_and_turns_to_each_heading() -> None:
    flown = plan(START, GOALS["fly by"], LIMITS, PARAMETERS)
    for corner in CORNERS[:-1]:
        samples = [flown.sample(START.time_s + 0.02 * i) for i in range(int((flown.end_s - START.time_s) * 50))]
        nearest = min(samples, key=lambda r: dist(r.position_ned_m, corner))
        assert dist(nearest.position_ned_m, corner) < 0.1
        assert hypot(*nearest.velocity_ned_m_s) > 0.3
    assert flown.sample(flown.end_s + 5.0).yaw_rad == pytest.approx(1.5, abs=1e-3)


def test_minimum_snap_keeps_a_tight_jerk_limit() -> None:
    tight = LIMITS.tightened(jerk_m_s3=0.3)
    flown = through(Reference(time_s=0.0, position_ned_m=ZERO3), ((5.0, 0.0, 0.0), (5.0, 5.0, 0.0)), tight)
    assert flown is not None
    peak = max(hypot(*flown.sample(0.05 * i).jerk_ned_m_s3) for i in range(int(flown.end_s * 20)))
    assert 0.2 < peak <= 0.301


@pytest.mark.parametrize("east_m_s", [-4.0, 0.5, 4.0])
def test_fly_by_takes_the_quicker_of_flying_on_and_stopping_first(east_m_s: float) -> None:
    start = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -10.0), velocity_ned_m_s=(0.0, east_m_s, 0.0))
    points = ((0.0, 6.0, -10.0), (8.0, 6.0, -10.0))
    flown = plan(start, path_of(*points, through=Through.FLY_BY), LIMITS, PARAMETERS)
    stop = brake(start, LIMITS).target
    ends = [found.end_s for found in (through(start, points, LIMITS), through(stop, points, LIMITS)) if found]
    assert flown.end_s == pytest.approx(min(ends))


def test_a_heading_at_rest_is_not_stepped_any_further() -> None:
    calls = 0

    def wish(_: Reference) -> float:
        nonlocal calls
        calls += 1
        return 1.0

    held = HeadedPlan(HoldPlan(START), START, wish, LIMITS, 2.0)
    assert held.sample(START.time_s + 1e4).yaw_rad == pytest.approx(1.0, abs=1e-6)
    assert calls < 5000


def test_fly_by_with_all_points_in_one_place_and_forward_heading() -> None:
    here = START.position_ned_m
    still = plan(START, path_of(here, here, through=Through.FLY_BY), LIMITS, PARAMETERS)
    assert still.sample(still.end_s).position_ned_m == pytest.approx(here, abs=1e-3)
    ahead = tuple(WaypointGoal(position_ned_m=p, mode=WaypointMode.FORWARD_HEADING) for p in CORNERS)
    flown = plan(START, PathGoal(waypoints=ahead, through=Through.FLY_BY), LIMITS, PARAMETERS)
    reference = flown.sample(flown.end_s - 2.5)
    vx, vy, _ = reference.velocity_ned_m_s
    assert abs(wrap_pi(reference.yaw_rad - atan2(vy, vx))) < radians(15.0)


@pytest.mark.parametrize(
    ("heading", "wanted"),
    [
        (VelocityHeading(), lambda r: atan2(r.velocity_ned_m_s[1], r.velocity_ned_m_s[0])),
        (TargetHeading(), lambda r: atan2(10.0 - r.position_ned_m[1], -r.position_ned_m[0])),
        (PointHeading((100.0, 10.0, 0.0)), lambda r: atan2(10.0 - r.position_ned_m[1], 100.0 - r.position_ned_m[0])),
        (FixedHeading(-1.0), lambda _: -1.0),
        (FixedHeading(), lambda _: 2.8),
    ],
)
def test_headings_are_followed_around_a_circle(heading, wanted) -> None:  # type: ignore[no-untyped-def]
    goal = ShapeGoal(shape=CIRCLE, speed_m_s=3.0, turns=2.0, heading=heading)
    flown = plan(START, goal, LIMITS, PARAMETERS)
    for i in range(30):
        reference = flown.sample(flown.end_s - 12.0 + 0.25 * i)
        assert wrap_pi(reference.yaw_rad - wanted(reference)) == pytest.approx(0.0, abs=radians(2.0))


def test_velocity_heading_keeps_still_at_a_hover() -> None:
    slow = ShapeGoal(shape=CIRCLE, speed_m_s=0.4, turns=0.2, heading=VelocityHeading())
    start = Reference(time_s=0.0, position_ned_m=(5.0, 10.0, -12.0), yaw_rad=1.0)
    flown = plan(start, slow, LIMITS, PARAMETERS)
    assert all(flown.sample(0.5 * i).yaw_rad == pytest.approx(1.0) for i in range(60))
