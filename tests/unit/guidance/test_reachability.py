"""What is refused, with the field at fault and the reason in words."""

from dataclasses import replace
from math import nan, radians

import pytest

from daemon.frames import from_rpy
from daemon.guidance.convergence import Tolerance
from daemon.guidance.goals import (
    Goal,
    HoldGoal,
    PathGoal,
    PolynomialGoal,
    ShapeGoal,
    StreamGoal,
    Through,
    WaypointGoal,
)
from daemon.guidance.heading import PointHeading, TargetHeading, VelocityHeading
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.planner import plan
from daemon.guidance.reachability import Reach, path_refusal, refusal
from daemon.guidance.shapes import Circle, Lemniscate, Shape
from daemon.messages import ZERO3, Reference, Vec3

START = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -10.0))


def fence(position: Vec3) -> tuple[int, str] | None:
    if -position[2] > 120.0:
        return 2, f"a height of {-position[2]:g} m is above the fence's ceiling of 120 m"
    return (0, f"{position[0]:g} m is beyond 60 m") if abs(position[0]) > 60.0 else None


CIRCLE_5 = Circle(center_ned_m=(0.0, 0.0, -10.0), radius_m=5.0)
EIGHT_5 = Lemniscate(center_ned_m=(0.0, 0.0, -10.0), size_m=(5.0, 3.0))
REACH = Reach(limits=MotionLimits(), fence=fence, max_distance_m=300.0)


def at(*position: float) -> WaypointGoal:
    return WaypointGoal(position_ned_m=position)  # type: ignore[arg-type]


def circle(**change: object) -> ShapeGoal:
    shape = {"center_ned_m": (0.0, 20.0, -10.0), "radius_m": 5.0} | change.pop("shape", {})  # type: ignore[operator]
    return ShapeGoal(**({"shape": Circle(**shape), "speed_m_s": 3.0} | change))  # type: ignore[arg-type]


BAD: list[tuple[Goal, str, str]] = [
    (at(0.0, 0.0, -250.0), "waypoint.position[2]", "a height of 250 m is above the fence's ceiling of 120 m"),
    (at(nan, 0.0, -10.0), "waypoint.position[0]", "nan is not finite"),
    (at(0.0, 400.0, -10.0), "waypoint.position", "is 400 m away; at most 300 m are allowed"),
    (
        WaypointGoal(position_ned_m=ZERO3, attitude_wb=from_rpy(radians(2.0), 0.0, 1.0)),
        "waypoint.orientation",
        "2.0 deg",
    ),
    (WaypointGoal(position_ned_m=ZERO3, attitude_wb=(0.0, 0.0, 0.0, 0.0)), "waypoint.orientation", "unit"),
    (WaypointGoal(position_ned_m=ZERO3, hold_s=-1.0), "waypoint.hold_s", "-1 s"),
    (PathGoal(waypoints=()), "path.waypoints", "0 waypoints"),
    (PathGoal(waypoints=(at(0.0, 0.0, -10.0), at(70.0, 0.0, -10.0))), "path.waypoints[1].position[0]", "beyond 60 m"),
    (circle(speed_m_s=4.5), "trajectory.speed_m_s", "4.05 m/s^2 is more than the 3 m/s^2 allowed"),
    (circle(speed_m_s=6.0), "trajectory.speed_m_s", "6.00 m/s is more than the 5 m/s allowed"),
    (circle(speed_m_s=None, period_s=5.0), "trajectory.period_s", "6.28 m/s"),
    (circle(speed_m_s=None), "trajectory.period_s", "positive"),
    (circle(shape={"radius_m": 0.1}, speed_m_s=0.54), "trajectory.speed_m_s", "m/s^3"),
    (circle(shape={"radius_m": -1.0}), "trajectory.radius_m", "-1 m"),
    (circle(shape={"radius_m": 5.0, "axis_ned": ZERO3}), "trajectory.axis", "no direction"),
    (circle(shape={"radius_m": 5.0, "axis_ned": (0.0, 1.0, 0.0)}), "trajectory.speed_m_s", "m/s down"),
    (circle(shape={"center_ned_m": (58.0, 0.0, -10.0)}), "trajectory.center[0]", "on the way round"),
    (circle(turns=0.0), "trajectory.turns", "0 is not more than 0"),
    (circle(turns=1e5), "trajectory.turns", "3600 s"),
    (circle(heading=PointHeading((nan, 0.0, 0.0))), "trajectory.heading.point[0]", "not finite"),
    (ShapeGoal(shape=Lemniscate(center_ned_m=ZERO3, size_m=(5.0, nan)), speed_m_s=1.0), "trajectory.size_m", "nan"),
    (PolynomialGoal(jerk_ned_m_s3=(20.0, 0.0, 0.0), duration_s=0.1), "trajectory.jerk_m_s3", "20.00 m/s^3"),
    (PolynomialGoal(jerk_ned_m_s3=ZERO3, duration_s=nan), "trajectory.duration_s", "nan"),
    (HoldGoal(duration_s=-1.0), "trajectory.duration_s", "-1"),
    (StreamGoal(timeout_s=nan), "stream.timeout_s", "nan"),
]


