"""Braking from a flown reference to a hover, as quickly as the limits allow."""

from daemon.guidance.jerk_limited import to_hover
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import HoldPlan, Plan
from daemon.messages import Reference


def brake(start: Reference, limits: MotionLimits) -> Plan:
    """The plan that brings a moving reference to rest along the limits and holds it where it stops.

    ``plan.target`` is the stopping place. About 20 us, up to 0.3 ms when the start moves and accelerates in different
    directions; position, velocity and acceleration continue the start's. From a start that is not finite: its place.
    """
    return to_hover(start, limits) or HoldPlan(start)
