"""The reference filter as it is flown: position and heading, saturated, stepped as far as it is asked for."""

from dataclasses import replace
from math import floor, radians

from daemon.frames import add, subtract, wrap_pi
from daemon.guidance.constant_jerk import Motion, carried
from daemon.guidance.filter_path import FilterPath
from daemon.guidance.heading import turn_s
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.saturation import cascades, step_heading, step_towards
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_TURNED_RAD = radians(1.0)
_TURNING_STEP_RAD = 0.04  # in units of 1 / omega
_REST_M = 1e-7  # error, in metres, radians and their rates, below which the filter counts as resting at its goal

Node = tuple[Motion, Vec3, float, float, float]  # motion, jerk; heading, its rate and acceleration


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
        motion = (start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2)
        self._after: tuple[Motion, float, float] | None = (motion, start.yaw_rad, start.yaw_rate_rad_s)
        self._path: FilterPath | None = None
        self._end_s: float | None = None

    @property
    def end_s(self) -> float:
        """When the filter has come to the goal and all but rests there, 5 cm and 0.05 m/s, as its path foresees it."""
        if self._end_s is None:
            turn, rate = self._goal_yaw - self._start.yaw_rad, self._start.yaw_rate_rad_s
            omega = self._parameters.omega_yaw_rad_s
            turned_s = turn_s(turn, rate, omega, self._limits, _TURNED_RAD, _TURNING_STEP_RAD / omega)
            self._end_s = max(self.path.end_s, self.start_s + turned_s)
        return self._end_s

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
        """A twin of this plan in coarse steps, which cruises in one: some eighty of them, however far it goes."""
        if self._path is None:
            self._path = FilterPath(self._start, self._goal, wrap_pi(self._goal_yaw), self._limits, self._parameters)
        return self._path

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

    def _node(self, index: int) -> Node | None:
        """State, jerk and yaw acceleration at the beginning of a step; None when the filter rests by then."""
        nodes = self._nodes
        while index >= len(nodes):
            if self._after is None:
                return None
            node = self._step(*self._after)
            self._after = None if node is None else advance(node, self._step_s)
            if node is not None:
                nodes.append(node)
        return nodes[index]

    def _step(self, motion: Motion, yaw_rad: float, rate_rad_s: float) -> Node | None:
        """The state with what the step that begins there does to it; None at rest in the goal."""
        offset, to_yaw = subtract(self._goal, motion[0]), self._goal_yaw - yaw_rad
        largest = max(map(abs, (*offset, *motion[1], *motion[2], to_yaw, rate_rad_s)))
        if largest < _REST_M:
            return None
        jerk = step_towards(self._plane, self._vertical, offset, motion)
        turning = step_heading(to_yaw, rate_rad_s, 0.0, self._parameters.omega_yaw_rad_s, self._limits)
        return motion, jerk, yaw_rad, rate_rad_s, turning


def advance(node: Node, dt_s: float) -> tuple[Motion, float, float]:
    """Motion, heading and its rate ``dt_s`` after a node, jerk and yaw acceleration constant."""
    motion, jerk, yaw, rate, turning = node
    later = carried(motion, jerk, dt_s)
    return later, yaw + rate * dt_s + 0.5 * turning * dt_s * dt_s, rate + turning * dt_s


def reference_after(node: Node, dt_s: float, time_s: float) -> Reference:
    """The reference ``dt_s`` after a node."""
    motion, yaw, rate = advance(node, dt_s)
    return Reference(time_s, *motion, node[1], wrap_pi(yaw), rate)
