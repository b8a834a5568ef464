"""The curve of least integrated snap through places at times: a spline of degree 7, smooth to the sixth derivative.

Each segment is the polynomial of degree 7 that has position, velocity, acceleration and jerk given at both ends, in the
segment's own time from 0 to 1. The derivatives at the inner places are those for which the fourth to the sixth
derivative go through them without a step (Mellinger and Kumar 2011, as a spline); three unknowns a place.
"""

from bisect import bisect_right
from math import factorial, perm

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded

from daemon.frames import scale
from daemon.messages import Vec3

Array = npt.NDArray[np.float64]
_Floats = tuple[list[float], list[float], list[list[list[float]]]]  # begins, durations, coefficients of each axis

_ORDER = 8  # coefficients of a segment
_HALF = 4  # derivatives given at an end, the position included
_BAND = 5  # of the system of the inner places: three unknowns each, and those of the neighbours
_POWERS = np.arange(_ORDER)
_FACTORS = np.array([[perm(k, nu) for k in range(_ORDER)] for nu in range(_ORDER)], dtype=np.float64)
_AT_END = np.linalg.inv(_FACTORS[:_HALF, _HALF:])  # the upper coefficients from what they must give at the end


class SnapSpline:
    """Called with times and the order of a derivative, it gives rows (..., 3); times outside go on with the end's."""

    def __init__(self, times_s: Array, coefficients: Array) -> None:
        """``coefficients``: (segments, 8, 3), of powers of each segment's own time from 0 to 1."""
        self._begins_s = times_s[:-1]
        self._durations_s = np.diff(times_s)
        self._coefficients = coefficients
        self._floats: _Floats | None = None

    def __call__(self, times_s: Array, order: int = 0) -> Array:
        """The spline's derivative of an order (0 to 7) at times."""
        segment = np.clip(np.searchsorted(self._begins_s, times_s, side="right") - 1, 0, len(self._begins_s) - 1)
        duration = self._durations_s[segment]
        share = (times_s - self._begins_s[segment]) / duration
        powers = _FACTORS[order, order:] * share[..., None] ** _POWERS[: _ORDER - order]
        values = np.einsum("...k,...kd->...d", powers, self._coefficients[segment, order:])
        return np.asarray(values / duration[..., None] ** order, dtype=np.float64)

    def at(self, time_s: float) -> tuple[Vec3, Vec3, Vec3, Vec3]:
        """Place, velocity, acceleration and jerk at one time, without numpy, which takes ten times as long for it."""
        if self._floats is None:
            axes = self._coefficients.transpose(0, 2, 1)[..., ::-1].tolist()
            self._floats = self._begins_s.tolist(), self._durations_s.tolist(), axes
        begins_s, durations_s, axes = self._floats
        segment = max(0, bisect_right(begins_s, time_s) - 1)
        duration = durations_s[segment]
        share = (time_s - begins_s[segment]) / duration
        rows = [_horner(axis, share) for axis in axes[segment]]
        p, v, a, j = zip(*rows, strict=True)
        return p, scale(v, 1.0 / duration), scale(a, 2.0 / duration**2), scale(j, 6.0 / duration**3)


def _horner(coefficients: list[float], share: float) -> tuple[float, float, float, float]:
    """A polynomial whose highest coefficient comes first, and its Taylor coefficients up to the third."""
    p = v = a = j = 0.0
    for c in coefficients:
        j = j * share + a
        a = a * share + v
        v = v * share + p
        p = p * share + c
    return p, v, a, j


def interpolated(times_s: Array, places: Array, first: Array, last: Array) -> SnapSpline:
    """The spline through ``places`` (n, 3) at ``times_s``, n > 1; ``first`` and ``last`` (3, 3) are velocity,
    acceleration and jerk at its ends. Raises ``numpy.linalg.LinAlgError`` when there is none."""
    durations = np.diff(times_s)
    ends = np.zeros((len(places), _HALF, 3))  # per place: position and three derivatives
    ends[:, 0] = places
    ends[0, 1:], ends[-1, 1:] = first, last
    if len(places) > 2:
        ends[1:-1, 1:] = _smooth(durations, ends)
    both = np.concatenate((ends[:-1], ends[1:]), axis=1)
    return SnapSpline(times_s, np.einsum("nck,nkd->ncd", _to_coefficients(durations), both))


def _smooth(durations_s: Array, ends: Array) -> Array:
    """(inner, 3, 3): derivatives at the inner places for which the high ones before a place equal those after it."""
    begin = _to_high(durations_s, 0.0).reshape(-1, 3, 2, _HALF)
    end = _to_high(durations_s, 1.0).reshape(-1, 3, 2, _HALF)
    steps = (end[:-1, :, 0], end[:-1, :, 1] - begin[1:, :, 0], -begin[1:, :, 1])  # by the place before, itself, after
    inner = len(durations_s) - 1
    known = sum(np.einsum("irk,ikd->ird", step, ends[i : inner + i]) for i, step in enumerate(steps))
    banded = np.zeros((2 * _BAND + 1, 3 * inner))
    rows = np.arange(3 * inner).reshape(inner, 3, 1)
    for i, step in enumerate(steps):
        columns = rows.reshape(inner, 1, 3) + 3 * (i - 1)
        inside = np.broadcast_to((columns >= 0) & (columns < 3 * inner), (inner, 3, 3))
        diagonals, columns = np.broadcast_arrays(_BAND + rows - columns, columns)
        banded[diagonals[inside], columns[inside]] = step[:, :, 1:][inside]
    return np.asarray(solve_banded((_BAND, _BAND), banded, -np.reshape(known, (3 * inner, 3))).reshape(inner, 3, 3))


def _to_coefficients(durations_s: Array) -> Array:
    """(n, 8, 8): a segment's coefficients from position, velocity, acceleration and jerk at its two ends."""
    scales = durations_s[:, None] ** np.arange(_HALF)  # derivatives by the segment's own time
    lower = np.diag([1.0 / factorial(k) for k in range(_HALF)])
    upper_from_first = -_AT_END @ _FACTORS[:_HALF, :_HALF] @ lower
    own = np.block([[lower, np.zeros((_HALF, _HALF))], [upper_from_first, _AT_END]])
    return np.asarray(own * np.concatenate((scales, scales), axis=1)[:, None, :], dtype=np.float64)


def _to_high(durations_s: Array, share: float) -> Array:
    """(n, 3, 8): fourth, fifth and sixth derivative at a share of the segment from what is given at its ends."""
    high = np.arange(_HALF, _ORDER - 1)
    exponents = _POWERS[None, :] - high[:, None]
    values = np.where(exponents >= 0, _FACTORS[high] * np.power(share, np.maximum(exponents, 0)), 0.0)
    return np.asarray(
        (values @ _to_coefficients(durations_s)) / durations_s[:, None, None] ** high[None, :, None], dtype=np.float64
    )
