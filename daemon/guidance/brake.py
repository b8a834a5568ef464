"""Braking from a flown reference to a hover, as quickly as the limits allow."""

from daemon.frames import add, norm, scale
from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.jerk_limited import to_hover
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.messages import Reference


def brake(start: Reference, limits: MotionLimits) -> Plan:
    """The plan that brings a moving reference to rest along the limits and holds it where it stops.

    ``plan.target`` is the stopping place. About 20 us; position, velocity and acceleration continue the start's.
    """
    plan = to_hover(start, limits)
    if plan is not None:
        return plan
    speed = norm(start.velocity_ned_m_s)
    ahead = scale(start.velocity_ned_m_s, 0.5 * speed / limits.acceleration_m_s2)
    return FilterPlan(start, add(start.position_ned_m, ahead), start.yaw_rad, limits, GuidanceParameters())
