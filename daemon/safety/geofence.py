"""The geofence: a cylinder or a polygon with a floor and a ceiling, in local NED about its anchor."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot, inf

from daemon.messages import Vec3

Corner = tuple[float, float]  # north, east, metres
_AREA_MIN_M2 = 1.0
_TOUCH = 1e-9  # share of an edge or of a way by which rounding may miss its end


@dataclass(frozen=True, slots=True)
class Geofence:
    """Where the vehicle may be. Heights are metres above the anchor (up is positive), the rest metres north, east.

    ``polygon_ne_m`` (three corners or more, not crossing itself) replaces the cylinder's ``radius_m``.
    The hard fence lies ``hard_margin_m`` outside of this one: beyond it the vehicle is handed over.
    """

    anchor_ned_m: Vec3 = (0.0, 0.0, 0.0)
    radius_m: float = inf
    polygon_ne_m: tuple[Corner, ...] = ()
    floor_m: float = -inf
    ceiling_m: float = inf
    hard_margin_m: float = 5.0


def excess_m(fence: Geofence, position_ned_m: Vec3) -> float:
    """How far a position is outside the fence, metres; zero or negative inside, NaN counts as infinitely far."""
    n = position_ned_m[0] - fence.anchor_ned_m[0]
    e = position_ned_m[1] - fence.anchor_ned_m[1]
    height = fence.anchor_ned_m[2] - position_ned_m[2]
    across = _polygon_excess(fence.polygon_ne_m, n, e) if fence.polygon_ne_m else hypot(n, e) - fence.radius_m
    worst = max(across, fence.floor_m - height, height - fence.ceiling_m)
    return inf if worst != worst or across != across or height != height else worst


def violation(fence: Geofence, position_ned_m: Vec3) -> tuple[int, str] | None:
    """Axis (0 north, 1 east, 2 down) and reason in words when a position is outside; None inside."""
    if excess_m(fence, position_ned_m) <= 0.0:
        return None
    n = position_ned_m[0] - fence.anchor_ned_m[0]
    e = position_ned_m[1] - fence.anchor_ned_m[1]
    height = fence.anchor_ned_m[2] - position_ned_m[2]
    if n != n or e != e or height != height:
        return 0, "no number is inside the fence"
    if height > fence.ceiling_m:
        return 2, f"a height of {height:g} m is above the fence's ceiling of {fence.ceiling_m:g} m"
    if height < fence.floor_m:
        return 2, f"a height of {height:g} m is below the fence's floor of {fence.floor_m:g} m"
    axis = 0 if abs(n) >= abs(e) else 1
    if fence.polygon_ne_m:
        outside = _polygon_excess(fence.polygon_ne_m, n, e)
        return axis, f"{position_ned_m[axis]:g} m is {outside:.1f} m outside the fence's polygon"
    return axis, f"{hypot(n, e):.1f} m from the anchor is outside the fence's radius of {fence.radius_m:g} m"


def polygon_fault(corners: Sequence[Corner]) -> str | None:
    """What is wrong with corners that are to enclose a place, or None; a corner may be given twice in a row."""
    around = [b for a, b in zip((*corners[-1:], *corners), corners, strict=False) if a != b]
    edges = list(zip(around, around[1:] + around[:1], strict=True))
    if abs(sum(n0 * e1 - n1 * e0 for (n0, e0), (n1, e1) in edges)) < 2.0 * _AREA_MIN_M2:
        return f"encloses less than {_AREA_MIN_M2:g} m2"
    for i, (a, b) in enumerate(edges):
        for c, d in edges[i + 2 : len(edges) - (i == 0)]:  # the two beside an edge share a corner with it
            if _meet(a, b, c, d):
                return f"crosses itself: its edges {a} to {b} and {c} to {d} meet"
    return None


def _meet(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    """Whether two straight lines have a place in common."""
    if max(a[0], b[0]) < min(c[0], d[0]) or max(c[0], d[0]) < min(a[0], b[0]):
        return False
    if max(a[1], b[1]) < min(c[1], d[1]) or max(c[1], d[1]) < min(a[1], b[1]):
        return False
    return _side(a, b, c) * _side(a, b, d) <= 0.0 and _side(c, d, a) * _side(c, d, b) <= 0.0


def _side(a: Corner, b: Corner, c: Corner) -> float:
    """Positive when ``c`` is on one side of the line from ``a`` to ``b``, negative on the other, zero on it."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def between(fence: Geofence, start_ned_m: Vec3, end_ned_m: Vec3) -> tuple[Vec3, ...]:
    """Places on the straight way between two positions, one of each piece into which the fence's faces cut it.

    None where they do not cut it, and none for a cylinder, which is convex: there the two ends tell all.
    """
    if not fence.polygon_ne_m:
        return ()
    cuts = sorted(share for share in _cuts(fence, start_ned_m, end_ned_m) if 0.0 < share < 1.0)
    (n, e, d), (dn, de, dd) = start_ned_m, (b - a for a, b in zip(start_ned_m, end_ned_m, strict=True))
    middles = (0.5 * (a + b) for a, b in pairwise((0.0, *cuts, 1.0)) if cuts and b - a > _TOUCH)
    return tuple((n + share * dn, e + share * de, d + share * dd) for share in middles)


def _cuts(fence: Geofence, start_ned_m: Vec3, end_ned_m: Vec3) -> Iterator[float]:
    """Shares of a straight way, beyond its ends too, at which it meets the edges, the floor and the ceiling."""
    n, e, d = (p - a for p, a in zip(start_ned_m, fence.anchor_ned_m, strict=True))
    dn, de, dd = (b - a for a, b in zip(start_ned_m, end_ned_m, strict=True))
    if dd != 0.0:
        yield (-fence.floor_m - d) / dd
        yield (-fence.ceiling_m - d) / dd
    corners = fence.polygon_ne_m
    for (n0, e0), (n1, e1) in zip(corners, corners[1:] + corners[:1], strict=True):
        across = dn * (e1 - e0) - de * (n1 - n0)
        if across != 0.0 and -_TOUCH <= ((n0 - n) * de - (e0 - e) * dn) / across <= 1.0 + _TOUCH:
            yield ((n0 - n) * (e1 - e0) - (e0 - e) * (n1 - n0)) / across


def _polygon_excess(corners: tuple[Corner, ...], n: float, e: float) -> float:
    """Signed distance to the polygon's edge: positive outside (even-odd rule)."""
    inside = False
    nearest = inf
    for (n0, e0), (n1, e1) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (e0 > e) != (e1 > e) and n < (n1 - n0) * (e - e0) / (e1 - e0) + n0:
            inside = not inside
        dn, de = n1 - n0, e1 - e0
        length2 = dn * dn + de * de
        along = 0.0 if length2 == 0.0 else min(1.0, max(0.0, ((n - n0) * dn + (e - e0) * de) / length2))
        nearest = min(nearest, hypot(n - n0 - along * dn, e - e0 - along * de))
    return -nearest if inside else nearest
