"""Time-optimal motion with bounded jerk (ruckig; Berscheid and Kröger 2021), as plans: to a goal, or to a hover.

The horizontal axes are turned into the direction of travel. Ruckig bounds each axis by itself; when the start moves or
accelerates sideways, along and across share the bound so that the length of the vector keeps it, and what comes out
is checked. Now and then no sharing fits a start at its limits: then there is no such plan.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from math import atan2, hypot, inf, sqrt

import ruckig

from daemon.frames import add, clamp, norm, rotate_about_down, wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan, straights
from daemon.messages import ZERO3, Reference, Vec3

_SIDEWAYS = 1e-7  # m/s and m/s^2 of the start across the direction of travel that count as none
_ACROSS_SHARES = (0.6, 0.3, 0.85)  # of the bounds, tried in turn
_CHECKS = 120  # instants, denser near the start, at which a motion that moves sideways is checked
_PLANNED, _CHECKED = 0.998, 0.999  # of the bounds, when moving sideways: the check does not see between its instants
_JERK_SPACING_S = 1e-4  # jerk is constant but for six instants: the difference over this time


@dataclass(frozen=True, slots=True, kw_only=True)
class _Motion:
    """What ruckig found: x along ``heading_rad``, y across, z down, yaw unwrapped, relative to ``origin_ned_m``."""

    trajectory: ruckig.Trajectory
    heading_rad: float
    origin_ned_m: Vec3


class JerkLimitedPlan(Plan):
    """A motion that ruckig solved, from ``start_s`` on."""

    def __init__(self, start_s: float, motion: _Motion, limits: MotionLimits, goal: tuple[Vec3, float] | None) -> None:
        self.start_s = start_s
        self._motion = motion
        self._limits = limits
        self._goal = goal
        self._end_s = start_s + float(motion.trajectory.duration)
        self._target = _at(motion, motion.trajectory.duration, self._end_s, at_rest=True)
        if goal is not None:
            self._target = replace(self._target, position_ned_m=goal[0], yaw_rad=wrap_pi(goal[1]))

    @property
    def end_s(self) -> float:
        """When the motion ends."""
        return self._end_s

    @property
    def target(self) -> Reference:
        """Rest at the end of the motion."""
        return self._target

    def sample(self, time_s: float) -> Reference:
        """The motion at a time."""
        if time_s >= self._end_s:
            return replace(self._target, time_s=time_s)
        return _at(self._motion, max(0.0, time_s - self.start_s), time_s)

    def polyline(self) -> Iterator[Vec3]:
        """From rest a straight way; else each stretch of constant jerk by its acceleration, largest at one end."""
        start = self.sample(self.start_s)
        yield start.position_ned_m
        if (start.velocity_ned_m_s, start.acceleration_ned_m_s2) != (ZERO3, ZERO3):
            for begin, end in pairwise(map(self.sample, self._bends_s())):
                largest = max(norm(begin.acceleration_ned_m_s2), norm(end.acceleration_ned_m_s2))
                lasts_s = end.time_s - begin.time_s
                count = straights(lasts_s, largest)
                for i in range(1, count + 1):
                    yield self.sample(begin.time_s + lasts_s * i / count).position_ned_m
        yield self._target.position_ned_m

    def _bends_s(self) -> list[float]:
        """Start, end, and the instants between at which the jerk along an axis changes."""
        lasts_s = float(self._motion.trajectory.duration)
        changes_s = {0.0, lasts_s}
        for axis in self._motion.trajectory.profiles[0][:3]:
            changes_s.update(accumulate((*axis.brake.t, *axis.t, *axis.accel.t)))
        return [self.start_s + since_s for since_s in sorted(changes_s) if since_s <= lasts_s]

    def shifted(self, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> Plan:
        """Moved with the estimate; after a velocity jump solved anew from the shifted state to the same goal."""
        if dv_ned_m_s != ZERO3 and self._goal is not None:
            now = self.sample(at_s)
            start = replace(
                now,
                position_ned_m=add(now.position_ned_m, dp_ned_m),
                velocity_ned_m_s=add(now.velocity_ned_m_s, dv_ned_m_s),
                yaw_rad=wrap_pi(now.yaw_rad + dyaw_rad),
            )
            plan = to_goal(start, add(self._goal[0], dp_ned_m), self._goal[1] + dyaw_rad, self._limits)
            if plan is not None:
                return plan
        return super().shifted(dp_ned_m, dv_ned_m_s, dyaw_rad, at_s)


def to_goal(start: Reference, position_ned_m: Vec3, yaw_rad: float, limits: MotionLimits) -> JerkLimitedPlan | None:
    """The quickest motion from a flown reference to rest at a goal, heading the shorter way; None if there is none."""
    north = position_ned_m[0] - start.position_ned_m[0]
    east = position_ned_m[1] - start.position_ned_m[1]
    heading = atan2(east, north) if hypot(north, east) > 0.0 else _travel_heading(start)
    down = position_ned_m[2] - start.position_ned_m[2]
    turn = wrap_pi(yaw_rad - start.yaw_rad)
    for wanted in _inputs(start, heading, limits):
        wanted.target_position = [hypot(north, east), 0.0, down, start.yaw_rad + turn]
        wanted.synchronization = ruckig.Synchronization.Phase
        wanted.per_dof_synchronization = [ruckig.Synchronization.Phase] * 3 + [ruckig.Synchronization.No]
        trajectory = _solve(wanted)
        if trajectory is not None and _keeps(wanted, trajectory, start, limits):
            motion = _Motion(trajectory=trajectory, heading_rad=heading, origin_ned_m=start.position_ned_m)
            return JerkLimitedPlan(start.time_s, motion, limits, (position_ned_m, yaw_rad))
    return None


def to_hover(start: Reference, limits: MotionLimits) -> JerkLimitedPlan | None:
    """The quickest motion from a flown reference to rest, wherever that is; None only if the start is not finite.

    A start at the corner of its limits may pass them by some percent on the way: stopping comes first.
    """
    heading = _travel_heading(start)
    unchecked = None
    for wanted in _inputs(start, heading, limits):
        wanted.control_interface = ruckig.ControlInterface.Velocity
        wanted.synchronization = ruckig.Synchronization.No
        trajectory = _solve(wanted)
        if trajectory is None:
            continue
        motion = _Motion(trajectory=trajectory, heading_rad=heading, origin_ned_m=start.position_ned_m)
        if _keeps(wanted, trajectory, start, limits):
            return JerkLimitedPlan(start.time_s, motion, limits, None)
        unchecked = motion
    return None if unchecked is None else JerkLimitedPlan(start.time_s, unchecked, limits, None)


def _travel_heading(start: Reference) -> float:
    """Direction of the start's motion; of its acceleration when it does not move."""
    for x, y, _ in (start.velocity_ned_m_s, start.acceleration_ned_m_s2):
        if hypot(x, y) > _SIDEWAYS:
            return atan2(y, x)
    return 0.0


