"""How a goal is stopped unasked for: the quickest way that stays within the fence, if there is one."""

from daemon.frames import norm, subtract
from daemon.guidance.brake import brake
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.guidance.reachability import Reach, way_refusal
from daemon.guidance.slowed_plan import slow_down
from daemon.messages import Reference
from daemon.safety.geofence import Geofence, between, violation

_SAME_M = 0.01  # between a plan and what is flown of it


def reach_of(fence: Geofence, limits: MotionLimits, max_distance_m: float = 1000.0) -> Reach:
    """What a plan is held against within a fence."""
    return Reach(
        limits=limits,
        fence=lambda position: violation(fence, position),
        between=lambda start, end: between(fence, start, end),
        max_distance_m=max_distance_m,
    )


def stopping(flown: Reference, flying: Plan | None, limits: MotionLimits, fence: Geofence) -> Plan:
    """A brake; where that leaves the fence, slowing down along the plan that is flown, whose way has been looked at.

    Where that leaves it too, or the vehicle is not on that plan, the brake: then nothing is nearer.
    """
    reach = reach_of(fence, limits)
    stopped = brake(flown, limits)
    if flying is None or way_refusal(stopped, "", reach) is None:
        return stopped
    if norm(subtract(flying.sample(flown.time_s).position_ned_m, flown.position_ned_m)) > _SAME_M:
        return stopped
    slowed = slow_down(flying, flown.time_s, limits)
    return stopped if way_refusal(slowed, "", reach) else slowed
