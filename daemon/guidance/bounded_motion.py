"""One motion with bounded jerk that ruckig solves (Berscheid and Kröger 2021), in axes turned about the vertical.

Ruckig bounds each axis by itself. When the start moves or accelerates sideways, along and across share the bounds so
that the length of the vector keeps them, and what comes out is checked. Now and then no sharing fits a start at its
limits; such a one can have its acceleration taken back first.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from math import atan2, hypot, inf, sqrt

import ruckig

from daemon.frames import add, clamp, rotate_about_down, wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.messages import Reference, Vec3

_SIDEWAYS = 1e-7  # m/s and m/s^2 across the direction of travel that count as none
_ACROSS_SHARES = (0.6, 0.3, 0.85)  # of the bound on acceleration, tried in turn
_LEAST_SPEED_SHARE = 0.1  # across: for the way back to the line
_JERK_SHARE = 0.6
_CHECKS = 120  # instants, denser near the start, at which a motion that moves sideways is checked
_PLANNED, _CHECKED = 0.998, 0.999  # of the bounds, when moving sideways: the check does not see between its instants
_JERK_SPACING_S = 1e-4  # jerk is constant but for six instants: the difference over this time


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What ruckig found, as far as it is flown: x along ``heading_rad``, y across, z down, yaw unwrapped."""

    trajectory: ruckig.Trajectory
    heading_rad: float
    origin_ned_m: Vec3
    start_s: float
    duration_s: float

    @property
    def end_s(self) -> float:
        """When what is flown of it ends."""
        return self.start_s + self.duration_s

    def at(self, time_s: float) -> Reference:
        """The motion at a time, in NED; before the start the start's."""
        since_s = max(0.0, time_s - self.start_s)
        p, v, a = self.trajectory.at_time(since_s)
        later = self.trajectory.at_time(since_s + _JERK_SPACING_S)[2]
        jerk = tuple((after - now) / _JERK_SPACING_S for now, after in zip(a[:3], later, strict=False))
        return Reference(
            time_s=time_s,
            position_ned_m=self._placed(p),
            velocity_ned_m_s=rotate_about_down((v[0], v[1], v[2]), self.heading_rad),
            acceleration_ned_m_s2=rotate_about_down((a[0], a[1], a[2]), self.heading_rad),
            jerk_ned_m_s3=rotate_about_down((jerk[0], jerk[1], jerk[2]), self.heading_rad),
            yaw_rad=wrap_pi(p[3]),
            yaw_rate_rad_s=v[3],
        )

    def rest(self) -> Reference:
        """Rest at the end."""
        p, _, _ = self.trajectory.at_time(self.duration_s)
        return Reference(time_s=self.end_s, position_ned_m=self._placed(p), yaw_rad=wrap_pi(p[3]))

    def bends_s(self) -> list[float]:
        """Start, end, and the instants between at which the jerk along an axis changes."""
        changes_s = {0.0, self.duration_s}
        for axis in self.trajectory.profiles[0][:3]:
            changes_s.update(accumulate((*axis.brake.t, *axis.t, *axis.accel.t)))
        return [self.start_s + since_s for since_s in sorted(changes_s) if since_s <= self.duration_s]

    def _placed(self, p: list[float]) -> Vec3:
        return add(rotate_about_down((p[0], p[1], p[2]), self.heading_rad), self.origin_ned_m)


def travel_heading(start: Reference) -> float:
    """Direction of the start's motion; of its acceleration when it does not move."""
    for x, y, _ in (start.velocity_ned_m_s, start.acceleration_ned_m_s2):
        if hypot(x, y) > _SIDEWAYS:
            return atan2(y, x)
    return 0.0


def goes_sideways(start: Reference, heading_rad: float) -> bool:
    """Whether the start moves or accelerates across a direction."""
    velocity = rotate_about_down(start.velocity_ned_m_s, -heading_rad)
    acceleration = rotate_about_down(start.acceleration_ned_m_s2, -heading_rad)
    return max(abs(velocity[1]), abs(acceleration[1])) >= _SIDEWAYS