def _inputs(start: Reference, heading: float, limits: MotionLimits) -> Iterator[ruckig.InputParameter]:
    """The start in the turned axes with bounds on each axis, in the order in which to try them."""
    velocity = rotate_about_down(start.velocity_ned_m_s, -heading)
    acceleration = rotate_about_down(start.acceleration_ned_m_s2, -heading)
    if max(abs(velocity[1]), abs(acceleration[1])) < _SIDEWAYS:
        # what is left across would be taken out with the whole jerk, on top of the one along
        velocity, acceleration = (velocity[0], 0.0, velocity[2]), (acceleration[0], 0.0, acceleration[2])
        yield _input(velocity, acceleration, start, limits, (0.0, 0.0, 0.0))
        return
    for share in _ACROSS_SHARES:
        speed = _across_share(share, velocity[0] / limits.speed_m_s, velocity[1] / limits.speed_m_s)
        limit = limits.acceleration_m_s2
        yield _input(
            velocity,
            acceleration,
            start,
            limits,
            (speed, _across_share(share, acceleration[0] / limit, acceleration[1] / limit), 0.6),
        )


def _across_share(wanted: float, along: float, across: float) -> float:
    """The share across nearest to the wanted one that leaves room for the start on both axes."""
    most = sqrt(max(0.0, 1.0 - along * along))
    return clamp(wanted, min(abs(across), 0.95), max(most, 0.05))


