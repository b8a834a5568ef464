from math import atan2, cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon import frames
from daemon.control import flatness
from daemon.control.parameters import HeadingAxis
from daemon.messages import IDENTITY, Quat, Vec3

upward = st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-20.0, -3.0))
vectors = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
rotations = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(frames.exp)
yaws = st.floats(-pi, pi - 1e-9)


def matrix(q: Quat) -> np.ndarray:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]]).as_matrix()


@given(upward, yaws)
@settings(deadline=None, max_examples=80)
def test_attitude_points_the_thrust_and_the_nose(thrust: Vec3, yaw: float) -> None:
    rotation = matrix(flatness.attitude_from_thrust(thrust, yaw, IDENTITY))
    assert -rotation[:, 2] == pytest.approx(np.array(thrust) / np.linalg.norm(thrust), abs=1e-9)
    assert frames.wrap_pi(atan2(rotation[1, 0], rotation[0, 0]) - yaw) == pytest.approx(0.0, abs=1e-9)


@given(upward, yaws)
@settings(deadline=None, max_examples=50)
def test_lateral_convention_keeps_the_right_side_square_to_the_heading(thrust: Vec3, yaw: float) -> None:
    rotation = matrix(flatness.attitude_from_thrust(thrust, yaw, IDENTITY, HeadingAxis.LATERAL))
    assert -rotation[:, 2] == pytest.approx(np.array(thrust) / np.linalg.norm(thrust), abs=1e-9)
    assert rotation[:, 1] @ np.array([cos(yaw), sin(yaw), 0.0]) == pytest.approx(0.0, abs=1e-9)


@given(rotations, yaws)
@settings(deadline=None, max_examples=20)
def test_free_fall_keeps_the_attitude_of_now(now: Quat, yaw: float) -> None:
    assert flatness.attitude_from_thrust((0.0, 0.0, 0.0), yaw, now) == now


@given(rotations)
@settings(deadline=None, max_examples=30)
def test_heading_along_the_thrust_axis_takes_the_shortest_turn(now: Quat) -> None:
    thrust = (0.0, -9.0, 0.0)  # on its side, and the nose asked for north: the side axis is the thrust axis
    q = flatness.attitude_from_thrust(thrust, 0.0, now)
    axis = np.array([0.0, 1.0, 0.0])
    assert matrix(q)[:, 2] == pytest.approx(axis, abs=1e-9)
    angle = np.arccos(np.clip(matrix(now)[:, 2] @ axis, -1.0, 1.0))
    assert frames.angle_between(now, q) == pytest.approx(angle, abs=1e-6)


def test_shortest_turn_from_upside_down_is_half_a_turn() -> None:
    """Over the nose's axis: the nose stays."""
    q = flatness.shortest_turn(frames.from_rpy(pi, 0.0, 0.4), (0.0, 0.0, 1.0))
    assert matrix(q) == pytest.approx(matrix(frames.from_yaw(0.4)), abs=1e-9)
    assert np.linalg.norm(q) == pytest.approx(1.0)


@pytest.mark.parametrize("axis", HeadingAxis)
@given(thrust=upward, jerk=st.tuples(*[st.floats(-20.0, 20.0)] * 3), yaw=yaws, yaw_rate=st.floats(-2.0, 2.0))
@settings(deadline=None, max_examples=80)
def test_body_rates_are_the_derivative_of_the_attitude(
    axis: HeadingAxis, thrust: Vec3, jerk: Vec3, yaw: float, yaw_rate: float
) -> None:
    def attitude(t: float) -> Quat:
        force = frames.add(thrust, frames.scale(jerk, t))
        return flatness.attitude_from_thrust(force, yaw + yaw_rate * t, IDENTITY, axis)

    assume(frames.tilt_of(attitude(0.0)) < radians(75.0))
    dt = 1e-5
    turned = frames.log(frames.multiply(frames.conjugate(attitude(-dt)), attitude(dt)))
    expected = frames.scale(turned, 0.5 / dt)
    rates = flatness.body_rates(attitude(0.0), thrust, jerk, yaw, yaw_rate, axis)
    assert rates == pytest.approx(expected, abs=1e-4, rel=1e-4)


def test_body_rates_in_free_fall_and_with_the_side_along_the_vertical_are_finite() -> None:
    assert flatness.body_rates(IDENTITY, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, 1.0) == (0.0, 0.0, 0.0)
    on_its_side = frames.from_rpy(pi / 2, 0.0, 0.0)
    thrust = frames.scale(frames.down_axis(on_its_side), -9.0)
    assert flatness.body_rates(on_its_side, thrust, (0.0, 0.0, 3.0), 0.0, 1.0)[2] == 0.0
    on_its_tail = frames.from_rpy(0.0, pi / 2, 0.0)
    thrust = frames.scale(frames.down_axis(on_its_tail), -9.0)
    assert flatness.body_rates(on_its_tail, thrust, (0.0, 0.0, 3.0), 0.0, 1.0, HeadingAxis.LATERAL)[2] == 0.0


@given(rotations, vectors, st.tuples(*[st.floats(0.0, 1.0)] * 3))
@example(frames.from_rpy(0.4, -0.7, 1.1), (3.0, -2.0, 5.0), (0.3, 0.3, 0.3))
@example(frames.from_rpy(0.4, -0.7, 1.1), (3.0, -2.0, 5.0), (0.2, 0.3, 0.3))
@example(frames.from_rpy(0.4, -0.7, 1.1), (3.0, -2.0, 5.0), (0.4, 0.3, 0.3))
@example(frames.from_rpy(0.4, -0.7, 1.1), (3.0, -2.0, 5.0), (0.3, 0.3, 0.2))
@settings(deadline=None, max_examples=50)
def test_rotor_drag_is_against_the_velocity_along_the_body_axes(q: Quat, velocity: Vec3, drag: Vec3) -> None:
    expected = -matrix(q) @ np.diag(drag) @ matrix(q).T @ np.array(velocity)
    assert flatness.rotor_drag(q, velocity, drag) == pytest.approx(expected, abs=1e-9)


@given(upward, vectors)
@settings(deadline=None, max_examples=30)
def test_thrust_rate_is_the_derivative_of_the_length(thrust: Vec3, derivative: Vec3) -> None:
    dt = 1e-6
    ahead = frames.norm(frames.add(thrust, frames.scale(derivative, dt)))
    behind = frames.norm(frames.add(thrust, frames.scale(derivative, -dt)))
    assert flatness.thrust_rate(thrust, derivative) == pytest.approx((ahead - behind) / (2.0 * dt), abs=1e-5)


def test_thrust_rate_in_free_fall_is_zero() -> None:
    assert flatness.thrust_rate((0.0, 0.0, -1e-4), (1.0, 2.0, 3.0)) == 0.0
    assert flatness.thrust_rate((0.0, 0.0, -0.5), (1.0, 2.0, -3.0)) == pytest.approx(3.0)


def test_a_little_thrust_has_a_direction() -> None:
    q = flatness.attitude_from_thrust((0.01, 0.0, -0.01), 0.0, IDENTITY)
    assert frames.down_axis(q) == pytest.approx((-(0.5**0.5), 0.0, 0.5**0.5))
    rates = flatness.body_rates(IDENTITY, (0.0, 0.0, -0.01), (0.0, 0.02, 0.0), 0.0, 0.0)
    assert rates == pytest.approx((2.0, 0.0, 0.0))
