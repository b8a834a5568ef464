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
from daemon.guidance.saturation import Cascade, cascades, step_towards
from daemon.guidance.time_to_go import run_out_m, top_speed
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_STEPS_1_RAD = 0.1  # the longest step in units of 1 / omega
_STEP_S = 0.1  # but no longer where the motion bends: the limits are met in tenths of a second
_BEND_M = 0.01  # acceleration times the step squared, up to which a step may be longer
_AT_REST_M_S2 = 1e-9
_MOST_STEPS = 5000  # about 10 us each; a few hundred are the rule
_NEAR_M = 0.02  # by which what counts as cruising, or as arrived, may be off


class FilterPath(Plan):
    """The filter's motion from a flown reference to rest, equal to the filter's own to some decimetres."""

    def __init__(
        self, start: Reference, target: Reference, limits: MotionLimits, parameters: GuidanceParameters
    ) -> None:
        self.start_s = start.time_s
        self._target = target
        self._plane, self._vertical = cascades(limits, parameters, WINDOW_SPACING_S)
        self._longest_s = _STEPS_1_RAD / parameters.omega_rad_s
        self._starts_s: list[float] = []
        self._motions: list[tuple[Motion, Vec3]] = []
        self._step_through((start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2))

    @property
    def end_s(self) -> float:
        """When the filter arrives, as the plan estimates it."""
        return self._target.time_s

    @property
    def target(self) -> Reference:
        """Rest at the goal."""
        return self._target

    def sample(self, time_s: float) -> Reference:
        """The motion of the step of a time."""
        if not self._motions or time_s >= self._arrival_s:
            return replace(self._target, time_s=time_s)
        index = max(0, bisect_right(self._starts_s, time_s) - 1)
        motion, jerk = self._motions[index]
        since_s = max(0.0, time_s - self._starts_s[index])
        return Reference(time_s, *carried(motion, jerk, since_s), jerk, self._target.yaw_rad)

    def polyline(self) -> Iterator[Vec3]:
        """Where the steps begin."""
        for (position, _, _), _ in self._motions:
            yield position
        yield self._target.position_ned_m

    def _step_through(self, motion: Motion) -> None:
        """Step to rest at the goal."""
        time_s = self.start_s
        while len(self._motions) < _MOST_STEPS:
            offset = subtract(self._target.position_ned_m, motion[0])
            if norm(offset) + norm(motion[1]) + norm(motion[2]) < _NEAR_M:
                break
            cruise = self._cruise(offset, motion)
            if cruise is None:
                jerk, lasts_s = self._step(offset, motion)
            else:
                motion, jerk, lasts_s = (motion[0], cruise[0], ZERO3), ZERO3, cruise[1]
            self._starts_s.append(time_s)
            self._motions.append((motion, jerk))
            motion, time_s = carried(motion, jerk, lasts_s), time_s + lasts_s
        self._arrival_s = time_s

    def _step(self, offset: Vec3, motion: Motion) -> tuple[Vec3, float]:
        """The jerk of the next step and its length: the longer, the less the motion bends within it."""
        bends_s = sqrt(_BEND_M / max(norm(motion[2]), _AT_REST_M_S2))
        lasts_s = min(self._longest_s, max(_STEP_S, bends_s))
        # the bounds stay those of the filter's own steps
        plane, vertical = replace(self._plane, dt_s=lasts_s), replace(self._vertical, dt_s=lasts_s)
        return step_towards(plane, vertical, offset, motion), lasts_s

    def _cruise(self, offset: Vec3, motion: Motion) -> tuple[Vec3, float] | None:
        """The velocity and duration of a stretch in which neither filter has anything to change; None: it is none."""
        _, velocity, acceleration = motion
        across = _steady(self._plane, offset[:2], velocity[:2], acceleration[:2])
        down = _steady(self._vertical, offset[2:], velocity[2:], acceleration[2:])
        if across is None or down is None:
            return None
        lasts_s = min(across[1], down[1])
        kept = (*across[0], *down[0])
        return (kept, lasts_s) if self._longest_s < lasts_s < inf else None  # type: ignore[return-value]


def _steady(
    gains: Cascade, offset_m: tuple[float, ...], velocity_m_s: tuple[float, ...], acceleration_m_s2: tuple[float, ...]
) -> tuple[tuple[float, ...], float] | None:
    """The velocity that a filter keeps, at the goal or at its speed limit, and how long; None while it changes."""
    distance, omega = hypot(*offset_m), gains.acceleration_gain_1_s
    top = top_speed(gains, offset_m)
    left_m = distance - run_out_m(gains, top)
    wanted = tuple(0.0 if distance < _NEAR_M else top * o / distance for o in offset_m)
    off = hypot(*(w - v for w, v in zip(wanted, velocity_m_s, strict=True)))
    if off > _NEAR_M * omega or hypot(*acceleration_m_s2) > _NEAR_M * omega**2:
        return None
    if distance < _NEAR_M:
        return wanted, inf
    return (wanted, left_m / top) if left_m > 0.0 else None
