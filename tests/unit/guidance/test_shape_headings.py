"""Headings around a shape: met when the lap begins and kept up with, or refused with what would do."""

from math import degrees, pi, radians

import pytest

from daemon.frames import wrap_pi
from daemon.guidance.goals import ShapeGoal
from daemon.guidance.heading import FixedHeading, Heading, PointHeading, TargetHeading, VelocityHeading, turn_s, wish_of
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.planner import plan
from daemon.guidance.reachability import Reach, refusal
from daemon.guidance.saturation import step_heading
from daemon.guidance.shapes import Circle, Lemniscate
from daemon.messages import Reference

LIMITS = MotionLimits(yaw_rate_rad_s=radians(60.0), yaw_acceleration_rad_s2=radians(115.0))
PARAMETERS = GuidanceParameters(omega_yaw_rad_s=1.0)
CENTER = (0.0, 0.0, -20.0)


def start(*position: float, yaw_deg: float = 0.0) -> Reference:
    north, east = position
    return Reference(time_s=0.0, position_ned_m=(north, east, -20.0), yaw_rad=radians(yaw_deg))


def circle(radius_m: float, heading: Heading, **pace: float) -> ShapeGoal:
    shape = Circle(center_ned_m=CENTER, radius_m=radius_m)
    return ShapeGoal(shape=shape, heading=heading, turns=3.0, **pace)  # type: ignore[arg-type]


def refused(goal: ShapeGoal) -> str | None:
    found = refusal(goal, start(0.0, 0.0), Reach(limits=LIMITS))
    return None if found is None else f"{found.field}: {found.reason}"


@pytest.mark.parametrize(
    ("goal", "field", "needed", "would_do"),
    [
        (circle(1.5, TargetHeading(), speed_m_s=2.1), "trajectory.speed_m_s", "by up to 80 deg/s", "at most 1.41 m/s"),
        (circle(2.0, TargetHeading(), speed_m_s=2.0), "trajectory.speed_m_s", "by up to 57 deg/s", "at most 1.88 m/s"),
        (circle(2.0, VelocityHeading(), period_s=6.3), "trajectory.period_s", "by up to 57 deg/s", "at least 6.7 s"),
        (
            circle(10.0, PointHeading((0.0, 9.0, -20.0)), speed_m_s=3.0),
            "trajectory.speed_m_s",
            "by up to 170 deg/s",
            "at most 0.95 m/s",
        ),
    ],
)
def test_a_heading_that_cannot_be_followed_is_refused_with_what_would_do(
    goal: ShapeGoal, field: str, needed: str, would_do: str
) -> None:
    found = refused(goal)
    assert found is not None and found.startswith(field), found
    assert needed in found and "54 deg/s can be followed" in found and found.endswith(would_do), found
    number = float(would_do.split()[2])
    pace = {"speed_m_s": number} if goal.speed_m_s is not None else {"period_s": number}
    assert isinstance(goal.shape, Circle)
    assert refused(circle(goal.shape.radius_m, goal.heading, **pace)) is None


def test_a_target_on_the_way_is_passed_without_turning_and_not_refused() -> None:
    eight = Lemniscate(center_ned_m=CENTER, size_m=(8.0, 4.0))
    assert refused(ShapeGoal(shape=eight, speed_m_s=2.0, heading=TargetHeading())) is None
    assert refused(circle(1.5, VelocityHeading(), speed_m_s=0.4)) is None


@pytest.mark.parametrize("heading", [TargetHeading(), VelocityHeading(), PointHeading((30.0, -20.0, 0.0))])
@pytest.mark.parametrize("position", [(2.0, 0.0), (0.0, 0.0), (5.0, 3.0), (-60.0, 20.0)])
@pytest.mark.parametrize("yaw_deg", [0.0, 100.0, -170.0])
def test_the_heading_is_met_when_the_lap_begins_and_kept(
    heading: Heading, position: tuple[float, float], yaw_deg: float
) -> None:
    goal = circle(2.0, heading, speed_m_s=1.88)
    flown = plan(start(*position, yaw_deg=yaw_deg), goal, LIMITS, PARAMETERS)
    wish, errors = wish_of(heading, CENTER, 0.0), []
    begin_s = flown.end_s - lasts_s(goal)
    for i in range(round((flown.end_s - begin_s) / 0.05)):
        reference = flown.sample(begin_s + 0.05 * i)
        wanted = wish(reference)
        errors.append(0.0 if wanted is None else abs(degrees(wrap_pi(reference.yaw_rad - wanted))))
    assert errors[0] < 6.0
    assert max(errors) < 25.0
    assert sum(errors) / len(errors) < 5.0


def lasts_s(goal: ShapeGoal) -> float:
    """From the begin of the run-up to the end of the run-out: the turns, and once the run-up, which is v / a twice."""
    assert goal.speed_m_s is not None
    return goal.turns * 2.0 * pi / abs(goal.rate_rad_s) + 2.0 * goal.speed_m_s / LIMITS.vertical_acceleration_m_s2


@pytest.mark.parametrize("heading", [TargetHeading(), VelocityHeading()])
def test_nothing_is_waited_for_where_the_heading_is_met_on_the_way(heading: Heading) -> None:
    far = start(-60.0, 20.0)
    fixed, turned = (
        plan(far, circle(2.0, kind, speed_m_s=1.5), LIMITS, PARAMETERS) for kind in (FixedHeading(), heading)
    )
    assert turned.end_s == pytest.approx(fixed.end_s)


@pytest.mark.parametrize("turn_deg", [3.0, 40.0, -90.0, 180.0])
def test_the_time_of_a_turn_is_that_which_its_law_takes(turn_deg: float) -> None:
    yaw, rate, since_s = 0.0, 0.0, 0.0
    while abs(wrap_pi(radians(turn_deg) - yaw)) > radians(5.0):
        acceleration = step_heading(wrap_pi(radians(turn_deg) - yaw), rate, 0.0, 1.0, LIMITS)
        yaw += rate * 0.01 + 0.5 * acceleration * 0.01**2
        rate += acceleration * 0.01
        since_s += 0.01
    assert turn_s(radians(turn_deg), 0.0, 1.0, LIMITS) == pytest.approx(since_s, abs=0.03)
