"""Guide points on the straight legs between waypoints, for a spline to hold on to, and a first guess of its times.

One polynomial for a long leg swings out beside it and is fast in its middle only. Through points on the leg the spline
stays near it and cruises (Richter, Bry and Roy 2013 add such points where a curve would hit something).
"""

from math import log1p

import numpy as np
import numpy.typing as npt

from daemon.guidance.limits import MotionLimits

Array = npt.NDArray[np.float64]

_GROWTH = 0.2  # of the spacing, per metre of distance from a corner
_MOST_SEGMENTS = 400  # beyond which the spacing grows faster: the time that planning takes
_CRUISE = 0.9  # of the speed limit, in the first guess
_PUSH = 0.6  # of the acceleration limit
_CORNER = 0.5  # curvature of a corner as the spline takes it, over tan(turn / 2) / spacing
_ALONE_S = 2.6  # of a segment from rest to rest, times sqrt(length / acceleration)


def guided(points: Array, limits: MotionLimits, spacing: float = 1.0) -> tuple[Array, Array, list[int]]:
    """Points with guide points between them, seconds from each to the next, and where among them the points are.

    ``points``: (n, 3), n > 1, no two neighbours in one place. At a corner the guide points are ``spacing`` times the
    way apart in which it is braked for, or a shorter leg's length; away from it they are farther and farther apart.
    """
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    speeds, accelerations = _along(legs, lengths, limits)
    brakings = 0.5 * speeds * (speeds / accelerations + accelerations / limits.jerk_m_s3)
    distances = _distances(lengths, np.minimum(lengths, spacing * brakings))
    rows = [points[i] + along[:, None] * (legs[i] / lengths[i]) for i, along in enumerate(distances)]
    counts = [len(row) for row in rows]
    places = np.concatenate((*rows, points[-1:]))
    durations = _first_guess(places, np.repeat(speeds, counts), np.repeat(accelerations, counts))
    return places, durations, [0, *np.cumsum(counts).tolist()]


def _along(legs: Array, lengths: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """Speed and acceleration that the limits allow along each leg."""
    across, down = np.hypot(legs[:, 0], legs[:, 1]) / lengths, legs[:, 2] / lengths
    slowness = np.maximum(across / limits.speed_m_s, np.maximum(down / limits.descent_m_s, -down / limits.climb_m_s))
    heaviness = np.maximum(across / limits.acceleration_m_s2, np.abs(down) / limits.vertical_acceleration_m_s2)
    return 1.0 / slowness, 1.0 / heaviness


def _distances(lengths: Array, spacings: Array) -> list[Array]:
    """For each leg the distances from its begin, 0 first, at which the segments begin; ``spacings`` is of its ends."""
    growth = _GROWTH
    while True:
        at_corners = np.minimum(np.append(spacings, spacings[-1]), np.insert(spacings, 0, spacings[0]))
        for i in range(len(lengths)):
            at_corners[i + 1] = min(at_corners[i + 1], at_corners[i] + growth * lengths[i])
        for i in reversed(range(len(lengths))):
            at_corners[i] = min(at_corners[i], at_corners[i + 1] + growth * lengths[i])
        found = [_split(*leg, growth) for leg in zip(lengths.tolist(), at_corners[:-1], at_corners[1:], strict=True)]
        if sum(map(len, found)) <= max(_MOST_SEGMENTS, len(lengths)):
            return found
        growth *= 1.5


def _split(length: float, first: float, last: float, growth: float) -> Array:
    """Distances that begin the segments of a leg, which grow by ``growth`` a metre from those at its two ends."""
    middle = 0.5 * (length + (last - first) / growth)  # where they are longest
    before, after = log1p(growth * middle / first), log1p(growth * (length - middle) / last)
    count = max(1, round((before + after) / growth))
    at = (before + after) * np.arange(count) / count
    up, down = first * np.expm1(np.minimum(at, before)), last * np.expm1(np.minimum(before + after - at, after))
    return np.asarray(np.where(at < before, up / growth, length - down / growth), dtype=np.float64)


def _first_guess(places: Array, speeds: Array, accelerations: Array) -> Array:
    """Durations of the segments, each corner taken as fast as its turn allows, with speeding up and braking between."""
    steps = np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    cosines = np.clip(np.sum(steps[1:] * steps[:-1], axis=1) / (lengths[1:] * lengths[:-1]), -1.0, 1.0)
    tangents = np.sqrt((1.0 - cosines) / np.maximum(1.0 + cosines, 1e-9))  # of half the turns
    radii = np.minimum(lengths[1:], lengths[:-1]) / np.maximum(tangents, 1e-9)
    fastest = np.sqrt(_CORNER * radii * np.minimum(accelerations[1:], accelerations[:-1]))
    top = [0.0, *np.minimum(fastest, _CRUISE * np.minimum(speeds[1:], speeds[:-1])).tolist(), 0.0]
    gains = (2.0 * _PUSH * accelerations * lengths).tolist()
    for i, gain in enumerate(gains):
        top[i + 1] = min(top[i + 1], (top[i] ** 2 + gain) ** 0.5)
    for i in reversed(range(len(gains))):
        top[i] = min(top[i], (top[i + 1] ** 2 + gains[i]) ** 0.5)
    means = 0.5 * (np.array(top[1:]) + top[:-1])
    alone = _ALONE_S * np.sqrt(lengths / accelerations)
    return np.asarray(np.minimum(lengths / np.maximum(means, 1e-9), alone), dtype=np.float64)
