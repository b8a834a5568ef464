"""How a goal is stopped unasked for: the quickest way that stays within the fence, if there is one."""

from math import ceil

from daemon.frames import add, norm, subtract, wrap_pi
from daemon.guidance import reference_window
from daemon.guidance.brake import brake
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.guidance.reachability import Reach, way_refusal
from daemon.guidance.slowed_plan import SlowedPlan, slow_down
from daemon.messages import ZERO3, Reference
from daemon.safety.geofence import Geofence, between, excess_m, violation

_SAME_M = 0.01  # between a plan and what is flown of it
_SPACING_S = 0.1  # of a stop that is foreseen,
_MOST_PLACES = 50  # which is longer where it would take more of them


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


def way_to_rest(last: Reference, flying: Plan, limits: MotionLimits, fence: Geofence) -> tuple[Reference, ...]:
    """How to come to rest from the last of what is told of a plan; none where a brake does, or nothing does.

    It is the plan's path, cheap to look at ahead: by how much the plan is off there goes out of it on the way. The
    heading turns on ever more slowly.
    """
    if excess_m(fence, last.position_ned_m) < -_brake_most_m(last, limits):
        return ()
    stop = stopping(last, flying, limits, fence)
    if not isinstance(stop, SlowedPlan):
        return ()
    path, lasts_s = stop.path, stop.end_s - last.time_s
    begin = path.sample(last.time_s)
    off = Reference(
        last.time_s,
        subtract(last.position_ned_m, begin.position_ned_m),
        subtract(last.velocity_ned_m_s, begin.velocity_ned_m_s),
        subtract(last.acceleration_ned_m_s2, begin.acceleration_ned_m_s2),
    )
    none = Reference(stop.end_s, ZERO3)
    count = min(_MOST_PLACES, ceil(lasts_s / _SPACING_S))
    places = []
    for share in (i / count for i in range(1, count + 1)):
        time_s = last.time_s + share * lasts_s
        on, still_off = path.sample(time_s), reference_window.between(off, none, time_s)
        turned_rad = last.yaw_rate_rad_s * lasts_s * (share - 0.5 * share * share)
        place = Reference(
            time_s,
            add(on.position_ned_m, still_off.position_ned_m),
            add(on.velocity_ned_m_s, still_off.velocity_ned_m_s),
            add(on.acceleration_ned_m_s2, still_off.acceleration_ned_m_s2),
            ZERO3,
            wrap_pi(last.yaw_rad + turned_rad),
            last.yaw_rate_rad_s * (1.0 - share),
        )
        places.append(place)
    return tuple(places)


def _brake_most_m(start: Reference, limits: MotionLimits) -> float:
    """More than the way of a brake: twice what it takes when the start accelerates ahead, with the least bounds."""
    least, pushed = min(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2), norm(start.acceleration_ned_m_s2)
    speed = norm(start.velocity_ned_m_s) + 0.5 * pushed * pushed / limits.jerk_m_s3
    return 2.0 * speed * (pushed / limits.jerk_m_s3 + speed / least + least / limits.jerk_m_s3)
