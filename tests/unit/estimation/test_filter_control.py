import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from daemon.estimation.filter_control import (
    AccelerationControl,
    ControlParameters,
    VelocityControl,
    control_acceleration,
    controlled,
)

STANDING = [0.0] * 15
PARAMETERS = ControlParameters(
    timeout_s=0.5,
    acceleration_limits=(1.0,) * 6,
    acceleration_gains=(0.8,) * 6,
    deceleration_limits=(1.3,) * 6,
    deceleration_gains=(1.0,) * 6,
)


def velocity(vx):
    x = list(STANDING)
    x[6] = vx
    return x


@pytest.mark.parametrize(
    ("state", "command", "acceleration"),
    [
        (0.0, 1.0, 0.8),  # gain of acceleration
        (0.0, 5.0, 1.0),  # limit of acceleration
        (1.0, 0.5, -0.5),  # slowing down to something: gain of deceleration
        (5.0, 0.0, -1.3),  # limit of deceleration
        (-0.005, 1.0, 0.804),  # within the margin of noise about standstill: still speeding up
        (1.0, -1.0, -1.3),  # other way: down to zero first
    ],
)
def test_velocity_error_becomes_a_limited_acceleration(state, command, acceleration):
    control = VelocityControl(0.0, (command, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert control_acceleration(velocity(state), control, 0.1, PARAMETERS)[0] == pytest.approx(acceleration)


@pytest.mark.parametrize("at_s", [0.5, 7.0, float("nan")])
def test_a_stale_velocity_command_means_standstill(at_s):
    control = VelocityControl(0.0, (2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert control_acceleration(velocity(1.0), control, at_s, PARAMETERS)[0] == pytest.approx(-1.0)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_command_that_is_not_finite_counts_as_stale(bad):
    assert control_acceleration(
        velocity(1.0), VelocityControl(0.0, (bad, 0, 0, 0, 0, 0)), 0.1, PARAMETERS
    ) == pytest.approx((-1.0, 0, 0, 0, 0, 0))
    assert control_acceleration(STANDING, AccelerationControl(0.0, (bad, 0, 0)), 0.1, PARAMETERS)[0] == 0.0


def test_axes_without_control_are_left_alone():
    parameters = ControlParameters(axes=(True, False, False, False, False, True))
    control = VelocityControl(0.0, (1.0,) * 6)
    acceleration = control_acceleration(STANDING, control, 0.0, parameters)
    assert [a is None for a in acceleration] == [False, True, True, True, True, False]
    x = [0.1 * i for i in range(15)]
    y = controlled(x, acceleration, 0.1)
    assert y[12:] == [1.0, x[13], x[14]]
    assert y[9:12] == pytest.approx([x[9], x[10], x[11] + 0.1])


def test_acceleration_of_the_world_moves_a_turning_body_as_newton_says():
    """Independent: the velocity in the body of a point with constant acceleration in NED, body turning at w."""
    rates = np.array((0.4, -0.3, 0.9))
    wanted = np.array((0.5, -0.2, 0.3))
    start = Rotation.from_euler("ZYX", (0.7, 0.1, -0.2))
    v_ned = np.array((2.0, -1.0, 0.5))

    def body_velocity(t):
        return (start * Rotation.from_rotvec(rates * t)).inv().apply(v_ned + wanted * t)

    def slope(t, v):
        attitude = start * Rotation.from_rotvec(rates * t)
        yaw, pitch, roll = attitude.as_euler("ZYX")
        x = [0.0, 0.0, 0.0, roll, pitch, yaw, *v, *rates, 0.0, 0.0, 0.0]
        parameters = ControlParameters(acceleration_limits=(20.0,) * 6)
        return control_acceleration(x, AccelerationControl(t, tuple(wanted)), t, parameters)[:3]

    flown = solve_ivp(slope, (0.0, 1.0), body_velocity(0.0), rtol=1e-9, atol=1e-10).y[:, -1]
    np.testing.assert_allclose(flown, body_velocity(1.0), atol=1e-7)


def test_commanded_acceleration_is_limited_and_runs_out():
    parameters = ControlParameters(timeout_s=0.2, acceleration_limits=(2.0,) * 6)
    control = AccelerationControl(0.0, (9.0, -1.0, 0.0))
    assert control_acceleration(STANDING, control, 0.1, parameters) == (2.0, -1.0, 0.0, None, None, None)
    assert control_acceleration(STANDING, control, 0.2, parameters) == (0.0, 0.0, 0.0, None, None, None)
