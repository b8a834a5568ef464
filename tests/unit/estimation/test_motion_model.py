from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon.estimation.motion_model import Member, jacobian, project

numbers = st.floats(-3.0, 3.0)
states = st.lists(numbers, min_size=15, max_size=15).map(lambda x: [*x[:4], x[4] * 0.4, *x[5:]])


@settings(deadline=None, max_examples=60)
@given(x=states, dt=st.floats(0.001, 0.2))
def test_the_jacobian_is_the_derivative(x, dt):
    step = 1e-6
    differences = np.empty((15, 15))
    for column in range(15):
        ahead, behind = list(x), list(x)
        ahead[column] += step
        behind[column] -= step
        differences[:, column] = np.array(project(ahead, dt)) - np.array(project(behind, dt))
    differences[3:6] = (differences[3:6] + pi) % (2 * pi) - pi
    np.testing.assert_allclose(jacobian(x, dt), differences / (2 * step), atol=2e-7)


@settings(deadline=None, max_examples=60)
@given(x=states)
def test_a_short_step_turns_and_moves_as_scipy_says(x):
    dt = 1e-5
    attitude = Rotation.from_euler("ZYX", (x[5], x[4], x[3]))
    y = project(x, dt)
    after = attitude * Rotation.from_rotvec(np.array(x[9:12]) * dt)
    assert (after.inv() * Rotation.from_euler("ZYX", (y[5], y[4], y[3]))).magnitude() < 1e-8
    moved = attitude.apply(np.array(x[6:9]) * dt + 0.5 * np.array(x[12:15]) * dt * dt)
    np.testing.assert_allclose(np.array(y[:3]) - x[:3], moved, atol=1e-14)
    np.testing.assert_allclose(y[6:9], np.array(x[6:9]) + np.array(x[12:15]) * dt, atol=1e-14)


def test_angles_come_out_wrapped():
    x = [0.0] * 15
    x[Member.YAW], x[Member.VYAW] = 3.1, 1.0
    assert project(x, 0.1)[Member.YAW] == pytest.approx(3.2 - 2 * pi, abs=1e-12)


def test_at_the_pole_of_pitch_everything_stays_moderate():
    x = [0.3] * 15
    x[Member.PITCH] = 0.5 * pi
    assert np.abs(project(x, 0.01)).max() < 10.0
    assert np.abs(jacobian(x, 0.01)).max() < 1e5
