"""Braking from a flown reference to a hover, as quickly as the limits allow."""

from math import isfinite

from daemon.frames import is_finite
from daemon.guidance.jerk_limited import to_hover
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import HoldPlan, Plan
from daemon.messages import ZERO3, Reference


def brake(start: Reference, limits: MotionLimits) -> Plan:
    """The plan that brings a moving reference to rest along the limits and holds it where it stops.

    ``plan.target`` is the stopping place. About 20 us, up to 0.4 ms when the start moves and accelerates in different
    directions; position, velocity and acceleration continue the start's, and limits that it can keep are kept. What is
    not finite of them counts as zero, a position apart; a motion beyond all reason is not braked but left: rest in the
    start's place.
    """
    flown = Reference(
        time_s=start.time_s,
        position_ned_m=start.position_ned_m,
        velocity_ned_m_s=start.velocity_ned_m_s if is_finite(start.velocity_ned_m_s) else ZERO3,
        acceleration_ned_m_s2=start.acceleration_ned_m_s2 if is_finite(start.acceleration_ned_m_s2) else ZERO3,
        yaw_rad=start.yaw_rad if isfinite(start.yaw_rad) else 0.0,
        yaw_rate_rad_s=start.yaw_rate_rad_s if isfinite(start.yaw_rate_rad_s) else 0.0,
    )
    return to_hover(flown, limits) or HoldPlan(flown)
