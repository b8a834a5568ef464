"""Coming to rest along the way of a plan, where the straight way out of it is not free."""

from collections.abc import Iterator
from dataclasses import replace
from math import hypot, sqrt

from daemon.frames import add, norm, scale
from daemon.guidance.limits import MotionLimits, share_of_limits
from daemon.guidance.plan import Plan, straights
from daemon.guidance.shapes import smooth_step
from daemon.messages import Reference, Vec3

_LOOKS = 30  # instants at which the slowing down is held against the limits,
_LONGER = 1.2  # factor by which it grows while it asks for too much,
_LENGTHENINGS = 12  # and how often at most
_SLACK = 1.01


class SlowedPlan(Plan):
    """A plan whose time runs ever slower from ``from_s`` on and stands still ``slowing_s`` later."""

    def __init__(self, plan: Plan, from_s: float, slowing_s: float, acceleration_m_s2: float) -> None:
        self.start_s = from_s
        self._plan = plan
        self._slowing_s = slowing_s
        self._acceleration_m_s2 = acceleration_m_s2  # of the plan, at most
        self._rest: Reference | None = None

    @property
    def end_s(self) -> float:
        """When its time stands still."""
        return self.start_s + self._slowing_s

    @property
    def target(self) -> Reference:
        """The place on the plan's way, at rest: foreseen on the path, and known once the end has been flown."""
        return self._rest or replace(self.path.sample(self.end_s), yaw_rad=self._plan.target.yaw_rad)

    @property
    def path(self) -> Plan:
        """The plan's path, slowed."""
        return SlowedPlan(self._plan.path, self.start_s, self._slowing_s, self._acceleration_m_s2)

    def polyline(self) -> Iterator[Vec3]:
        """The plan's way by its acceleration; half of the slowing goes by in the plan's own time."""
        own_s = 0.5 * self._slowing_s
        count = straights(own_s, self._acceleration_m_s2)
        for i in range(count + 1):
            yield self._plan.sample(self.start_s + own_s * i / count).position_ned_m

    def sample(self, time_s: float) -> Reference:
        """The plan at its own time, derivatives by the chain rule."""
        lasts_s = self._slowing_s
        s = min(max(0.0, (time_s - self.start_s) / lasts_s), 1.0)
        area, height, slope, bend = smooth_step(s)
        r = self._plan.sample(self.start_s + lasts_s * (s - area))
        rate, rate1, rate2 = 1.0 - height, -slope / lasts_s, -bend / lasts_s**2
        v, a = r.velocity_ned_m_s, r.acceleration_ned_m_s2
        jerk = add(scale(r.jerk_ned_m_s3, rate**3), scale(a, 3.0 * rate * rate1))
        slowed = replace(
            r,
            time_s=time_s,
            velocity_ned_m_s=scale(v, rate),
            acceleration_ned_m_s2=add(scale(a, rate * rate), scale(v, rate1)),
            jerk_ned_m_s3=add(jerk, scale(v, rate2)),
            yaw_rate_rad_s=r.yaw_rate_rad_s * rate,
        )
        if s >= 1.0:
            self._rest = replace(slowed, time_s=self.end_s)
        return slowed


def slow_down(plan: Plan, from_s: float, limits: MotionLimits) -> SlowedPlan:
    """The plan brought to rest along its own way, as quickly as its bends leave acceleration and jerk for.

    Where the plan is beyond the limits to begin with, it comes back into them no farther than that.
    """
    path, most_m_s2 = plan.path, hypot(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2)

    def share(r: Reference) -> float:
        return share_of_limits(r.velocity_ned_m_s, r.acceleration_ned_m_s2, r.jerk_ned_m_s3, limits)

    start = path.sample(from_s)
    speed, allowed = norm(start.velocity_ned_m_s), _SLACK * max(1.0, share(start))
    least_m_s2 = min(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2)
    ahead_s = speed / least_m_s2  # of the plan's own time, with the least bound in each direction
    ahead = [path.sample(from_s + ahead_s * i / _LOOKS).velocity_ned_m_s for i in range(_LOOKS + 1)]
    across_s = max(hypot(vx, vy) for vx, vy, _ in ahead) / limits.acceleration_m_s2
    down_s = max(abs(vz) for _, _, vz in ahead) / limits.vertical_acceleration_m_s2
    slowing_s = max(2.0 * min(ahead_s, max(across_s, down_s)), sqrt(12.0 * speed / limits.jerk_m_s3), 0.1)
    for _ in range(_LENGTHENINGS):
        slowed = SlowedPlan(path, from_s, slowing_s, most_m_s2)
        if all(share(slowed.sample(from_s + slowing_s * i / _LOOKS)) <= allowed for i in range(1, _LOOKS)):
            break
        slowing_s *= _LONGER
    return SlowedPlan(plan, from_s, slowing_s, most_m_s2)