def _input(
    velocity: Vec3, acceleration: Vec3, start: Reference, limits: MotionLimits, across: Vec3
) -> ruckig.InputParameter:
    """Ruckig's input; ``across`` are the shares of speed, acceleration and jerk, zero for a straight way."""
    along = [sqrt(1.0 - share * share) for share in across]
    sideways = [share if share > 0.0 else 1.0 for share in across]
    planned = _PLANNED if any(across) else 1.0
    speed, limit, jerk = planned * limits.speed_m_s, planned * limits.acceleration_m_s2, limits.jerk_m_s3
    found = ruckig.InputParameter(4)
    found.current_position = [0.0, 0.0, 0.0, start.yaw_rad]
    found.current_velocity = [*velocity, start.yaw_rate_rad_s]
    found.current_acceleration = [*acceleration, 0.0]
    found.max_velocity = [along[0] * speed, sideways[0] * speed, limits.descent_m_s, limits.yaw_rate_rad_s]
    found.min_velocity = [-along[0] * speed, -sideways[0] * speed, -limits.climb_m_s, -limits.yaw_rate_rad_s]
    vertical, yaw = limits.vertical_acceleration_m_s2, limits.yaw_acceleration_rad_s2
    found.max_acceleration = [along[1] * limit, sideways[1] * limit, vertical, yaw]
    found.max_jerk = [along[2] * jerk, sideways[2] * jerk, jerk, inf]
    return found


def _solve(wanted: ruckig.InputParameter) -> ruckig.Trajectory | None:
    trajectory = ruckig.Trajectory(4)
    try:
        result = ruckig.Ruckig(4).calculate(wanted, trajectory)
    except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding has no name for
        return None
    return trajectory if result in (ruckig.Result.Working, ruckig.Result.Finished) else None


def _keeps(
    wanted: ruckig.InputParameter, trajectory: ruckig.Trajectory, start: Reference, limits: MotionLimits
) -> bool:
    """Whether the lengths of the horizontal vectors keep the limits, or what the start already asks for."""
    if wanted.current_velocity[1] == 0.0 and wanted.current_acceleration[1] == 0.0:
        return True
    (vx, vy, _), (ax, ay, _) = start.velocity_ned_m_s, start.acceleration_ned_m_s2
    taken_back_s = 0.5 * hypot(ax, ay) / limits.jerk_m_s3
    coming = hypot(vx + ax * taken_back_s, vy + ay * taken_back_s)
    allowed_speed = max(_CHECKED * limits.speed_m_s, hypot(vx, vy), coming) + 1e-9
    allowed = max(_CHECKED * limits.acceleration_m_s2, hypot(ax, ay)) + 1e-9
    for i in range(_CHECKS):
        _, v, a = trajectory.at_time((i / _CHECKS) ** 2 * trajectory.duration)
        if hypot(v[0], v[1]) > allowed_speed or hypot(a[0], a[1]) > allowed:
            return False
    return True


def _at(motion: _Motion, since_s: float, time_s: float, at_rest: bool = False) -> Reference:
    """The motion ``since_s`` after its start, in NED."""
    p, v, a = motion.trajectory.at_time(since_s)
    position = add(rotate_about_down((p[0], p[1], p[2]), motion.heading_rad), motion.origin_ned_m)
    if at_rest:
        return Reference(time_s=time_s, position_ned_m=position, yaw_rad=wrap_pi(p[3]))
    later = motion.trajectory.at_time(since_s + _JERK_SPACING_S)[2]
    jerk = tuple((after - now) / _JERK_SPACING_S for now, after in zip(a[:3], later, strict=False))
    return Reference(
        time_s=time_s,
        position_ned_m=position,
        velocity_ned_m_s=rotate_about_down((v[0], v[1], v[2]), motion.heading_rad),
        acceleration_ned_m_s2=rotate_about_down((a[0], a[1], a[2]), motion.heading_rad),
        jerk_ned_m_s3=rotate_about_down((jerk[0], jerk[1], jerk[2]), motion.heading_rad),
        yaw_rad=wrap_pi(p[3]),
        yaw_rate_rad_s=v[3],
    )
