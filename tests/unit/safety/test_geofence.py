"""The geofence against shapely-free geometry: distances worked out by hand."""

from math import hypot, inf, nan, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.safety.geofence import Geofence, between, excess_m, polygon_fault, violation

CYLINDER = Geofence(anchor_ned_m=(10.0, 20.0, 1.0), radius_m=50.0, floor_m=0.5, ceiling_m=30.0)
# An L: the notch north-east of (50, 50) is outside.
L_SHAPE = Geofence(polygon_ne_m=((0, 0), (100, 0), (100, 50), (50, 50), (50, 100), (0, 100)), ceiling_m=30.0)
coordinates = st.floats(-300.0, 300.0)


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ((10.0, 20.0, -4.0), -4.5),
        ((70.0, 20.0, -4.0), 10.0),
        ((10.0, -50.0, -4.0), 20.0),
        ((10.0, 20.0, -34.0), 5.0),
        ((10.0, 20.0, 1.0), 0.5),
        ((nan, 20.0, -4.0), inf),
        ((10.0, 20.0, nan), inf),
    ],
)
def test_distance_outside_a_cylinder(position: tuple[float, float, float], expected: float) -> None:
    assert excess_m(CYLINDER, position) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("n", "e", "expected"),
    [(25, 25, -25), (75, 25, -25), (75, 75, 25), (-3, -4, 5), (120, 25, 20), (53, 54, 3), (60, 52, 2), (0, 50, 0)],
)
def test_distance_outside_a_polygon_with_a_notch(n: float, e: float, expected: float) -> None:
    assert excess_m(L_SHAPE, (n, e, -30.0 + 1e-9)) == pytest.approx(max(expected, -1e-9), abs=1e-6)


@given(coordinates, coordinates)
def test_a_many_sided_polygon_is_nearly_its_circle(n: float, e: float) -> None:
    from math import cos, pi, sin

    corners = tuple((100.0 * cos(2 * pi * i / 720), 100.0 * sin(2 * pi * i / 720)) for i in range(720))
    excess = excess_m(Geofence(polygon_ne_m=corners), (n, e, 0.0))
    assert excess == pytest.approx(hypot(n, e) - 100.0, abs=2e-3)


def test_reasons_name_the_axis_and_the_bound() -> None:
    assert violation(CYLINDER, (10.0, 20.0, -250.0)) == (2, "a height of 251 m is above the fence's ceiling of 30 m")
    assert violation(CYLINDER, (10.0, 20.0, 0.9)) == (2, "a height of 0.1 m is below the fence's floor of 0.5 m")
    axis, reason = violation(CYLINDER, (10.0, 120.0, -4.0)) or (None, "")
    assert axis == 1
    assert "100.0 m from the anchor is outside the fence's radius of 50 m" in reason
    axis, reason = violation(L_SHAPE, (80.0, 60.0, -1.0)) or (None, "")
    assert axis == 0
    assert "10.0 m outside" in reason


@given(coordinates, coordinates, coordinates, coordinates)
def test_a_straight_way_is_outside_nowhere_when_it_is_not_at_its_ends_and_between(
    n0: float, e0: float, n1: float, e1: float
) -> None:
    """Against 1000 places of the way; those nearer to the edge than 1 mm are anybody's."""
    start, end = (n0, e0, -5.0), (n1, e1, -20.0)
    looked_at = [excess_m(L_SHAPE, place) > 0.0 for place in (start, *between(L_SHAPE, start, end), end)]
    shares = [i / 999.0 for i in range(1000)]
    along = [
        excess
        for share in shares
        if abs(excess := excess_m(L_SHAPE, (n0 + share * (n1 - n0), e0 + share * (e1 - e0), -10.0))) > 1e-3
    ]
    assert any(looked_at) or all(excess < 0.0 for excess in along)
    assert not all(looked_at) or all(excess > 0.0 for excess in along)


def test_the_pieces_of_a_way_across_the_notch_in_order() -> None:
    pieces = between(L_SHAPE, (90.0, 40.0, -5.0), (40.0, 90.0, -5.0))  # the notch from (80, 50) to (50, 80)
    expected = ((85.0, 45.0, -5.0), (65.0, 65.0, -5.0), (45.0, 85.0, -5.0))
    assert all(piece == pytest.approx(place) for piece, place in zip(pieces, expected, strict=True))
    assert between(L_SHAPE, (10.0, 10.0, -5.0), (20.0, 90.0, -25.0)) == ()
    assert between(CYLINDER, (100.0, 20.0, -5.0), (-100.0, 20.0, -5.0)) == ()


def test_a_way_along_edges_and_through_corners_is_cut_where_it_leaves() -> None:
    u = Geofence(polygon_ne_m=((0, 0), (0, 90), (50, 90), (50, 60), (10, 60), (10, 30), (50, 30), (50, 0)))
    along = between(u, (50.0, 10.0, 0.0), (50.0, 80.0, 0.0))  # on the ends of both arms, across the gap
    assert [violation(u, place) is None for place in along] == [True, False, True]
    through = between(L_SHAPE, (0.0, 100.0, 0.0), (100.0, 0.0, 0.0))  # touches the notch's corner, stays inside
    assert all(violation(L_SHAPE, place) is None for place in through)


def test_a_way_from_below_the_floor_is_looked_at_from_where_it_comes_inside() -> None:
    raised = Geofence(polygon_ne_m=L_SHAPE.polygon_ne_m, floor_m=2.0, ceiling_m=30.0)
    pieces = between(raised, (90.0, 40.0, 0.0), (40.0, 90.0, -20.0))
    assert [violation(raised, place) is None for place in pieces] == [False, True, False, True]


