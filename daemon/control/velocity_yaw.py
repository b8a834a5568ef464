"""Heading along the velocity of the reference."""

from math import atan2, hypot

from daemon.messages import Vec3


def heading(
    velocity_ned_m_s: Vec3, acceleration_ned_m_s2: Vec3, heading_rad: float, *, minimum_m_s: float
) -> tuple[float, float]:
    """Yaw (rad) along the horizontal velocity and its rate (rad/s); below the minimum speed ``heading_rad`` and zero.

    The dead-band keeps a hovering vehicle from following noise, and bounds the rate by acceleration over speed.
    """
    vx, vy, _ = velocity_ned_m_s
    speed = hypot(vx, vy)
    if speed <= minimum_m_s or speed == 0.0:
        return heading_rad, 0.0
    rate = (vx * acceleration_ned_m_s2[1] - vy * acceleration_ned_m_s2[0]) / (speed * speed)
    return atan2(vy, vx), rate
