"""Position law: position and velocity error to acceleration."""

from math import hypot

from daemon.frames import clip_norm
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
    than ``approach_max_m_s`` (horizontally by norm, vertically); the sum saturates by norm.
    """
    kp, kv = position_gain_1_s2, velocity_gain_1_s
    ex, ey, ez = position_error_ned_m
    px, py, pz = kp[0] * ex, kp[1] * ey, kp[2] * ez
    horizontal, limit = hypot(px, py), approach_max_m_s * min(kv[0], kv[1])
    if horizontal > limit:
        px, py = px * limit / horizontal, py * limit / horizontal
    limit = approach_max_m_s * kv[2]
    pz = max(-limit, min(limit, pz))
    vx, vy, vz = velocity_error_ned_m_s
    return clip_norm((-px - kv[0] * vx, -py - kv[1] * vy, -pz - kv[2] * vz), feedback_max_m_s2)
