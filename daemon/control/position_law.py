"""Position law: position and velocity error to acceleration."""

from math import hypot

from daemon.frames import clamp
from daemon.messages import Vec3


def feedback(
    position_error_ned_m: Vec3,
    velocity_error_ned_m_s: Vec3,
    position_gain_1_s2: Vec3,
    velocity_gain_1_s: Vec3,
    *,
    approach_max_m_s: float,
    feedback_max_m_s2: float,
) -> Vec3:
    """Feedback acceleration, m/s2 NED; errors are measured minus reference.

    The position term saturates where, with the velocity term against it, it would approach a far reference faster
    than ``approach_max_m_s``; the sum saturates at ``feedback_max_m_s2``. Both horizontally by norm, and vertically, so
    that no error sideways takes feedback from height.
    """
    kp, kv = position_gain_1_s2, velocity_gain_1_s
    ex, ey, ez = position_error_ned_m
    px, py, pz = kp[0] * ex, kp[1] * ey, kp[2] * ez
    horizontal, limit = hypot(px, py), approach_max_m_s * min(kv[0], kv[1])
    if horizontal > limit:
        px, py = px * limit / horizontal, py * limit / horizontal
    limit = approach_max_m_s * kv[2]
    pz = clamp(pz, -limit, limit)
    vx, vy, vz = velocity_error_ned_m_s
    x, y, z = -px - kv[0] * vx, -py - kv[1] * vy, -pz - kv[2] * vz
    horizontal = hypot(x, y)
    if horizontal > feedback_max_m_s2:
        x, y = x * feedback_max_m_s2 / horizontal, y * feedback_max_m_s2 / horizontal
    return (x, y, clamp(z, -feedback_max_m_s2, feedback_max_m_s2))
