"""Coming to rest along the way of a plan, where the straight way out of it is not free."""

from dataclasses import replace
from math import sqrt

from daemon.frames import add, norm, scale
from daemon.guidance.limits import MotionLimits, share_of_limits
from daemon.guidance.plan import Plan
from daemon.guidance.shapes import smooth_step
from daemon.messages import Reference

_LOOKS = 30  # instants at which the slowing down is held against the limits,
_LONGER = 1.2  # factor by which it grows while it asks for too much,
_LENGTHENINGS = 12  # and how often at most
_SLACK = 1.01


class SlowedPlan(Plan):
    """A plan whose time runs ever slower from ``from_s`` on and stands still ``slowing_s`` later."""

    def __init__(self, plan: Plan, from_s: float, slowing_s: float) -> None:
        self.start_s = from_s
        self._plan = plan
        self._slowing_s = slowing_s

    @property
    def end_s(self) -> float:
        """When its time stands still."""
        return self.start_s + self._slowing_s

    @property
    def target(self) -> Reference:
        """The place on the plan's way, at rest."""
        return self.sample(self.end_s)

    @property
    def path(self) -> Plan:
        """The plan's path, slowed."""
        return SlowedPlan(self._plan.path, self.start_s, self._slowing_s)

    def sample(self, time_s: float) -> Reference:
        """The plan at its own time, derivatives by the chain rule."""
        lasts_s = self._slowing_s
        s = min(max(0.0, (time_s - self.start_s) / lasts_s), 1.0)
        area, height, slope, bend = smooth_step(s)
        r = self._plan.sample(self.start_s + lasts_s * (s - area))
        rate, rate1, rate2 = 1.0 - height, -slope / lasts_s, -bend / lasts_s**2
        v, a = r.velocity_ned_m_s, r.acceleration_ned_m_s2
        jerk = add(scale(r.jerk_ned_m_s3, rate**3), scale(a, 3.0 * rate * rate1))
        return replace(
            r,
            time_s=time_s,
            velocity_ned_m_s=scale(v, rate),
            acceleration_ned_m_s2=add(scale(a, rate * rate), scale(v, rate1)),
            jerk_ned_m_s3=add(jerk, scale(v, rate2)),
            yaw_rate_rad_s=r.yaw_rate_rad_s * rate,
        )


def slow_down(plan: Plan, from_s: float, limits: MotionLimits) -> SlowedPlan:
    """The plan brought to rest along its own way, as quickly as its bends leave acceleration and jerk for."""
    speed = norm(plan.path.sample(from_s).velocity_ned_m_s)
    least_m_s2 = min(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2)
    slowing_s = max(2.0 * speed / least_m_s2, sqrt(12.0 * speed / limits.jerk_m_s3), 0.1)
    for _ in range(_LENGTHENINGS):
        slowed = SlowedPlan(plan.path, from_s, slowing_s)
        looks = (slowed.sample(from_s + slowing_s * i / _LOOKS) for i in range(1, _LOOKS))
        shares = (share_of_limits(r.velocity_ned_m_s, r.acceleration_ned_m_s2, r.jerk_ned_m_s3, limits) for r in looks)
        if max(shares) <= _SLACK:
            break
        slowing_s *= _LONGER
    return SlowedPlan(plan, from_s, slowing_s)
