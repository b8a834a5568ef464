"""Turning a horizontal velocity towards a goal without stopping, in closed form.

From a start that does not accelerate, a change of velocity along one direction with bounded acceleration and jerk is
symmetric in time: its mean velocity is half the sum of both. Between the two velocities speed is nowhere larger than at
one of them, and acceleration and jerk have the whole bounds, as lengths of vectors. All here is north and east, SI.
"""

from math import atan2, cos, hypot, sin, sqrt

from daemon.frames import wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.messages import Reference

Level = tuple[float, float]  # north, east

_DAMPING = 0.7  # of the steps towards the direction looked for: undamped they may swing about it
_TRIES = 40
_MET_RAD = 1e-12


def unaccelerated(start: Reference, limits: MotionLimits) -> Level:
    """The velocity of a start once its acceleration has been taken back along itself with the whole jerk."""
    (vx, vy, _), (ax, ay, _) = start.velocity_ned_m_s, start.acceleration_ned_m_s2
    half_s = 0.5 * hypot(ax, ay) / limits.jerk_m_s3
    return vx + ax * half_s, vy + ay * half_s


def velocity_towards(velocity: Level, to_goal: Level, speed: float, limits: MotionLimits) -> Level | None:
    """The velocity of a speed with which the goal lies straight ahead when it is reached; None if none is found."""
    (vx, vy), (x, y) = velocity, to_goal
    heading = atan2(y, x)
    for _ in range(_TRIES):
        wx, wy = speed * cos(heading), speed * sin(heading)
        half_s = 0.5 * _change_s(hypot(wx - vx, wy - vy), limits)
        off = wrap_pi(atan2(y - half_s * (vy + wy), x - half_s * (vx + wx)) - heading)
        if abs(off) < _MET_RAD:
            return wx, wy
        heading += _DAMPING * off
    return None


def _change_s(change_m_s: float, limits: MotionLimits) -> float:
    most, jerk = limits.acceleration_m_s2, limits.jerk_m_s3
    return change_m_s / most + most / jerk if change_m_s * jerk >= most * most else 2.0 * sqrt(change_m_s / jerk)
