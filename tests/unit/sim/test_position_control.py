"""The simulated PX4's outer loops."""

from math import pi, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.frames import down_axis, from_rpy, from_yaw, to_rpy
from daemon.messages import ZERO3
from daemon.sim.estimator import Estimate
from daemon.sim.position_control import PositionControl, Wanted, attitude_of, attitude_rates

angles = st.floats(-1.0, 1.0)


@settings(deadline=None, max_examples=50)
@given(st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)), st.floats(-pi, pi))
def test_attitude_points_the_thrust_and_keeps_the_heading(sideways, yaw):
    wanted = np.array([*sideways, -9.81])
    attitude = attitude_of(tuple(wanted), yaw)
    assert -np.array(down_axis(attitude)) == pytest.approx(wanted / np.linalg.norm(wanted), abs=1e-9)
    difference = to_rpy(attitude)[2] - yaw
    assert np.cos(difference) == pytest.approx(1.0, abs=1e-9)


def test_rates_turn_towards_the_wanted_attitude_at_px4s_gains():
    level = from_yaw(0.3)
    assert attitude_rates(from_rpy(0.1, 0.0, 0.3), level) == pytest.approx((0.4, 0.0, 0.0), abs=1e-3)
    assert attitude_rates(from_rpy(0.0, -0.1, 0.3), level) == pytest.approx((0.0, -0.4, 0.0), abs=1e-3)
    assert attitude_rates(from_yaw(0.4), level) == pytest.approx((0.0, 0.0, 0.28), abs=1e-3)
    assert attitude_rates(from_rpy(0.9, 0.0, 0.3), level)[0] == pytest.approx(4.0 * 2.0 * np.sin(0.45))


@settings(deadline=None, max_examples=50)
@given(angles, angles, st.floats(-pi, pi), angles, angles, st.floats(-pi, pi))
def test_rates_stay_within_px4s_limits(roll, pitch, yaw, roll_2, pitch_2, yaw_2):
    p, q, r = attitude_rates(from_rpy(roll, pitch, yaw), from_rpy(roll_2, pitch_2, yaw_2))
    assert max(abs(p), abs(q)) <= radians(220.0) + 1e-9
    assert abs(r) <= radians(200.0) + 1e-9


def estimate(position=ZERO3, velocity=ZERO3):
    return Estimate(0, position, velocity, from_yaw(0.0), 0.04, 0)


def test_a_vehicle_too_far_north_is_tilted_back_and_at_rest_hovers():
    control = PositionControl(0.5, 0.12)
    there = Wanted(ZERO3, ZERO3, 0.0)
    still = control.run(there, estimate(), radians(45.0))
    assert still.rates_frd_rad_s == pytest.approx(ZERO3)
    assert still.thrust == pytest.approx(0.5)
    north = control.run(there, estimate((1.0, 0.0, 0.0)), radians(45.0))
    assert north.rates_frd_rad_s[1] > 0.3  # nose up
    low = control.run(there, estimate((0.0, 0.0, 1.0)), radians(45.0))
    assert low.thrust > 0.6


def test_thrust_never_falls_below_mpc_thr_min():
    control = PositionControl(0.5, 0.12)
    fast_up = estimate(velocity=(0.0, 0.0, -9.0))
    assert control.run(Wanted(ZERO3, ZERO3, 0.0), fast_up, radians(45.0)).thrust == pytest.approx(0.12)
