"""The reference filter as it is flown: position and heading, saturated, stepped as far as it is asked for."""

from dataclasses import replace
from math import floor

from daemon.frames import add, wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.saturation import Cascade, cascade, step_axis, step_heading, step_plane
from daemon.guidance.time_to_go import duration_s
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_REST_M = 1e-7  # error, in metres, radians and their rates, below which the filter counts as resting at its goal
_PATH_STEPS_1_RAD = 0.1  # the path's step in units of 1 / omega
_PATH_STEP_S = 0.1  # and at most: the limits are met in tenths of a second, however slow the filter is

Node = tuple[float, ...]  # px py pz vx vy vz ax ay az yaw yaw_rate jx jy jz yaw_acceleration


class FilterPlan(Plan):
    """From a flown reference to a position and heading, the heading the shorter way.

    Horizontal speed, acceleration and jerk are bounded as lengths of vectors, vertical ones by themselves; from a
    start outside of them the reference returns into them first. Between two steps the jerk is constant, so any time
    may be sampled exactly. The plan does not change; the steps made so far are kept (about 10 us each).
    """

    def __init__(
        self,
        start: Reference,
        position_ned_m: Vec3,
        yaw_rad: float,
        limits: MotionLimits,
        parameters: GuidanceParameters,
        step_s: float = WINDOW_SPACING_S,
    ) -> None:
        self.start_s = start.time_s
        self._start = start
        self._goal = position_ned_m
        self._goal_yaw = start.yaw_rad + wrap_pi(yaw_rad - start.yaw_rad)
        self._limits = limits
        self._parameters = parameters
        self._step_s = step_s
        self._plane, self._vertical = cascades(limits, parameters, step_s)
        self._nodes: list[Node] = []
        self._after: Node | None = (
            *start.position_ned_m,
            *start.velocity_ned_m_s,
            *start.acceleration_ned_m_s2,
            start.yaw_rad,
            start.yaw_rate_rad_s,
        )

    @property
    def end_s(self) -> float:
        """When the filter comes within 5 cm of the goal: estimated from its law until it has been stepped to rest."""
        if self._after is None:
            return self.start_s + len(self._nodes) * self._step_s
        across = duration_s(self._plane, self._offset()[:2], self._start.velocity_ned_m_s[:2])
        down = duration_s(self._vertical, self._offset()[2:], self._start.velocity_ned_m_s[2:])
        turn = abs(self._goal_yaw - self._start.yaw_rad) / self._limits.yaw_rate_rad_s
        if turn > 0.0:
            turn += 2.0 / self._parameters.omega_yaw_rad_s
        return self.start_s + max(across, down, turn)

    @property
    def target(self) -> Reference:
        """Rest at the goal."""
        return Reference(time_s=self.end_s, position_ned_m=self._goal, yaw_rad=wrap_pi(self._goal_yaw))

    def sample(self, time_s: float) -> Reference:
        """The filter's output at a time."""
        since_s = max(0.0, time_s - self.start_s)
        index = floor(since_s / self._step_s)
        node = self._node(index)
        if node is None:
            return Reference(time_s=time_s, position_ned_m=self._goal, yaw_rad=wrap_pi(self._goal_yaw))
        return reference_after(node, since_s - index * self._step_s, time_s)

    @property
    def path(self) -> Plan:
        """A twin of this plan with coarser steps: a tenth of the work, equal to some decimetres."""
        coarse_s = max(self._step_s, min(_PATH_STEPS_1_RAD / self._parameters.omega_rad_s, _PATH_STEP_S))
        return FilterPlan(self._start, self._goal, self._goal_yaw, self._limits, self._parameters, coarse_s)

    def shifted(self, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> Plan:
        """Moved with the estimate; after a velocity jump the filter goes on from the shifted state."""
        if dv_ned_m_s == ZERO3:
            return super().shifted(dp_ned_m, dv_ned_m_s, dyaw_rad, at_s)
        now = self.sample(at_s)
        start = replace(
            now,
            position_ned_m=add(now.position_ned_m, dp_ned_m),
            velocity_ned_m_s=add(now.velocity_ned_m_s, dv_ned_m_s),
            yaw_rad=wrap_pi(now.yaw_rad + dyaw_rad),
        )
        goal = add(self._goal, dp_ned_m)
        return FilterPlan(start, goal, self._goal_yaw + dyaw_rad, self._limits, self._parameters, self._step_s)

    def _offset(self) -> Vec3:
        goal, now = self._goal, self._start.position_ned_m
        return (goal[0] - now[0], goal[1] - now[1], goal[2] - now[2])

    def _node(self, index: int) -> Node | None:
        """State and jerk at the beginning of a step; None when the filter rests by then."""
        nodes = self._nodes
        while index >= len(nodes):
            if self._after is None:
                return None
            node = self._step(self._after)
            self._after = None if node is None else advance(node, self._step_s)
            if node is not None:
                nodes.append(node)
        return nodes[index]

    def _step(self, state: Node) -> Node | None:
        """The state with the jerk of the step that begins there; None at rest in the goal."""
        px, py, pz, vx, vy, vz, ax, ay, az, yaw, yaw_rate = state
        gx, gy, gz = self._goal
        to_yaw = self._goal_yaw - yaw
        largest = max(map(abs, (gx - px, gy - py, gz - pz, vx, vy, vz, ax, ay, az, to_yaw, yaw_rate)))
        if largest < _REST_M:
            return None
        jx, jy = step_plane(self._plane, gx - px, gy - py, vx, vy, ax, ay)
        jz = step_axis(self._vertical, gz - pz, vz, az)
        turning = step_heading(to_yaw, yaw_rate, 0.0, self._parameters.omega_yaw_rad_s, self._limits)
        return (*state, jx, jy, jz, turning)


def cascades(limits: MotionLimits, parameters: GuidanceParameters, step_s: float) -> tuple[Cascade, Cascade]:
    """Gains of the horizontal and of the vertical filter."""
    horizontal = cascade(
        omega_rad_s=parameters.omega_rad_s,
        zeta=parameters.zeta,
        speed_high_m_s=limits.speed_m_s,
        speed_low_m_s=-limits.speed_m_s,
        acceleration_m_s2=limits.acceleration_m_s2,
        jerk_m_s3=limits.jerk_m_s3,
        dt_s=step_s,
    )
    vertical = cascade(
        omega_rad_s=parameters.omega_rad_s,
        zeta=parameters.zeta,
        speed_high_m_s=limits.descent_m_s,
        speed_low_m_s=-limits.climb_m_s,
        acceleration_m_s2=limits.vertical_acceleration_m_s2,
        jerk_m_s3=limits.jerk_m_s3,
        dt_s=step_s,
    )
    return horizontal, vertical


def advance(node: Node, dt: float) -> Node:
    """The state ``dt`` after a node, jerk constant."""
    px, py, pz, vx, vy, vz, ax, ay, az, yaw, yaw_rate, jx, jy, jz, yaw_acceleration = node
    half, sixth = 0.5 * dt * dt, dt * dt * dt / 6.0
    return (
        px + vx * dt + ax * half + jx * sixth,
        py + vy * dt + ay * half + jy * sixth,
        pz + vz * dt + az * half + jz * sixth,
        vx + ax * dt + jx * half,
        vy + ay * dt + jy * half,
        vz + az * dt + jz * half,
        ax + jx * dt,
        ay + jy * dt,
        az + jz * dt,
        yaw + yaw_rate * dt + yaw_acceleration * half,
        yaw_rate + yaw_acceleration * dt,
    )


def reference_after(node: Node, dt: float, time_s: float) -> Reference:
    """The reference ``dt`` after a node."""
    px, py, pz, vx, vy, vz, ax, ay, az, yaw, yaw_rate = advance(node, dt)
    return Reference(time_s, (px, py, pz), (vx, vy, vz), (ax, ay, az), node[11:14], wrap_pi(yaw), yaw_rate)  # type: ignore[arg-type]
