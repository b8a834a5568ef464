"""A plan's path, which is drawn and held against the fence within the loop that flies."""

from itertools import pairwise
from math import dist

import pytest

from daemon.frames import norm, scale, subtract
from daemon.guidance import filter_path, filter_plan
from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.heading import HeadedPlan, along_velocity
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import HoldPlan, Plan, SequencePlan
from daemon.guidance.saturation import step_towards
from daemon.messages import Reference, Vec3

LIMITS = MotionLimits()


class _Counted(HoldPlan):
    """An hour in one place that counts how often it is looked at."""

    looks = 0

    def sample(self, time_s: float) -> Reference:
        self.looks += 1
        return super().sample(time_s)


@pytest.mark.parametrize("wrapped", ["alone", "after another plan", "after a reset"])
def test_the_outline_of_a_long_plan_with_a_heading_costs_its_points_only(wrapped: str) -> None:
    start = Reference(0.0, (0.0, 0.0, -5.0))
    counted = _Counted(start, 3600.0)
    plan: Plan = HeadedPlan(counted, start, along_velocity, LIMITS, 1.0)
    if wrapped == "after another plan":
        plan = SequencePlan((HoldPlan(start), plan))
    elif wrapped == "after a reset":
        plan = plan.shifted((1.0, 0.0, 0.0), (0.1, 0.0, 0.0), 0.1, 10.0)
    counted.looks = 0
    assert len(plan.outline(100)) == 100
    assert counted.looks <= 200


@pytest.mark.parametrize("omega_rad_s", [0.1, 1.0, 5.0])
def test_the_outline_of_a_filter_is_near_what_is_flown_however_slow_the_filter(omega_rad_s: float) -> None:
    start = Reference(0.0, (0.0, 0.0, -5.0), velocity_ned_m_s=(0.1, 3.0, 0.0), acceleration_ned_m_s2=(0.0, 1.0, 0.0))
    plan = FilterPlan(start, (300.0, 20.0, -15.0), 0.0, LIMITS, GuidanceParameters(omega_rad_s=omega_rad_s))
    for seen in plan.outline(60):
        assert dist(seen.position_ned_m, plan.sample(seen.time_s).position_ned_m) < 1.0


@pytest.mark.parametrize(
    ("omega_rad_s", "limits"),
    [
        (1.0, LIMITS),
        (1.0, LIMITS.tightened(speed_m_s=0.1)),
        (5.0, LIMITS.tightened(speed_m_s=0.1)),
        (0.1, LIMITS.tightened(speed_m_s=0.5)),
        (5.0, LIMITS),
    ],
)
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.03, -0.08, 0.05)])
def test_looking_at_the_whole_way_of_a_filter_takes_few_steps_however_long_it_lasts(
    omega_rad_s: float, limits: MotionLimits, velocity: Vec3, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = 0

    def counted(*args: object) -> Vec3:
        nonlocal steps
        steps += 1
        return step_towards(*args)  # type: ignore[arg-type]

    for module in (filter_path, filter_plan):
        monkeypatch.setattr(module, "step_towards", counted)
    start = Reference(0.0, (0.0, 0.0, -5.0), velocity)
    flown = FilterPlan(start, (450.0, 10.0, -12.0), 0.0, limits, GuidanceParameters(omega_rad_s=omega_rad_s))
    plan = HeadedPlan(flown, start, along_velocity, limits, 1.0)
    corners = tuple(plan.path.polyline())
    assert corners[0] == start.position_ned_m
    assert corners[-1] == (450.0, 10.0, -12.0)
    assert plan.target.position_ned_m == (450.0, 10.0, -12.0)
    plan.outline()
    assert len(corners) <= steps + 10
    assert steps < 300


@pytest.mark.parametrize(
    ("limits", "velocity", "acceleration"),
    [
        (LIMITS.tightened(speed_m_s=2.0, acceleration_m_s2=0.1, jerk_m_s3=2.0), (-4.1, -1.4, 0.0), (-0.2, 1.6, 0.0)),
        (LIMITS.tightened(acceleration_m_s2=0.5, jerk_m_s3=0.5), (3.0, -3.0, 1.0), (0.5, 0.5, 0.0)),
        (LIMITS, (-3.0, 3.0, -1.0), (1.0, 2.0, 0.5)),
    ],
)
def test_the_way_of_a_filter_is_near_what_is_flown_from_a_start_beyond_the_limits(
    limits: MotionLimits, velocity: Vec3, acceleration: Vec3
) -> None:
    start = Reference(0.0, (0.0, 0.0, -5.0), velocity, acceleration)
    plan = FilterPlan(start, (10.0, 5.0, -8.0), 0.0, limits, GuidanceParameters(omega_rad_s=1.0))
    corners = tuple(plan.path.polyline())
    assert len(corners) < 400
    for i in range(200):
        place = plan.sample(plan.end_s * i / 200).position_ned_m
        assert min(_aside(place, a, b) for a, b in pairwise(corners)) < 0.3


def _aside(place: Vec3, a: Vec3, b: Vec3) -> float:
    """Distance of a place from a straight way."""
    along, to = subtract(b, a), subtract(place, a)
    share = sum(x * y for x, y in zip(along, to, strict=True)) / max(sum(x * x for x in along), 1e-12)
    return norm(subtract(to, scale(along, min(1.0, max(0.0, share)))))
