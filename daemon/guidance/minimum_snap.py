"""A minimum-snap path through points (Mellinger and Kumar 2011), its times allotted so that the limits are kept.

The curve itself is ``snap_spline``'s; on the legs between the points it is held by ``guide_points``.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np
import numpy.typing as npt

from daemon.frames import subtract
from daemon.guidance.guide_points import guided
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import WINDOW_COUNT, Plan, straights
from daemon.guidance.snap_spline import SnapSpline, interpolated
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_HOPELESS = 8.0  # times the first guess at which stretching ends: a moving start may swing out further and further
_LOOKS = 24  # instants of a segment at which they are checked
_ROUGH_LOOKS = 12  # while its duration is looked for
_ROUNDS = 12  # of balancing the segments' durations
_STEP = 0.5  # exponent of a round: the whole excess at once would swing between neighbours
_STRETCH = 1.005  # all is stretched by this more than it seems to need
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
        if time_s >= self._end_s:
            return replace(self._target, time_s=time_s)
        return Reference(time_s, *self._spline.at(max(0.0, time_s - self.start_s)), self._start.yaw_rad)

    def window(self, from_s: float, count: int = WINDOW_COUNT) -> tuple[Reference, ...]:
        """The window at once, ten times as fast as by samples."""
        return self._samples(from_s + WINDOW_SPACING_S * np.arange(count, dtype=np.float64))

    def polyline(self) -> Iterator[Vec3]:
        """Each leg by its largest acceleration, looked for more densely than for the limits."""
        for begin_s, end_s in pairwise((0.0, *(pass_s - self.start_s for pass_s in self.passes_s))):
            looks = np.linalg.norm(self._spline(np.linspace(begin_s, end_s, 4 * _LOOKS), 2), axis=1)
            count = straights(end_s - begin_s, _STRETCH * float(looks.max()))
            places = self._spline(np.linspace(begin_s, end_s, count + 1)).tolist()
            yield from ((north, east, down) for north, east, down in places)

    def aside_m(self) -> list[float]:
        """For each leg how far the curve goes from the straight line between its two points."""
        passes = np.array((self.start_s, *self.passes_s)) - self.start_s
        curve = self._spline(passes[:-1, None] + np.diff(passes)[:, None] * np.linspace(0.0, 1.0, 4 * _LOOKS))
        begin, way = curve[:, :1], curve[:, -1:] - curve[:, :1]
        along = np.sum((curve - begin) * way, axis=2) / np.maximum(np.sum(way * way, axis=2), _NEAR_M**2)
        nearest = begin + np.clip(along, 0.0, 1.0)[..., None] * way
        distances: list[float] = np.linalg.norm(curve - nearest, axis=2).max(axis=1).tolist()
        return distances

    def _samples(self, times_s: Array) -> tuple[Reference, ...]:
        held = np.clip(times_s - self.start_s, 0.0, self._duration_s)
        rows = [self._spline(held, order).tolist() for order in range(4)]
        return tuple(
            Reference(time, tuple(p), tuple(v), tuple(a), tuple(j), self._start.yaw_rad)
            if time < self._end_s
            else replace(self._target, time_s=time)
            for time, p, v, a, j in zip(times_s.tolist(), *rows, strict=True)
        )


def through(
    start: Reference, points_ned_m: tuple[Vec3, ...], limits: MotionLimits, spacing: float = 1.0
) -> MinimumSnapPlan | None:
    """The path from a flown state through points to rest in the last; None when no times keep the limits.

    A smaller ``spacing`` of the guide points holds it nearer to the straight legs, at corners taken more slowly.
    Takes about 5 ms for 2 points, 20 for 10, 60 for 50 that are far apart: off the event loop.
    """
    points = [start.position_ned_m]
    indices = []  # of the places, for each point: two points in one place are one
    for point in points_ned_m:
        if hypot(*subtract(point, points[-1])) > _NEAR_M:
            points.append(point)
        indices.append(len(points) - 1)
    if len(points) < 2:
        return None
    places, durations, at = guided(np.array(points), limits, spacing)
    try:
        fitted = _fitted(start, places, _balanced(start, places, durations, limits), limits)
    except np.linalg.LinAlgError:
        return None
    if fitted is None:
        return None
    times = _times(fitted)
    passes_s = tuple(start.time_s + float(times[at[index]]) for index in indices)
    return MinimumSnapPlan(start, _spline(start, places, times), float(times[-1]), passes_s)


def _balanced(start: Reference, places: Array, durations: Array, limits: MotionLimits) -> Array:
    """Durations with which the whole is quickest: each segment takes from its neighbours until all are at a limit."""
    shortest_s, found = np.inf, durations
    for _ in range(_ROUNDS):
        times = _times(durations)
        excesses = _excesses(_spline(start, places, times), times, limits, _ROUGH_LOOKS)
        stretched_s = float(times[-1] * excesses.max())
        if stretched_s < shortest_s:
            shortest_s, found = stretched_s, durations
        durations = durations * np.clip(excesses, 0.5, 2.0) ** _STEP
    return found


def _fitted(start: Reference, places: Array, durations: Array, limits: MotionLimits) -> Array | None:
    """Durations all stretched alike, or shrunk, until the limits hold."""
    most_s = _HOPELESS * float(durations.sum())
    fitted = False  # the first guess may be too slow as well
    while float(durations.sum()) < most_s:
        times = _times(durations)
        excess = float(_excesses(_spline(start, places, times), times, limits, _LOOKS).max())
        if excess <= 1.0 and fitted:
            return durations
        durations = durations * (_STRETCH * excess)
        fitted = True
    return None


def _times(durations: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum(durations)))


def _spline(start: Reference, places: Array, times: Array) -> SnapSpline:
    """The spline through places at times, from the start's velocity and acceleration to rest; no jerk at the ends."""
    first = np.array([start.velocity_ned_m_s, start.acceleration_ned_m_s2, ZERO3])
    return interpolated(times, places, first, np.zeros((3, 3)))


def _excesses(spline: SnapSpline, times: Array, limits: MotionLimits, looks: int) -> Array:
    """For each segment the factor by which its time is too short for the limits; at most 1 when they hold."""
    instants = times[:-1, None] + np.diff(times)[:, None] * np.linspace(0.0, 1.0, looks)[None, :]
    v, a, j = (spline(instants, order) for order in (1, 2, 3))
    climb = np.maximum(v[..., 2] / limits.descent_m_s, -v[..., 2] / limits.climb_m_s)
    speed = np.maximum(np.hypot(v[..., 0], v[..., 1]) / limits.speed_m_s, climb)
    across = np.hypot(a[..., 0], a[..., 1]) / limits.acceleration_m_s2
    acceleration = np.maximum(across, np.abs(a[..., 2]) / limits.vertical_acceleration_m_s2)
    jerk = np.maximum(np.hypot(j[..., 0], j[..., 1]), np.abs(j[..., 2])) / limits.jerk_m_s3
    worst = np.maximum(np.maximum(speed, np.sqrt(acceleration)), np.cbrt(jerk)).max(axis=1)
    return np.asarray(worst * (1.0 + 1.0 / looks**2), dtype=np.float64)
