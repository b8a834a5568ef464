"""The run-up and the run-out of circle and lemniscate: within the limits wherever the turns between them are."""

from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.guidance.goals import ShapeGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.planner import plan
from daemon.guidance.reachability import Reach, refusal
from daemon.guidance.shapes import Circle, Lemniscate, Shape
from daemon.messages import Reference

LIMITS = MotionLimits()
GENTLE = LIMITS.tightened(jerk_m_s3=1.0)
START = Reference(time_s=0.0, position_ned_m=(0.0, 0.0, -20.0))


def circle(radius_m: float) -> Circle:
    return Circle(center_ned_m=START.position_ned_m, radius_m=radius_m)


def lemniscate(*size_m: float) -> Lemniscate:
    return Lemniscate(center_ned_m=START.position_ned_m, size_m=size_m)  # type: ignore[arg-type]


def most_jerk_m_s3(flown: Plan) -> float:
    """The largest change of acceleration over a millisecond, horizontally."""
    steps, h = round(flown.end_s / 0.01), 1e-3
    found = 0.0
    for i in range(steps):
        before, after = flown.path.sample(0.01 * i), flown.path.sample(0.01 * i + h)
        (ax, ay, _), (bx, by, _) = before.acceleration_ned_m_s2, after.acceleration_ned_m_s2
        found = max(found, hypot(bx - ax, by - ay) / h)
    return found


@pytest.mark.parametrize(
    ("shape", "speed_m_s", "limits"),
    [
        (circle(10.0), 4.5, GENTLE),
        (circle(0.32), 0.979, LIMITS),
        (lemniscate(8.0, 3.0), 2.7, GENTLE),
        (lemniscate(1.0, 4.0), 2.4, GENTLE),
    ],
    ids=["wide circle", "narrow circle", "lemniscate", "high lemniscate"],
)
def test_run_up_and_run_out_keep_the_jerk_limit_and_the_speed_that_was_asked_for(
    shape: Shape, speed_m_s: float, limits: MotionLimits
) -> None:
    goal = ShapeGoal(shape=shape, speed_m_s=speed_m_s, turns=3.0)
    assert refusal(goal, START, Reach(limits=limits)) is None
    flown = plan(START, goal, limits, GuidanceParameters())
    assert most_jerk_m_s3(flown) <= 1.006 * limits.jerk_m_s3
    speeds = [hypot(*reference.velocity_ned_m_s) for reference in flown.outline(3000)]
    assert max(speeds) == pytest.approx(speed_m_s, rel=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    size=st.tuples(st.floats(0.3, 20.0), st.floats(0.3, 20.0)),
    round_=st.booleans(),
    share=st.floats(0.5, 1.0),
    turns=st.floats(0.1, 3.0),
    jerk=st.sampled_from([1.0, 10.0]),
)
def test_no_shape_that_is_taken_leaves_the_limits_in_its_ramps(
    size: tuple[float, float], round_: bool, share: float, turns: float, jerk: float
) -> None:
    shape, limits = circle(size[0]) if round_ else lemniscate(*size), LIMITS.tightened(jerk_m_s3=jerk)
    slow, fast = 0.0, 12.0
    for _ in range(12):  # the fastest that is taken
        middle = 0.5 * (slow + fast)
        refused = refusal(ShapeGoal(shape=shape, speed_m_s=middle), START, Reach(limits=limits))
        slow, fast = (middle, fast) if refused is None else (slow, middle)
    flown = plan(START, ShapeGoal(shape=shape, speed_m_s=share * slow, turns=turns), limits, GuidanceParameters())
    for reference in flown.outline(600):
        for value, limit in (
            (reference.velocity_ned_m_s, limits.speed_m_s),
            (reference.acceleration_ned_m_s2, limits.acceleration_m_s2),
            (reference.jerk_ned_m_s3, limits.jerk_m_s3),
        ):
            assert hypot(*value[:2]) <= 1.006 * limit


def test_a_shape_that_cannot_keep_the_limits_is_planned_all_the_same() -> None:
    flown = plan(START, ShapeGoal(shape=circle(1.0), speed_m_s=4.0, turns=500.0), LIMITS, GuidanceParameters())
    assert flown.target.position_ned_m[2] == -20.0
