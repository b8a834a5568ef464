"""Frames and rotations against numpy, scipy and the definitions in words: north, east, down; forward, right, down."""

from math import cos, hypot, inf, nan, pi, radians, sin

import numpy as np
import pymap3d
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon import frames
from daemon.messages import GlobalPosition, Quat, Vec3

NORTH, EAST, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
# No two numbers alike and none 0, 1, 2: a wrong operation cannot come out right.
A, B = (1.3, -2.7, 4.1), (-0.6, 3.4, 5.9)
vectors = st.tuples(*[st.floats(-50.0, 50.0)] * 3)
rotation_vectors = st.tuples(*[st.floats(-1.8, 1.8)] * 3)  # shorter than pi
quaternions = rotation_vectors.map(lambda v: quat(Rotation.from_rotvec(v)))
angles = st.floats(-pi, pi - 1e-9)


def quat(rotation: Rotation) -> Quat:
    x, y, z, w = (float(v) for v in rotation.as_quat())
    return (w, x, y, z)


def rotation_of(q: Quat) -> Rotation:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


def same_rotation(a: Quat, b: Quat) -> bool:
    return abs(abs(float(np.dot(a, b))) - 1.0) < 1e-12


@given(vectors, vectors, st.floats(-9.0, 9.0))
@example(A, B, -3.7)
def test_vectors_add_and_multiply_as_in_numpy(a: Vec3, b: Vec3, factor: float) -> None:
    assert frames.add(a, b) == pytest.approx(np.add(a, b))
    assert frames.subtract(a, b) == pytest.approx(np.subtract(a, b))
    assert frames.scale(a, factor) == pytest.approx(np.multiply(a, factor))
    assert frames.dot(a, b) == pytest.approx(float(np.dot(a, b)), abs=1e-9)
    assert frames.cross(a, b) == pytest.approx(np.cross(a, b), abs=1e-9)
    assert frames.norm(a) == pytest.approx(float(np.linalg.norm(a)))


def test_the_length_of_the_largest_numbers_is_finite() -> None:
    assert frames.norm((3e200, 4e200, 0.0)) == pytest.approx(5e200)


