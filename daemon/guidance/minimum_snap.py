"""A minimum-snap path through points (Mellinger and Kumar 2011), its times allotted so that the limits are kept.

The curve itself is ``snap_spline``'s.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np
import numpy.typing as npt

from daemon.frames import subtract
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import WINDOW_COUNT, Plan, straights
from daemon.guidance.snap_spline import SnapSpline, interpolated
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_HOPELESS = 8.0  # times the first guess at which stretching ends: a moving start may swing out further and further
_LOOKS = 24  # instants of a segment at which they are checked
_STRETCH = 1.01  # all is stretched by this more than it seems to need
_NEAR_M = 1e-3  # points nearer to each other than this are one

Array = npt.NDArray[np.float64]


class MinimumSnapPlan(Plan):
    """A spline from the flown state through points to rest in the last one; ``passes_s`` are the times at them."""

    def __init__(self, start: Reference, spline: SnapSpline, duration_s: float, passes_s: tuple[float, ...]) -> None:
        self.start_s = start.time_s
        self.passes_s = passes_s
        self._start = start
        # times of the spline count from the start: the clock's own would cost digits
        self._spline = spline
        self._duration_s = duration_s
        self._end_s = start.time_s + duration_s
        end = spline(np.array(duration_s))
        self._target = Reference(self._end_s, (float(end[0]), float(end[1]), float(end[2])), yaw_rad=start.yaw_rad)

    @property
    def end_s(self) -> float:
        """When the last point is reached."""
        return self._end_s

    @property
    def target(self) -> Reference:
        """Rest in the last point."""
        return self._target

    def sample(self, time_s: float) -> Reference:
        """The spline at a time."""
        return self._samples(np.array([time_s]))[0]

    def window(self, from_s: float, count: int = WINDOW_COUNT) -> tuple[Reference, ...]:
        """The window at once, ten times as fast as by samples."""
        return self._samples(from_s + WINDOW_SPACING_S * np.arange(count, dtype=np.float64))

    def polyline(self) -> Iterator[Vec3]:
        """Each segment by its largest acceleration, looked for as for the limits."""
        for begin_s, end_s in pairwise((0.0, *(pass_s - self.start_s for pass_s in self.passes_s))):
            looks = np.linalg.norm(self._spline(np.linspace(begin_s, end_s, _LOOKS), 2), axis=1)
            count = straights(end_s - begin_s, _STRETCH * float(looks.max()))
            places = self._spline(np.linspace(begin_s, end_s, count + 1)).tolist()
            yield from ((north, east, down) for north, east, down in places)

    def _samples(self, times_s: Array) -> tuple[Reference, ...]:
        held = np.clip(times_s - self.start_s, 0.0, self._duration_s)
        rows = [self._spline(held, order).tolist() for order in range(4)]
        return tuple(
            Reference(time, tuple(p), tuple(v), tuple(a), tuple(j), self._start.yaw_rad)
            if time < self._end_s
            else replace(self._target, time_s=time)
            for time, p, v, a, j in zip(times_s.tolist(), *rows, strict=True)
        )


def through(start: Reference, points_ned_m: tuple[Vec3, ...], limits: MotionLimits) -> MinimumSnapPlan | None:
    """The path from a flown state through points to rest in the last; None when no times keep the limits.

    Times are allotted by distance and then stretched alike. Takes 1 ms for 2 points, 15 ms for 50: off the event loop.
    """
    points = [start.position_ned_m]
    indices = []  # of the places, for each point: two points in one place are one
    for point in points_ned_m:
        if hypot(*subtract(point, points[-1])) > _NEAR_M:
            points.append(point)
        indices.append(len(points) - 1)
    if len(points) < 2:
        return None
    places = np.array(points)
    durations = _first_guess(places, limits)
    most_s = _HOPELESS * float(durations.sum())
    fitted = False  # the first guess may be too slow as well
    while float(durations.sum()) < most_s:
        times = np.concatenate(([0.0], np.cumsum(durations)))
        try:
            spline = _spline(start, places, times)
        except np.linalg.LinAlgError:
            return None
        excess = _excess(spline, times, limits)
        if excess <= 1.0 and fitted:
            passes_s = tuple(start.time_s + float(times[index]) for index in indices)
            return MinimumSnapPlan(start, spline, float(times[-1]), passes_s)
        durations = durations * (_STRETCH * excess)
        fitted = True
    return None


def _spline(start: Reference, places: Array, times: Array) -> SnapSpline:
    """The spline through places at times, from the start's velocity and acceleration to rest; no jerk at the ends."""
    first = np.array([start.velocity_ned_m_s, start.acceleration_ned_m_s2, ZERO3])
    return interpolated(times, places, first, np.zeros((3, 3)))


def _first_guess(places: Array, limits: MotionLimits) -> Array:
    """Durations of the segments at nearly full speed, and a constant share: even times keep the spline calm."""
    steps = np.diff(places, axis=0)
    across = np.hypot(steps[:, 0], steps[:, 1]) / limits.speed_m_s
    down = np.where(steps[:, 2] > 0.0, steps[:, 2] / limits.descent_m_s, -steps[:, 2] / limits.climb_m_s)
    ramp = limits.speed_m_s / limits.acceleration_m_s2
    durations = 1.1 * np.maximum(across, down) + 0.3 * ramp
    durations[[0, -1]] += 0.3 * ramp
    return np.asarray(durations, dtype=np.float64)


def _excess(spline: SnapSpline, times: Array, limits: MotionLimits) -> float:
    """The factor by which the times are too short for the limits; at most 1 when they hold."""
    looks = times[:-1, None] + np.diff(times)[:, None] * np.linspace(0.0, 1.0, _LOOKS)[None, :]
    v, a, j = (spline(looks, order) for order in (1, 2, 3))
    speed = max(
        (np.hypot(v[..., 0], v[..., 1]) / limits.speed_m_s).max(),
        (v[..., 2] / limits.descent_m_s).max(),
        (-v[..., 2] / limits.climb_m_s).max(),
    )
    acceleration = max(
        (np.hypot(a[..., 0], a[..., 1]) / limits.acceleration_m_s2).max(),
        np.abs(a[..., 2] / limits.vertical_acceleration_m_s2).max(),
    )
    jerk = max(np.hypot(j[..., 0], j[..., 1]).max(), np.abs(j[..., 2]).max()) / limits.jerk_m_s3
    return float(max(speed, np.sqrt(acceleration), np.cbrt(jerk))) * (1.0 + 1.0 / _LOOKS**2)
