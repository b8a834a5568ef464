"""The way of the reference filter, cheap to look at far ahead: coarse steps, and one for each cruise."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import replace
from math import hypot, inf, sqrt

from daemon.frames import norm, subtract
from daemon.guidance.constant_jerk import Motion, carried
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.saturation import Cascade, cascades, run_out_m, step_towards
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_STEPS = 8  # that are as long as WINDOW_SPACING_S, then as many twice as long, and so on: a start bends most
_LONGEST_RAD = 0.5  # the longest step in units of 1 / omega
_STEP_S = 0.2  # but no longer where the motion bends: the limits are met in tenths of a second
_BEND_M = 0.03  # acceleration times the step squared, up to which a step may be longer
_AT_REST_M_S2 = 1e-9
_MOST_STEPS = 2000  # about 8 us each; some eighty are the rule
_NEAR_M = 0.02  # by which what counts as cruising, or as arrived, may be off


class FilterPath(Plan):
    """The filter's motion from a flown reference to rest, equal to the filter's own to some decimetres."""

    def __init__(
        self,
        start: Reference,
        position_ned_m: Vec3,
        yaw_rad: float,
        limits: MotionLimits,
        parameters: GuidanceParameters,
    ) -> None:
        self.start_s = start.time_s
        self._goal = position_ned_m
        self._yaw_rad = yaw_rad
        self._gains = {WINDOW_SPACING_S: cascades(limits, parameters, WINDOW_SPACING_S)}  # by the step's length
        self._longest_s = _LONGEST_RAD / parameters.omega_rad_s
        self._starts_s: list[float] = []
        self._motions: list[tuple[Motion, Vec3]] = []
        self._step_through((start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2))

    @property
    def end_s(self) -> float:
        """When the filter has come to the goal and all but rests there."""
        return self._arrival_s

    @property
    def target(self) -> Reference:
        """Rest at the goal."""
        return Reference(self._arrival_s, self._goal, yaw_rad=self._yaw_rad)

    def sample(self, time_s: float) -> Reference:
        """The motion of the step of a time."""
        if not self._motions or time_s >= self._arrival_s:
            return replace(self.target, time_s=time_s)
        index = max(0, bisect_right(self._starts_s, time_s) - 1)
        motion, jerk = self._motions[index]
        since_s = max(0.0, time_s - self._starts_s[index])
        return Reference(time_s, *carried(motion, jerk, since_s), jerk, self._yaw_rad)

    def polyline(self) -> Iterator[Vec3]:
        """Where the steps begin."""
        for (position, _, _), _ in self._motions:
            yield position
        yield self._goal

    def _step_through(self, motion: Motion) -> None:
        """Step to rest at the goal."""
        time_s, step_s, steps = self.start_s, WINDOW_SPACING_S, 0
        while len(self._motions) < _MOST_STEPS:
            offset = subtract(self._goal, motion[0])
            if norm(offset) + norm(motion[1]) + norm(motion[2]) < _NEAR_M:
                break
            steps += 1
            allowed_s = self._allowed_s(motion)
            if step_s > allowed_s:
                step_s, steps = max(0.5 * step_s, WINDOW_SPACING_S), 0
            elif steps > _STEPS and 2.0 * step_s <= allowed_s:
                step_s, steps = 2.0 * step_s, 0
            cruise = self._cruise(offset, motion)
            if cruise is None or cruise[1] <= step_s:
                jerk, lasts_s = step_towards(*self._gains_of(step_s), offset, motion), step_s
            else:
                motion, jerk, lasts_s = (motion[0], cruise[0], ZERO3), ZERO3, cruise[1]
            self._starts_s.append(time_s)
            self._motions.append((motion, jerk))
            motion, time_s = carried(motion, jerk, lasts_s), time_s + lasts_s
        self._arrival_s = time_s

    def _allowed_s(self, motion: Motion) -> float:
        """How long a step may be: the longer, the less the motion bends within it."""
        bends_s = sqrt(_BEND_M / max(norm(motion[2]), _AT_REST_M_S2))
        return min(self._longest_s, max(_STEP_S, bends_s))

    def _gains_of(self, step_s: float) -> tuple[Cascade, Cascade]:
        """The filters for steps of a length; the bounds stay those of the filter's own steps."""
        if step_s not in self._gains:
            plane, vertical = self._gains[WINDOW_SPACING_S]
            gain = min(plane.jerk_gain_1_s, 1.0 / step_s)
            self._gains[step_s] = (
                replace(plane, dt_s=step_s, jerk_gain_1_s=gain),
                replace(vertical, dt_s=step_s, jerk_gain_1_s=gain),
            )
        return self._gains[step_s]

    def _cruise(self, offset: Vec3, motion: Motion) -> tuple[Vec3, float] | None:
        """The velocity and duration of a stretch in which neither filter has anything to change; None: it is none."""
        _, velocity, acceleration = motion
        plane, vertical = self._gains[WINDOW_SPACING_S]
        across = _steady(plane, offset[:2], velocity[:2], acceleration[:2])
        down = across and _steady(vertical, offset[2:], velocity[2:], acceleration[2:])
        if across is None or down is None:
            return None
        lasts_s = min(across[1], down[1])
        kept = (*across[0], *down[0])
        return (kept, lasts_s) if lasts_s < inf else None  # type: ignore[return-value]


def _steady(
    gains: Cascade, offset_m: tuple[float, ...], velocity_m_s: tuple[float, ...], acceleration_m_s2: tuple[float, ...]
) -> tuple[tuple[float, ...], float] | None:
    """The velocity that a filter keeps, at the goal or at its speed limit, and how long; None while it changes."""
    omega = gains.acceleration_gain_1_s
    if hypot(*acceleration_m_s2) > _NEAR_M * omega**2:
        return None
    distance = hypot(*offset_m)
    top = gains.speed_high_m_s if len(offset_m) == 2 or offset_m[0] >= 0.0 else -gains.speed_low_m_s
    left_m = distance - run_out_m(top, gains.velocity_gain_1_s, gains.braking_m_s2)
    wanted = tuple(0.0 if distance < _NEAR_M else top * o / distance for o in offset_m)
    off = hypot(*(w - v for w, v in zip(wanted, velocity_m_s, strict=True)))
    if off > _NEAR_M * omega:
        return None
    if distance < _NEAR_M:
        return wanted, inf
    return (wanted, left_m / top) if left_m > 0.0 else None
