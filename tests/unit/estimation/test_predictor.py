from math import cos, inf, isfinite, nan, pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from daemon import frames
from daemon.estimation import predictor
from daemon.estimation.predictor import PredictorParameters, SentRates, predict
from daemon.messages import IDENTITY, ZERO3, EstimatedState

PARAMETERS = PredictorParameters()


def at(time_s=100.0, velocity=ZERO3, attitude=IDENTITY, rates=ZERO3):
    return EstimatedState(time_s, (1.0, 2.0, -3.0), velocity, attitude, rates, 0.05)


def test_position_and_velocity_follow_the_acceleration():
    ahead = predict(at(velocity=(1.0, -2.0, 0.5)), 100.2, (3.0, 0.0, -1.0), parameters=PARAMETERS)
    assert ahead.time_s == pytest.approx(100.2)
    assert ahead.velocity_ned_m_s == pytest.approx((1.6, -2.0, 0.3))
    assert ahead.position_ned_m == pytest.approx((1.0 + 0.2 + 0.06, 2.0 - 0.4, -3.0 + 0.1 - 0.02))
    assert ahead.position_variance_m2 == 0.05


def test_without_commands_the_measured_rates_stay():
    ahead = predict(at(rates=(0.0, 0.0, 2.0)), 100.25, ZERO3, parameters=PARAMETERS)
    assert frames.yaw_of(ahead.attitude_wb) == pytest.approx(0.5)
    assert ahead.rates_frd_rad_s == pytest.approx((0.0, 0.0, 2.0))


def delayed_lag(commands, axis, rate, duration_s):
    """Angle and rate of the dead time and the lag, by scipy; the time is that since the state."""
    dead, lag = PARAMETERS.rate_dead_time_s[axis], PARAMETERS.rate_time_constant_s[axis]

    def command(t):
        acting = [c.rates_frd_rad_s[axis] for c in commands if c.time_s - 100.0 + dead <= t]
        return acting[-1] if acting else rate

    solution = solve_ivp(
        lambda t, y: (y[1], (command(t) - y[1]) / lag), (0.0, duration_s), (0.0, rate), max_step=2e-4, rtol=1e-8
    )
    return solution.y[0, -1], solution.y[1, -1]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_command_on_its_way_acts_after_dead_time_and_lag(axis):
    values = [0.5, -1.0, 2.0, 2.0, -0.3, 1.5, 0.7, -2.0]
    commands = tuple(
        SentRates(99.87 + 0.02 * i, tuple(v if a == axis else 0.0 for a in range(3))) for i, v in enumerate(values)
    )
    rates = tuple(0.8 if a == axis else 0.0 for a in range(3))
    ahead = predict(at(rates=rates), 100.07, ZERO3, commands, parameters=PARAMETERS)
    angle, rate = delayed_lag(commands, axis, 0.8, 0.07)
    assert frames.log(ahead.attitude_wb)[axis] == pytest.approx(angle, abs=1e-4)
    assert ahead.rates_frd_rad_s[axis] == pytest.approx(rate, abs=2e-3)


def test_turning_about_several_axes_is_near_the_true_motion():
    start = frames.from_rpy(0.3, -0.2, 1.0)
    command = (SentRates(99.0, (1.5, -1.0, 0.5)),)
    ahead = predict(at(attitude=start, rates=(0.0, 0.5, 0.0)), 100.05, ZERO3, command, parameters=PARAMETERS)
    turning = Rotation.from_quat(start, scalar_first=True)
    dt = 1e-4
    for k in range(500):
        t = (k + 0.5) * dt
        rates = [
            c + (m - c) * np.exp(-t / lag)
            for c, m, lag in zip((1.5, -1.0, 0.5), (0.0, 0.5, 0.0), PARAMETERS.rate_time_constant_s, strict=True)
        ]
        turning = turning * Rotation.from_rotvec(np.array(rates) * dt)
    apart = turning.inv() * Rotation.from_quat(ahead.attitude_wb, scalar_first=True)
    assert apart.magnitude() < 0.001


def test_prediction_ends_at_the_horizon_and_never_goes_back():
    state = at(velocity=(1.0, 0.0, 0.0))
    far = predict(state, 200.0, ZERO3, parameters=PARAMETERS)
    assert far.time_s == pytest.approx(100.5)
    assert far.position_ned_m[0] == pytest.approx(1.5)
    assert predict(state, 99.0, ZERO3, parameters=PARAMETERS) is state
    assert predict(state, nan, ZERO3, parameters=PARAMETERS) is state


def test_predicting_in_two_steps_is_predicting_at_once():
    commands = (SentRates(99.99, (1.0, 0.0, 0.0)), SentRates(100.01, (-1.0, 0.0, 0.0)))
    once = predict(at(), 100.1, (1.0, 2.0, 3.0), commands, parameters=PARAMETERS)
    half = predict(at(), 100.06, (1.0, 2.0, 3.0), commands, parameters=PARAMETERS)
    twice = predict(half, 100.1, (1.0, 2.0, 3.0), commands, parameters=PARAMETERS)
    assert twice.position_ned_m == pytest.approx(once.position_ned_m)
    assert twice.rates_frd_rad_s == pytest.approx(once.rates_frd_rad_s)
    assert frames.angle_between(twice.attitude_wb, once.attitude_wb) < 1e-9


def test_an_absurd_acceleration_is_believed_up_to_a_bound():
    ahead = predict(at(), 100.1, (1e6, 0.0, 0.0), parameters=PARAMETERS)
    assert ahead.velocity_ned_m_s[0] == pytest.approx(0.1 * PARAMETERS.acceleration_max_m_s2)


def test_commands_are_kept_for_as_long_as_they_can_act():
    commands = ()
    for i in range(300):
        commands = predictor.remembered(commands, 100.0 + 0.01 * i, (0.01 * i, 0.0, 0.0), parameters=PARAMETERS)
    looks_back_s = PARAMETERS.horizon_s + max(PARAMETERS.rate_dead_time_s)
    assert commands[-1].time_s == pytest.approx(102.99)
    assert commands[0].time_s <= 102.99 - looks_back_s <= commands[1].time_s


anything = st.floats() | st.sampled_from([nan, inf, -inf, 1e300, -1e300, 0.0])
vector = st.tuples(anything, anything, anything)


@settings(deadline=None, max_examples=200)
@given(
    to_s=anything,
    acceleration=vector,
    rates=vector,
    sent=st.lists(st.tuples(anything, vector), max_size=5),
    yaw=st.floats(-pi, pi),
)
def test_nothing_makes_the_prediction_infinite(to_s, acceleration, rates, sent, yaw):
    state = at(attitude=(cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)), rates=rates)
    commands = tuple(SentRates(t, v) for t, v in sent)
    ahead = predict(state, to_s, acceleration, commands, parameters=PARAMETERS)
    if ahead is state:
        return
    numbers = (ahead.time_s, *ahead.position_ned_m, *ahead.velocity_ned_m_s, *ahead.attitude_wb, *ahead.rates_frd_rad_s)
    assert all(isfinite(v) for v in numbers)
    assert sum(v * v for v in ahead.attitude_wb) == pytest.approx(1.0)
    assert max(abs(v) for v in ahead.rates_frd_rad_s) <= PARAMETERS.rates_max_rad_s