def test_a_vector_is_shortened_only_when_it_is_too_long() -> None:
    assert frames.clip_norm((3.0, 4.0, 12.0), 26.0) == (3.0, 4.0, 12.0)
    assert frames.clip_norm((3.0, 4.0, 12.0), 6.5) == pytest.approx((1.5, 2.0, 6.0))
    assert frames.clip_norm((0.0, 0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("value", "expected"), [(-5.0, -2.0), (-2.0, -2.0), (0.5, 0.5), (3.0, 3.0), (7.0, 3.0)])
def test_clamp(value: float, expected: float) -> None:
    assert frames.clamp(value, -2.0, 3.0) == expected


def test_one_bad_number_makes_a_tuple_not_finite() -> None:
    assert frames.is_finite((1.0, -2.0))
    assert not frames.is_finite((1.0, nan))
    assert not frames.is_finite((-inf, 1.0))


@given(st.floats(-1e4, 1e4))
@example(pi)
@example(-pi)
@example(3.0 * pi)
@example(5.0)
@example(-4.0)
def test_a_wrapped_angle_points_the_same_way_and_lies_in_the_half_open_turn(angle: float) -> None:
    wrapped = frames.wrap_pi(angle)
    assert -pi <= wrapped < pi
    assert (cos(wrapped), sin(wrapped)) == pytest.approx((cos(angle), sin(angle)), abs=1e-8)


def test_an_angle_within_the_turn_is_not_touched() -> None:
    for angle in (-pi, -3.0, 0.1, 3.1):
        assert frames.wrap_pi(angle) == angle


def test_an_angle_just_below_minus_pi_wraps_below_pi() -> None:
    assert frames.wrap_pi(np.nextafter(-pi, -4.0)) == pytest.approx(-pi)


def test_a_unit_quaternion_of_the_same_direction() -> None:
    assert frames.normalized((2.0, -4.0, 5.0, 6.0)) == pytest.approx((2 / 9, -4 / 9, 5 / 9, 6 / 9))


@given(quaternions, quaternions, vectors)
def test_products_and_turns_are_those_of_scipy(a: Quat, b: Quat, v: Vec3) -> None:
    assert same_rotation(frames.multiply(a, b), quat(rotation_of(a) * rotation_of(b)))
    assert frames.rotate(a, v) == pytest.approx(rotation_of(a).apply(v), abs=1e-9)
    assert frames.rotate_inverse(a, v) == pytest.approx(rotation_of(a).inv().apply(v), abs=1e-9)
    assert same_rotation(frames.conjugate(a), quat(rotation_of(a).inv()))


def test_the_product_of_the_units_is_hamiltons() -> None:
    i, j, k = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    assert frames.multiply(i, j) == k
    assert frames.multiply(j, k) == i
    assert frames.multiply(k, i) == j
    assert frames.multiply(i, i) == (-1.0, 0.0, 0.0, 0.0)


@given(rotation_vectors)
@example((1e-7, -2e-7, 3e-7))
@example((0.0, 0.0, 0.0))
def test_exp_and_log_are_those_of_scipy(v: Vec3) -> None:
    q = frames.exp(v)
    expected = quat(Rotation.from_rotvec(v))
    assert q == pytest.approx(expected if expected[0] >= 0.0 else tuple(-c for c in expected), abs=1e-12, rel=1e-9)
    assert frames.log(q) == pytest.approx(v, rel=1e-9, abs=1e-15)
    assert frames.log((-q[0], -q[1], -q[2], -q[3])) == pytest.approx(v, rel=1e-9, abs=1e-15)


def test_exp_has_no_step_where_its_branches_meet() -> None:
    for angle in (0.999e-6, 1.001e-6):
        assert frames.exp((angle, 0.0, 0.0))[1] == pytest.approx(sin(0.5 * angle), rel=1e-14)


def test_a_long_rotation_vector_is_taken_the_shorter_way_back() -> None:
    assert frames.log(frames.exp((0.0, 0.0, 4.0))) == pytest.approx((0.0, 0.0, 4.0 - 2.0 * pi))


@given(quaternions, vectors, st.floats(0.0, 0.1))
def test_constant_rates_turn_about_the_body_axes(q: Quat, rates: Vec3, dt_s: float) -> None:
    turned = frames.integrate(q, rates, dt_s)
    assert same_rotation(turned, quat(rotation_of(q) * Rotation.from_rotvec(np.multiply(rates, dt_s))))


def test_the_smallest_turn_is_half_of_it_in_the_quaternion() -> None:
    """A vector part of half the angle, below and above the angle at which the formula changes."""
    for angle in (1e-9, 0.9e-6, 1.1e-6):
        turned = frames.integrate((1.0, 0.0, 0.0, 0.0), (0.6 * angle, 0.0, -0.8 * angle), 1.0)
        assert turned == pytest.approx((1.0, 0.3 * angle, 0.0, -0.4 * angle), rel=1e-9, abs=1e-20)


def test_integration_ends_on_a_unit_quaternion() -> None:
    assert hypot(*frames.integrate((2.0, 0.0, 0.0, 0.0), A, 0.01)) == pytest.approx(1.0)


@given(quaternions, quaternions)
def test_angle_between_is_that_of_scipy(a: Quat, b: Quat) -> None:
    expected = (rotation_of(a).inv() * rotation_of(b)).magnitude()
    assert frames.angle_between(a, b) == pytest.approx(expected, abs=1e-7)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_roll_pitch_yaw_are_intrinsic_zyx(roll: float, pitch: float, yaw: float) -> None:
    q = frames.from_rpy(roll, pitch, yaw)
    assert same_rotation(q, quat(Rotation.from_euler("ZYX", [yaw, pitch, roll])))
    r, p, y = frames.to_rpy(q)
    assert p == pytest.approx(pitch, abs=1e-7)
    assert frames.wrap_pi(r - roll) == pytest.approx(0.0, abs=1e-7)
    assert frames.wrap_pi(y - yaw) == pytest.approx(0.0, abs=1e-7)
    assert frames.wrap_pi(frames.yaw_of(q) - yaw) == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("pitch", [0.5 * pi, -0.5 * pi])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.4), (0.7, 0.4), (0.3, -3.0)])
