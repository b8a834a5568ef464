from math import pi

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon import frames
from daemon.control import attitude_laws
from daemon.messages import IDENTITY, Quat, Vec3

TAU: Vec3 = (0.1, 0.2, 0.4)
angles = st.floats(-3.0, 3.0)
rotations = st.tuples(angles, angles, angles).map(frames.exp)


def matrix(q: Quat) -> np.ndarray:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]]).as_matrix()


@given(rotations, st.tuples(*[st.floats(-1e-4, 1e-4)] * 3))
@settings(deadline=None, max_examples=50)
def test_small_error_over_time_constant_is_the_rate_of_quaternion_and_geometric_law(now: Quat, error: Vec3) -> None:
    desired = frames.multiply(now, frames.exp(error))
    expected = pytest.approx([error[0] / 0.1, error[1] / 0.2, error[2] / 0.4], abs=1e-9)
    assert list(attitude_laws.quaternion(now, desired, TAU)) == expected
    assert list(attitude_laws.geometric(now, desired, TAU)) == expected


@given(rotations, st.tuples(st.floats(-1e-4, 1e-4), st.floats(-1e-4, 1e-4)))
@settings(deadline=None, max_examples=50)
def test_small_tilt_error_over_time_constant_is_the_rate_of_the_jerk_law(now: Quat, error: tuple[float, float]) -> None:
    desired = frames.multiply(now, frames.exp((*error, 0.0)))
    thrust = frames.scale(frames.down_axis(desired), -12.0)
    rates = attitude_laws.jerk_to(now, thrust, frames.down_axis(now), 0.1)
    assert rates == pytest.approx((error[0] / 0.1, error[1] / 0.1, 0.0), abs=1e-7)


@given(rotations, rotations)
@settings(deadline=None, max_examples=50)
def test_geometric_law_is_the_skew_part_of_the_error_matrix(now: Quat, desired: Quat) -> None:
    r, r_d = matrix(now), matrix(desired)
    skew = r_d.T @ r - r.T @ r_d
    vee = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    assert attitude_laws.geometric(now, desired, TAU, original_gain=True) == pytest.approx(-vee / TAU, abs=1e-9)
    assert attitude_laws.geometric(now, desired, TAU) == pytest.approx(-0.5 * vee / TAU, abs=1e-9)


@given(rotations, rotations)
@settings(deadline=None, max_examples=50)
def test_quaternion_law_does_not_depend_on_the_sign_of_a_quaternion(now: Quat, desired: Quat) -> None:
    negative = (-desired[0], -desired[1], -desired[2], -desired[3])
    assert attitude_laws.quaternion(now, desired, TAU) == pytest.approx(
        attitude_laws.quaternion(now, negative, TAU), abs=1e-9
    )


@given(rotations, st.tuples(*[st.floats(-30.0, 30.0)] * 3), st.floats(3.0, 30.0))
@settings(deadline=None, max_examples=50)
def test_jerk_law_turns_the_thrust_axis_with_the_thrust_vector(now: Quat, jerk: Vec3, length: float) -> None:
    thrust = frames.scale(frames.down_axis(now), -length)
    rates = attitude_laws.jerk(now, thrust, jerk)
    dt = 1e-6
    moved = np.array(thrust) + np.array(jerk) * dt
    turned = -np.array(frames.down_axis(frames.integrate(now, rates, dt)))
    expected = (moved / np.linalg.norm(moved) - np.array(thrust) / length) / dt
    assert (turned - np.array(thrust) / length) / dt == pytest.approx(expected, abs=1e-3)


def test_jerk_law_of_no_thrust_does_not_turn() -> None:
    assert attitude_laws.jerk(IDENTITY, (0.0, 0.0, 0.0), (1.0, 2.0, 3.0)) == (0.0, 0.0, 0.0)


@given(rotations, rotations, st.floats(0.0, pi))
@settings(deadline=None, max_examples=80)
def test_tilt_first_keeps_the_thrust_axis_and_limits_the_turn_about_it(now: Quat, desired: Quat, limit: float) -> None:
    near = attitude_laws.tilt_first(now, desired, limit)
    assert frames.down_axis(near) == pytest.approx(frames.down_axis(desired), abs=1e-9)
    tilt_only = Rotation.align_vectors([frames.down_axis(near)], [frames.down_axis(now)])[0]
    about_axis = (tilt_only * Rotation.from_matrix(matrix(now))).inv() * Rotation.from_matrix(matrix(near))
    if frames.dot(frames.down_axis(near), frames.down_axis(now)) > -0.999:
        assert about_axis.magnitude() <= limit + 1e-6


def test_heading_error_does_not_turn_the_tilt_correction_aside() -> None:
    desired = frames.from_rpy(0.3, 0.0, 3.0)  # roll asked for at a heading nearly opposite
    near = attitude_laws.tilt_first(IDENTITY, desired, 0.5)
    x, y, _ = attitude_laws.quaternion(IDENTITY, near, TAU)
    down = frames.down_axis(desired)
    assert (y * down[0] - x * down[1]) / np.hypot(x, y) / np.hypot(down[0], down[1]) > np.cos(0.26)


@given(rotations, st.tuples(*[st.floats(-30.0, 30.0)] * 3))
@example(IDENTITY, (3.0, -5.0, 7.0))
@settings(deadline=None, max_examples=50)
def test_jerk_law_of_a_thrust_that_the_body_does_not_point_along(now: Quat, jerk: Vec3) -> None:
    """The turn of the thrust's direction, by differences, as the body sees it."""
    thrust, dt = (2.0, -3.0, -9.0), 1e-6
    before, after = np.array(thrust) - np.array(jerk) * dt, np.array(thrust) + np.array(jerk) * dt
    turning = (after / np.linalg.norm(after) - before / np.linalg.norm(before)) / (2.0 * dt)
    seen = matrix(now).T @ turning
    assert attitude_laws.jerk(now, thrust, jerk) == pytest.approx((seen[1], -seen[0], 0.0), abs=1e-6)


def test_a_little_thrust_has_a_direction_too() -> None:
    assert attitude_laws.jerk(IDENTITY, (0.0, 0.0, -0.5), (1.0, 0.0, 0.0)) == pytest.approx((0.0, -2.0, 0.0))


def test_a_half_turn_of_the_heading_is_limited_and_an_undefined_one_left_out() -> None:
    near = attitude_laws.tilt_first(IDENTITY, (0.0, 0.0, 0.0, 1.0), 0.5)
    assert frames.angle_between(IDENTITY, near) == pytest.approx(0.5)
    upside_down = (1e-12, 0.6, 0.8, 1e-12)
    assert attitude_laws.tilt_first(IDENTITY, upside_down, 0.5) == upside_down


def test_a_heading_error_within_its_limit_stays_as_it_is() -> None:
    desired = frames.from_rpy(0.2, -0.1, 0.4)
    assert attitude_laws.tilt_first(IDENTITY, desired, 0.5) is desired


@pytest.mark.parametrize("heading_rad", [1.0, -1.0, 3.0, -3.0])
def test_a_heading_error_beyond_its_limit_is_seen_as_the_limit(heading_rad: float) -> None:
    near = attitude_laws.tilt_first(frames.from_yaw(0.3), frames.from_yaw(0.3 + heading_rad), 0.5)
    assert frames.yaw_of(near) == pytest.approx(0.3 + (0.5 if heading_rad > 0.0 else -0.5))