@pytest.mark.parametrize(("goal", "field", "reason"), BAD, ids=[f"{field}: {reason}" for _, field, reason in BAD])
def test_an_unreachable_goal_is_refused_with_field_and_reason(goal: Goal, field: str, reason: str) -> None:
    found = refusal(goal, START, REACH)
    assert found is not None
    assert found.field == field
    assert reason in found.reason


@pytest.mark.parametrize(
    "goal",
    [
        at(50.0, 0.0, -20.0),
        WaypointGoal(attitude_wb=from_rpy(radians(0.9), 0.0, 1.0)),
        PathGoal(waypoints=(at(0.0, 0.0, -10.0), at(50.0, 0.0, -10.0))),
        circle(),
        ShapeGoal(shape=Lemniscate(center_ned_m=(0.0, 0.0, -10.0), size_m=(10.0, 4.0)), speed_m_s=3.0),
        PolynomialGoal(jerk_ned_m_s3=(1.0, 0.0, 0.0), duration_s=1.5),
        HoldGoal(duration_s=5.0),
        StreamGoal(),
    ],
    ids=lambda goal: type(goal).__name__,
)
def test_a_reachable_goal_is_taken(goal: Goal) -> None:
    assert refusal(goal, START, REACH) is None
    assert path_refusal(plan(START, goal, REACH.limits, GuidanceParameters()), goal, REACH) is None


def test_the_overshoot_of_a_moving_start_counts() -> None:
    fast = Reference(time_s=0.0, position_ned_m=(57.0, 0.0, -10.0), velocity_ned_m_s=(5.0, 0.0, 0.0))
    goal = at(0.0, 0.0, -10.0)
    assert refusal(goal, fast, REACH) is None
    found = path_refusal(plan(fast, goal, REACH.limits, GuidanceParameters()), goal, REACH)
    assert found is not None
    assert found.field == "waypoint.position[0]"
    assert found.reason.startswith("on the way: ")


def test_a_start_outside_of_the_fence_may_come_back_but_not_stay() -> None:
    outside = Reference(time_s=0.0, position_ned_m=(70.0, 0.0, -10.0))
    for goal, taken in ((at(0.0, 0.0, -10.0), True), (HoldGoal(duration_s=1.0), False)):
        found = path_refusal(plan(outside, goal, REACH.limits, GuidanceParameters()), goal, REACH)
        assert (found is None) is taken


def test_what_lies_between_the_places_of_a_straight_way_is_asked_for() -> None:
    """A wall 1 m thick across a leg of 40 m, of which the plan names the two ends only."""

    def wall(position: Vec3) -> tuple[int, str] | None:
        return (0, "in the wall") if 20.0 < position[0] < 21.0 else None

    reach = Reach(limits=MotionLimits(), fence=wall, between=lambda start, _end: ((20.5, 0.0, start[2]),))
    goal = at(40.0, 0.0, -10.0)
    found = path_refusal(plan(START, goal, reach.limits, GuidanceParameters(profile=Profile.JERK_LIMITED)), goal, reach)
    assert found is not None
    assert found.reason == "on the way: in the wall"


def test_a_polynomial_that_grows_beyond_the_limits_is_refused() -> None:
    goal = PolynomialGoal(jerk_ned_m_s3=(2.0, 0.0, 0.0), duration_s=3.0)
    assert refusal(goal, START, REACH) is None
    found = path_refusal(plan(START, goal, REACH.limits, GuidanceParameters()), goal, REACH)
    assert found is not None
    assert found.field == "trajectory.jerk_m_s3"
    assert "is more than the" in found.reason


SLOW = Reach(limits=MotionLimits().tightened(speed_m_s=0.1), max_distance_m=1000.0)
FAR_AND_BACK = (at(900.0, 0.0, -10.0), at(0.0, 10.0, -10.0))  # 9000 s there; the profile ends at 7600 s


@pytest.mark.parametrize(
    "goal",
    [
        PathGoal(waypoints=FAR_AND_BACK),
        PathGoal(waypoints=FAR_AND_BACK, through=Through.FLY_BY),
        PathGoal(waypoints=FAR_AND_BACK[::-1]),
        circle(shape={"center_ned_m": (900.0, 0.0, -10.0)}, speed_m_s=0.05, turns=0.1),
    ],
)
def test_a_place_that_takes_too_long_to_get_to_is_refused_and_never_left_out(goal: Goal) -> None:
    start = replace(START, velocity_ned_m_s=(0.05, 0.05, 0.0))
    way = plan(start, goal, SLOW.limits, GuidanceParameters())
    found = path_refusal(way, goal, SLOW)
    assert found is not None
    assert "takes " in found.reason and "at most 7200 s are allowed" in found.reason
    assert way.end_s > 7200.0


