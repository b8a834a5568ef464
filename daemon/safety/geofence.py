"""The geofence: a cylinder or a polygon with a floor and a ceiling, in local NED about its anchor."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import hypot, inf

from daemon.messages import Vec3

_TOUCH = 1e-9  # share of an edge or of a way by which rounding may miss its end


@dataclass(frozen=True, slots=True)
class Geofence:
    """Where the vehicle may be. Heights are metres above the anchor (up is positive), the rest metres north, east.

    ``polygon_ne_m`` (three corners or more, not crossing itself) replaces the cylinder's ``radius_m``.
    The hard fence lies ``hard_margin_m`` outside of this one: beyond it the vehicle is handed over.
    """

    anchor_ned_m: Vec3 = (0.0, 0.0, 0.0)
    radius_m: float = inf
    polygon_ne_m: tuple[tuple[float, float], ...] = ()
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
    n, e, d = (p - a for p, a in zip(position_ned_m, fence.anchor_ned_m, strict=True))
    if -d > fence.ceiling_m:
        return 2, f"{position_ned_m[2]:g} m is above the fence's ceiling of {fence.ceiling_m:g} m"
    if -d < fence.floor_m:
        return 2, f"{position_ned_m[2]:g} m is below the fence's floor of {fence.floor_m:g} m"
    axis = 0 if abs(n) >= abs(e) else 1
    if fence.polygon_ne_m:
        outside = _polygon_excess(fence.polygon_ne_m, n, e)
        if outside > 0.0:
            return axis, f"{position_ned_m[axis]:g} m is {outside:.1f} m outside the fence's polygon"
    elif hypot(n, e) > fence.radius_m:
        return axis, f"{hypot(n, e):.1f} m from the anchor is outside the fence's radius of {fence.radius_m:g} m"
    return None


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


def _polygon_excess(corners: tuple[tuple[float, float], ...], n: float, e: float) -> float:
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
