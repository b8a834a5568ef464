"""Coming to rest along the way of a plan."""

from dataclasses import replace
from itertools import pairwise
from math import dist, hypot
from types import SimpleNamespace

import pytest

from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.goals import ShapeGoal
from daemon.guidance.heading import HeadedPlan
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import STRAY_M, Plan
from daemon.guidance.planner import plan
from daemon.guidance.reachability import Reach, way_refusal
from daemon.guidance.shapes import Circle
from daemon.guidance.slowed_plan import slow_down
from daemon.messages import Reference

LIMITS = MotionLimits(acceleration_m_s2=1.0)
GOAL = ShapeGoal(shape=Circle(center_ned_m=(0.0, 0.0, -5.0), radius_m=26.0), speed_m_s=5.0, turns=3.0)
WIDE = Circle(center_ned_m=(0.0, 0.0, -5.0), radius_m=300.0)
FROM_S = 45.0


def test_it_goes_on_without_a_step_keeps_the_limits_and_rests_on_the_way(checks: SimpleNamespace) -> None:
    flown = plan(Reference(0.0, (26.0, 0.0, -5.0)), GOAL, LIMITS, GuidanceParameters())
    slowed = slow_down(flown, FROM_S, LIMITS)
    assert hypot(*flown.sample(FROM_S).velocity_ned_m_s) == pytest.approx(5.0)
    checks.continuous(flown.sample(FROM_S), slowed.sample(FROM_S))
    for i in range(1, 200):
        time_s = FROM_S + (slowed.end_s - FROM_S) * i / 200 + 1e-3
        checks.within(LIMITS, slowed.sample(time_s), slack=0.02)
        assert hypot(*slowed.sample(time_s).position_ned_m[:2]) == pytest.approx(26.0)
    for time_s in (FROM_S + 1.2345, FROM_S + 4.5678):
        checks.derivatives_agree(slowed, time_s)
    for time_s in (slowed.end_s, slowed.end_s + 50.0):
        assert dist(slowed.sample(time_s).velocity_ned_m_s, (0.0, 0.0, 0.0)) < 1e-9
        assert dist(slowed.sample(time_s).position_ned_m, slowed.target.position_ned_m) < 1e-9
    assert slowed.end_s - FROM_S < 5.0 * 5.0 / LIMITS.acceleration_m_s2


def test_its_way_is_few_straight_places_near_what_is_flown() -> None:
    flown = plan(Reference(0.0, (26.0, 0.0, -5.0)), GOAL, LIMITS, GuidanceParameters())
    slowed = slow_down(flown, FROM_S, LIMITS)
    corners = tuple(slowed.path.polyline())
    assert len(corners) < 15
    assert corners[0] == flown.sample(FROM_S).position_ned_m
    assert dist(corners[-1], slowed.target.position_ned_m) < 1e-6
    middles = [tuple(0.5 * (p + q) for p, q in zip(a, b, strict=True)) for a, b in pairwise(corners)]
    assert all(26.0 - hypot(*middle[:2]) < STRAY_M for middle in middles)


def test_a_plan_beyond_the_limits_is_not_slowed_down_for_ever() -> None:
    flown = plan(Reference(0.0, (26.0, 0.0, -5.0)), GOAL, LIMITS, GuidanceParameters())
    tight = LIMITS.tightened(acceleration_m_s2=0.5)
    slowed = slow_down(flown, FROM_S, tight)
    assert slowed.end_s - FROM_S == pytest.approx(2.0 * 5.0 / 0.5)


@pytest.mark.parametrize("kind", ["filter", "circle"])
def test_it_is_held_against_the_fence_without_stepping_far_ahead(kind: str) -> None:
    """Each step of a filter or a heading takes 10 us: minutes of them would make the control task wait."""
    slow = MotionLimits(acceleration_m_s2=0.1, vertical_acceleration_m_s2=0.1)
    flown: Plan
    if kind == "filter":
        moving = Reference(0.0, (0.0, 0.0, -5.0), (4.0, 0.0, 0.0))
        flown = FilterPlan(moving, (0.0, 300.0, -5.0), 1.0, slow, GuidanceParameters())
    else:
        flown = plan(Reference(0.0, (300.0, 0.0, -5.0)), replace(GOAL, shape=WIDE), slow, GuidanceParameters())
    assert isinstance(flown, FilterPlan | HeadedPlan)
    flown.sample(30.0)
    stepped = len(flown._nodes)
    slowed = slow_down(flown, 30.0, slow)
    assert slowed.end_s > 60.0
    assert way_refusal(slowed, "", Reach(limits=slow)) is None
    foreseen = slowed.target
    assert len(flown._nodes) == stepped
    rests = slowed.sample(slowed.end_s)
    assert dist(foreseen.position_ned_m, rests.position_ned_m) < 0.5
    assert foreseen.yaw_rad == pytest.approx(rests.yaw_rad, abs=0.01)
    assert slowed.target.position_ned_m == rests.position_ned_m


def test_a_level_plan_is_slowed_down_whatever_the_vertical_bound() -> None:
    flown = plan(Reference(0.0, (26.0, 0.0, -5.0)), GOAL, LIMITS, GuidanceParameters())
    gentle = replace(LIMITS, vertical_acceleration_m_s2=0.1)
    assert slow_down(flown, FROM_S, gentle).end_s == slow_down(flown, FROM_S, LIMITS).end_s
