"""Coming to rest along the way of a plan."""

from math import dist, hypot
from types import SimpleNamespace

import pytest

from daemon.guidance.goals import ShapeGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.planner import plan
from daemon.guidance.shapes import Circle
from daemon.guidance.slowed_plan import slow_down
from daemon.messages import Reference

LIMITS = MotionLimits(acceleration_m_s2=1.0)
GOAL = ShapeGoal(shape=Circle(center_ned_m=(0.0, 0.0, -5.0), radius_m=26.0), speed_m_s=5.0, turns=3.0)
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