def test_a_way_from_above_the_ceiling_is_looked_at_from_where_it_comes_inside() -> None:
    pieces = between(L_SHAPE, (90.0, 40.0, -35.0), (40.0, 90.0, -5.0))
    assert [violation(L_SHAPE, place) is None for place in pieces] == [False, True, False, True]


@given(coordinates, coordinates, coordinates)
def test_violation_and_distance_agree(n: float, e: float, d: float) -> None:
    for fence in (CYLINDER, L_SHAPE):
        excess = excess_m(fence, (n, e, d))
        if abs(excess) > 1e-9:
            assert (violation(fence, (n, e, d)) is not None) == (excess > 0.0)


def test_the_default_fence_is_no_fence() -> None:
    assert violation(Geofence(), (1e6, sqrt(2) * 1e6, -1e6)) is None


# Right angle at the anchor's corner (10, 20), 30 m north and 40 m east of it; its long edge is 50 m.
TRIANGLE = Geofence(anchor_ned_m=(10.0, 20.0, 0.0), polygon_ne_m=((0.0, 0.0), (30.0, 0.0), (0.0, 40.0)))


@pytest.mark.parametrize(
    ("n", "e", "expected"),
    [
        (15.0, 20.0, 0.0),  # middle of the slanted edge, whose outward normal is (0.8, 0.6)
        (15.0 + 8.0, 20.0 + 6.0, 10.0),
        (15.0 - 4.0, 20.0 - 3.0, -5.0),
        (1.0, 30.0, -1.0),
        (12.0, 26.0, (12.0 * 4.0 + 26.0 * 3.0 - 120.0) / 5.0),
        (33.0, -4.0, 5.0),
        (-3.0, 44.0, 5.0),
        (10.0, -7.0, 7.0),
    ],
)
def test_distance_outside_a_slanted_edge(n: float, e: float, expected: float) -> None:
    assert excess_m(TRIANGLE, (10.0 + n, 20.0 + e, -3.0)) == pytest.approx(expected, abs=1e-9)


def test_a_corner_that_is_given_twice_changes_nothing() -> None:
    twice = Geofence(polygon_ne_m=((40.0, 10.0), (40.0, 10.0), (80.0, 10.0), (80.0, 50.0), (40.0, 50.0)))
    assert excess_m(twice, (43.0, 30.0, 0.0)) == pytest.approx(-3.0)
    assert excess_m(twice, (37.0, 6.0, 0.0)) == pytest.approx(5.0)


def test_the_edges_of_a_small_polygon_are_lines_too() -> None:
    unit = Geofence(polygon_ne_m=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    assert excess_m(unit, (0.5, 3.0, 0.0)) == pytest.approx(2.0)
    assert excess_m(unit, (0.4, 0.5, 0.0)) == pytest.approx(-0.4)


def test_the_fence_itself_is_still_inside() -> None:
    cylinder = Geofence(radius_m=5.0, floor_m=1.0, ceiling_m=30.0)
    square = Geofence(polygon_ne_m=((0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0)))
    assert violation(cylinder, (3.0, 4.0, -10.0)) is None
    assert violation(cylinder, (0.0, 0.0, -30.0)) is None
    assert violation(cylinder, (0.0, 0.0, -1.0)) is None
    assert violation(square, (8.0, 4.0, 0.0)) is None
    assert violation(square, (7.5, 4.0, 0.0)) is None
    assert violation(square, (8.5, 4.0, 0.0)) == (0, "8.5 m is 0.5 m outside the fence's polygon")


def test_of_two_axes_equally_far_out_the_first_is_named() -> None:
    assert (violation(Geofence(radius_m=5.0), (7.0, -7.0, 0.0)) or (None,))[0] == 0


@pytest.mark.parametrize("place", range(3))
def test_no_number_is_infinitely_far_outside(place: int) -> None:
    position = [0.0, 0.0, -4.0]
    position[place] = nan
    for fence in (CYLINDER, L_SHAPE, Geofence(radius_m=5.0)):
        assert excess_m(fence, (position[0], position[1], position[2])) == inf
        assert violation(fence, (position[0], position[1], position[2])) == (0, "no number is inside the fence")


BOX = [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)]


@pytest.mark.parametrize(
    "corners",
    [
        BOX,
        BOX[::-1],
        [*BOX, BOX[0]],
        [BOX[0], *BOX],
        [(0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (50.0, 50.0), (50.0, 100.0), (0.0, 100.0)],
        [(0.0, 0.0), (3.0, 0.0), (0.0, 3.0)],
    ],
)
def test_a_polygon_that_encloses_a_place_is_taken(corners: list[tuple[float, float]]) -> None:
    assert polygon_fault(corners) is None


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([(0.0, 0.0), (9.0, 9.0), (9.0, 0.0), (0.0, 12.0)], "crosses itself"),
        ([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (4.0, 0.0), (0.0, 9.0)], "crosses itself"),
        ([(0.0, 0.0), (30.0, 0.0), (10.0, 5.0), (30.0, 9.0), (10.0, -3.0)], "crosses itself"),
        ([(0.0, 0.0), (5.0, 5.0), (9.0, 9.0)], "less than 1 m2"),
        ([(3.0, 3.0), (3.0, 3.0), (3.0, 3.0)], "less than 1 m2"),
    ],
)
def test_a_polygon_that_crosses_or_touches_itself_or_is_flat_is_not(
    corners: list[tuple[float, float]], words: str
) -> None:
    assert words in (polygon_fault(corners) or "")
    assert words in (polygon_fault(corners[::-1]) or "")