def test_a_path_that_was_refused_for_its_length_would_still_not_leave_a_place_out() -> None:
    way = plan(START, PathGoal(waypoints=FAR_AND_BACK), SLOW.limits, GuidanceParameters())
    for time_s in (10.0, 1e3, 1e6):
        flown = way.sample(time_s)
        assert flown.position_ned_m == START.position_ned_m and flown.velocity_ned_m_s == ZERO3
    assert way.progress(1e6) == 0.0


@pytest.mark.parametrize("duration_s", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("speed_m_s", [0.0, 2.5])
def test_a_short_hard_push_before_a_long_brake_is_held_against_the_limits(duration_s: float, speed_m_s: float) -> None:
    limits = MotionLimits(acceleration_m_s2=0.2)
    start = Reference(0.0, (0.0, 0.0, -10.0), (speed_m_s, 0.0, 0.0))
    for jerk, allowed in ((0.99 * 0.2 / duration_s, True), (1.01 * 0.2 / duration_s, False), (5.5, False)):
        if not jerk < limits.jerk_m_s3:
            continue
        goal = PolynomialGoal(jerk_ned_m_s3=(-jerk, 0.0, 0.0), duration_s=duration_s)
        reach = Reach(limits=limits)
        assert refusal(goal, start, reach) is None
        found = path_refusal(plan(start, goal, limits, GuidanceParameters()), goal, reach)
        assert (found is None) is allowed, (jerk, found)


def test_a_push_whose_speed_peaks_between_its_ends_is_held_against_the_limits() -> None:
    start = Reference(0.0, (0.0, 0.0, -10.0), (4.9, 0.0, 0.0), (0.6, 0.0, 0.0))
    goal = PolynomialGoal(jerk_ned_m_s3=(-1.0, 0.0, 0.0), duration_s=1.2)  # 5.08 m/s after 0.6 s, 4.9 m/s at the end
    found = path_refusal(plan(start, goal, MotionLimits(), GuidanceParameters()), goal, REACH)
    assert found is not None and "5.08 m/s" in found.reason


@pytest.mark.parametrize("through", Through)
def test_the_hold_at_the_end_counts_for_how_long_a_goal_takes(through: Through) -> None:
    slow = MotionLimits(speed_m_s=0.1)
    reach = Reach(limits=slow)
    far = WaypointGoal(position_ned_m=(400.0, 0.0, -10.0), hold_s=3600.0)
    for goal in (far, PathGoal(waypoints=(far,), through=through)):
        found = path_refusal(plan(START, goal, slow, GuidanceParameters(profile=Profile.JERK_LIMITED)), goal, reach)
        assert found is not None and found.reason.endswith("at most 7200 s are allowed")


def test_the_dwell_is_bounded_as_the_hold_is() -> None:
    goal = WaypointGoal(position_ned_m=ZERO3, convergence=Tolerance(dwell_s=1e9))
    found = refusal(goal, START, REACH)
    assert found is not None and found.field == "waypoint.convergence.dwell_s"


def test_a_point_to_look_at_is_within_reach_and_far_ones_are_told_in_few_digits() -> None:
    for goal in (
        circle(heading=PointHeading((1e308, 0.0, 0.0))),
        PolynomialGoal(jerk_ned_m_s3=(0.1, 0.0, 0.0), duration_s=1.0, heading=PointHeading((0.0, 400.0, -10.0))),
        at(1e150, 0.0, -10.0),
    ):
        found = refusal(goal, START, REACH)
        assert found is not None and "m away; at most 300 m" in found.reason
        assert len(found.reason) < 60


@pytest.mark.parametrize(
    "goal",
    [
        circle(shape={"radius_m": 0.49}, speed_m_s=0.4, heading=TargetHeading()),
        circle(shape={"radius_m": 0.3}, speed_m_s=0.2, heading=TargetHeading()),
        circle(shape={"radius_m": 0.3}, speed_m_s=0.2, heading=PointHeading((0.0, 20.0, -3.0))),
    ],
)
def test_a_heading_that_turns_nowhere_on_a_shape_is_refused(goal: ShapeGoal) -> None:
    found = refusal(goal, START, REACH)
    assert found is not None and found.field == "trajectory.heading"
    assert "turns nowhere" in found.reason


def test_no_speed_is_advised_at_which_the_heading_is_not_followed() -> None:
    found = refusal(circle(shape={"radius_m": 0.3}, speed_m_s=0.6, heading=VelocityHeading()), START, REACH)
    assert found is not None and "none does: below 0.5 m/s" in found.reason


@pytest.mark.parametrize("shape", [CIRCLE_5, EIGHT_5], ids=["circle", "lemniscate"])
@pytest.mark.parametrize(("how", "value"), [("speed_m_s", 1e160), ("speed_m_s", 1e308), ("period_s", 1e-300)])
def test_a_rate_whose_square_is_no_number_is_refused_in_words(shape: Shape, how: str, value: float) -> None:
    found = refusal(ShapeGoal(shape=shape, **{how: value}), START, REACH)  # type: ignore[arg-type]
    assert found is not None
    assert found.field == f"trajectory.{how}"