def test_at_the_poles_of_pitch_roll_is_zero_and_yaw_gives_the_same_attitude(
    pitch: float, roll: float, yaw: float
) -> None:
    q = frames.from_rpy(roll, pitch, yaw)
    r, p, y = frames.to_rpy(q)
    assert r == 0.0
    assert p == pytest.approx(pitch)
    assert -pi <= y < pi
    assert frames.angle_between(q, frames.from_rpy(r, p, y)) == pytest.approx(0.0, abs=1e-6)


def test_just_beside_a_pole_roll_and_yaw_are_told_apart() -> None:
    angles_rad = (0.3, 0.5 * pi - 1e-4, 0.8)
    assert frames.to_rpy(frames.from_rpy(*angles_rad)) == pytest.approx(angles_rad, abs=1e-6)


def test_signs_of_the_angles() -> None:
    """Clockwise from north seen from above; nose up; right side down."""
    assert frames.rotate(frames.from_yaw(0.5 * pi), NORTH) == pytest.approx(EAST)
    assert frames.rotate(frames.from_rpy(0.0, 0.3, 0.0), NORTH)[2] == pytest.approx(-sin(0.3))
    assert frames.rotate(frames.from_rpy(0.3, 0.0, 0.0), EAST)[2] == pytest.approx(sin(0.3))
    assert frames.from_yaw(0.6) == pytest.approx(frames.from_rpy(0.0, 0.0, 0.6))


@given(quaternions)
def test_axes_and_tilt_are_the_columns_of_the_matrix(q: Quat) -> None:
    matrix = rotation_of(q).as_matrix()
    assert np.array(frames.to_matrix(q)) == pytest.approx(matrix, abs=1e-12)
    assert frames.down_axis(q) == pytest.approx(matrix[:, 2], abs=1e-12)
    assert cos(frames.tilt_of(q)) == pytest.approx(matrix[2, 2], abs=1e-12)
    assert 0.0 <= frames.tilt_of(q) <= pi


def test_tilt_does_not_depend_on_heading() -> None:
    for yaw in (0.0, 1.0, -2.5):
        assert frames.tilt_of(frames.from_rpy(0.0, 0.3, yaw)) == pytest.approx(0.3)
        assert frames.tilt_of(frames.from_rpy(-0.3, 0.0, yaw)) == pytest.approx(0.3)


@given(vectors, angles)
@example(A, 0.7)
def test_a_heading_change_turns_world_vectors_about_down(v: Vec3, yaw: float) -> None:
    expected = Rotation.from_euler("Z", yaw).apply(v)
    assert frames.rotate_about_down(v, yaw) == pytest.approx(expected, abs=1e-9)


@given(quaternions)
@example((1.0, 0.0, 0.0, 0.0))
@example((0.0, 1.0, 0.0, 0.0))
@example((0.0, 0.0, 1.0, 0.0))
@example((0.0, 0.0, 0.0, 1.0))
@example((0.1, -0.3, 0.5, -0.8))
@example((0.1, 0.3, -0.8, 0.5))
@example((0.1, -0.8, 0.3, 0.5))
@example((-0.1, 0.3, 0.5, 0.8))
def test_a_matrix_gives_its_quaternion_back_whichever_component_is_largest(q: Quat) -> None:
    q = frames.normalized(q)
    matrix = rotation_of(q).as_matrix()
    rows = tuple(tuple(float(v) for v in row) for row in matrix)
    found = frames.from_matrix(rows)
    assert found[0] >= 0.0
    assert hypot(*found) == pytest.approx(1.0, abs=1e-12)
    assert same_rotation(found, q)


