"""Turning a velocity towards a goal: where the turn ends, by ruckig's time for the same change."""

from math import atan2, cos, degrees, hypot, sin

import numpy as np
import pytest
import ruckig
from hypothesis import given
from hypothesis import strategies as st

from daemon.frames import wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.guidance.velocity_turn import unaccelerated, velocity_towards
from daemon.messages import Reference


def change_s(change_m_s: float, limits: MotionLimits) -> float:
    """Oracle: the quickest change of a velocity along one direction."""
    wanted = ruckig.InputParameter(1)
    wanted.control_interface = ruckig.ControlInterface.Velocity
    wanted.target_velocity = [change_m_s]
    wanted.max_acceleration, wanted.max_jerk = [limits.acceleration_m_s2], [limits.jerk_m_s3]
    trajectory = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(wanted, trajectory) in (ruckig.Result.Working, ruckig.Result.Finished)
    return float(trajectory.duration)


@given(
    speed=st.floats(0.5, 5.0),
    share=st.floats(0.2, 1.0),
    course=st.floats(-3.0, 3.0),
    bearing=st.floats(-3.0, 3.0),
    distance=st.floats(25.0, 80.0),
    acceleration=st.sampled_from([1.5, 3.0, 6.0]),
    jerk=st.sampled_from([4.0, 8.0, 30.0]),
)
def test_when_the_change_is_done_the_goal_lies_straight_ahead_at_the_speed_wanted(
    speed: float, share: float, course: float, bearing: float, distance: float, acceleration: float, jerk: float
) -> None:
    limits = MotionLimits(acceleration_m_s2=acceleration, jerk_m_s3=jerk)
    velocity = speed * cos(course), speed * sin(course)
    goal = distance * cos(bearing), distance * sin(bearing)
    found = velocity_towards(velocity, goal, share * speed, limits)
    assert found is not None
    assert hypot(*found) == pytest.approx(share * speed)
    half_s = 0.5 * change_s(hypot(found[0] - velocity[0], found[1] - velocity[1]), limits)
    ahead = [g - half_s * (a + b) for g, a, b in zip(goal, velocity, found, strict=True)]
    assert abs(degrees(wrap_pi(atan2(ahead[1], ahead[0]) - atan2(found[1], found[0])))) < 1e-6


def test_a_goal_within_the_turn_has_no_direction_to_be_met_in() -> None:
    limits = MotionLimits()
    assert velocity_towards((5.0, 0.0), (1.0, 0.5), 5.0, limits) is None


@pytest.mark.parametrize("acceleration", [(2.0, 0.0), (-1.0, 1.5)])
def test_an_acceleration_is_taken_back_with_the_whole_jerk(acceleration: tuple[float, float]) -> None:
    """Oracle: the acceleration, a straight line down to nothing, summed."""
    limits = MotionLimits(jerk_m_s3=5.0)
    end_s = hypot(*acceleration) / 5.0
    left = np.linspace(1.0, 0.0, 1001)
    north, east = (v + np.trapezoid(a * left, dx=end_s / 1000) for v, a in zip((3.0, -1.0), acceleration, strict=True))
    start = Reference(
        time_s=0.0,
        position_ned_m=(0.0, 0.0, -5.0),
        velocity_ned_m_s=(3.0, -1.0, 0.4),
        acceleration_ned_m_s2=(*acceleration, 0.3),
    )
    assert unaccelerated(start, limits) == pytest.approx((north, east))