def straight(start: Reference, heading_rad: float, limits: MotionLimits) -> ruckig.InputParameter:
    """The start with the whole bounds along a direction; nothing of it goes across."""
    velocity = rotate_about_down(start.velocity_ned_m_s, -heading_rad)
    acceleration = rotate_about_down(start.acceleration_ned_m_s2, -heading_rad)
    # what is left across would be taken out with the whole jerk, on top of the one along
    velocity, acceleration = (velocity[0], 0.0, velocity[2]), (acceleration[0], 0.0, acceleration[2])
    return _input(velocity, acceleration, start, limits, (0.0, 0.0, 0.0))


def sharing(start: Reference, heading_rad: float, limits: MotionLimits) -> Iterator[ruckig.InputParameter]:
    """The start with bounds on each axis, in the order in which to try them; straight when nothing goes across."""
    if not goes_sideways(start, heading_rad):
        yield straight(start, heading_rad, limits)
        return
    velocity = rotate_about_down(start.velocity_ned_m_s, -heading_rad)
    acceleration = rotate_about_down(start.acceleration_ned_m_s2, -heading_rad)
    limit, speed = limits.acceleration_m_s2, limits.speed_m_s
    coming = velocity[1] + 0.5 * acceleration[1] * abs(acceleration[1]) / limits.jerk_m_s3
    speed_share = _across_share(max(_LEAST_SPEED_SHARE, abs(coming) / speed), velocity[0] / speed, velocity[1] / speed)
    for share in _ACROSS_SHARES:
        pushing = _across_share(share, acceleration[0] / limit, acceleration[1] / limit)
        yield _input(velocity, acceleration, start, limits, (speed_share, pushing, _JERK_SHARE))


def changing(
    start: Reference, velocity_m_s: tuple[float, float], limits: MotionLimits
) -> tuple[float, ruckig.InputParameter]:
    """The direction in which the start's velocity changes to another one, and the change with the whole bounds.

    The start accelerates horizontally along that direction, or not at all. Height and heading are braked.
    """
    north, east = (wanted - now for wanted, now in zip(velocity_m_s, start.velocity_ned_m_s, strict=False))
    heading_rad = atan2(east, north)
    velocity = rotate_about_down(start.velocity_ned_m_s, -heading_rad)
    along, _, down = rotate_about_down(start.acceleration_ned_m_s2, -heading_rad)
    found = _input(velocity, (along, 0.0, down), start, limits, (0.0, 0.0, 0.0))
    found.control_interface, found.synchronization = ruckig.ControlInterface.Velocity, ruckig.Synchronization.No
    found.target_velocity = [velocity[0] + hypot(north, east), velocity[1], 0.0, 0.0]
    return heading_rad, found


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


def solve(wanted: ruckig.InputParameter) -> ruckig.Trajectory | None:
    """Ruckig's trajectory, or None when it finds none."""
    trajectory = ruckig.Trajectory(4)
    try:
        result = ruckig.Ruckig(4).calculate(wanted, trajectory)
    except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding has no name for
        return None
    return trajectory if result in (ruckig.Result.Working, ruckig.Result.Finished) else None


def keeps(wanted: ruckig.InputParameter, motion: Motion, start: Reference, limits: MotionLimits) -> bool:
    """Whether the lengths of the horizontal vectors keep the limits, or what the start already asks for."""
    if wanted.current_velocity[1] == 0.0 and wanted.current_acceleration[1] == 0.0:
        return True
    (vx, vy, _), (ax, ay, _) = start.velocity_ned_m_s, start.acceleration_ned_m_s2
    taken_back_s = 0.5 * hypot(ax, ay) / limits.jerk_m_s3
    coming = hypot(vx + ax * taken_back_s, vy + ay * taken_back_s)
    allowed_speed = max(_CHECKED * limits.speed_m_s, hypot(vx, vy), coming) + 1e-9
    allowed = max(_CHECKED * limits.acceleration_m_s2, hypot(ax, ay)) + 1e-9
    for i in range(_CHECKS):
        _, v, a = motion.trajectory.at_time((i / _CHECKS) ** 2 * motion.duration_s)
        if hypot(v[0], v[1]) > allowed_speed or hypot(a[0], a[1]) > allowed:
            return False
    return True