def test_the_largest_component_is_divided_by_so_that_a_rounded_matrix_stays_a_rotation() -> None:
    """Half turns leave w = 0: from the trace alone nothing but rounding would be left."""
    noise = 3e-9
    for axis in (NORTH, EAST, DOWN, (0.6, 0.0, 0.8), (0.48, 0.64, 0.6)):
        matrix = Rotation.from_rotvec(np.multiply(axis, pi)).as_matrix() + noise * np.arange(9.0).reshape(3, 3)
        rows = tuple(tuple(float(v) for v in row) for row in matrix)
        assert np.abs(frames.from_matrix(rows)[1:]) == pytest.approx(np.array(axis), abs=1e-7)


def test_vectors_from_enu() -> None:
    assert frames.ned_from_enu((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


@given(quaternions, vectors)
def test_an_attitude_from_enu_flu_turns_the_same_physical_vector(q: Quat, v_flu: Vec3) -> None:
    """The same arrow: in FLU, turned in ENU, read in NED; and in FRD, turned in NED."""
    q_ned = frames.attitude_ned_from_enu(q)
    assert q_ned[0] >= 0.0
    in_enu = tuple(float(c) for c in rotation_of(q).apply(v_flu))
    v_frd = (v_flu[0], -v_flu[1], -v_flu[2])
    assert frames.rotate(q_ned, v_frd) == pytest.approx((in_enu[1], in_enu[0], -in_enu[2]), abs=1e-9)


@given(angles)
@example(0.0)
@example(0.5 * pi)
@example(-0.75 * pi)
def test_yaw_from_enu_points_the_same_way(yaw_enu: float) -> None:
    yaw = frames.yaw_ned_from_enu(yaw_enu)
    assert -pi <= yaw < pi
    assert (cos(yaw), sin(yaw)) == pytest.approx((sin(yaw_enu), cos(yaw_enu)), abs=1e-12)


ZURICH = GlobalPosition(47.397742, 8.545594, 488.0)


def test_a_step_in_degrees_is_as_long_as_the_radii_of_curvature_of_wgs84_say() -> None:
    """Meridian and prime vertical radii from the ellipsoid's axis and eccentricity (NIMA TR8350.2)."""
    axis_m, eccentricity2 = 6378137.0, 6.69437999014e-3
    root = (1.0 - eccentricity2 * sin(radians(ZURICH.latitude_deg)) ** 2) ** 0.5
    meridian_m = axis_m * (1.0 - eccentricity2) / root**3 + ZURICH.altitude_amsl_m
    parallel_m = (axis_m / root + ZURICH.altitude_amsl_m) * cos(radians(ZURICH.latitude_deg))
    there = GlobalPosition(ZURICH.latitude_deg + 2e-4, ZURICH.longitude_deg + 3e-4, ZURICH.altitude_amsl_m + 7.0)
    expected = (meridian_m * radians(2e-4), parallel_m * radians(3e-4), -7.0)
    assert frames.ned_from_global(there, ZURICH) == pytest.approx(expected, abs=2e-3)


@given(st.tuples(*[st.floats(-500.0, 500.0)] * 3))
def test_a_global_place_is_where_pymap3d_puts_it(position: Vec3) -> None:
    there = pymap3d.ned2geodetic(*position, ZURICH.latitude_deg, ZURICH.longitude_deg, ZURICH.altitude_amsl_m)
    assert frames.ned_from_global(GlobalPosition(*map(float, there)), ZURICH) == pytest.approx(position, abs=1e-5)


@given(quaternions)
def test_the_shorter_way_is_at_most_half_a_turn(q: Quat) -> None:
    assume(abs(q[0]) > 1e-9)
    assert hypot(*frames.log(q)) <= pi + 1e-12
