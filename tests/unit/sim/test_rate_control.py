"""PX4's rate loop in the simulation: filters, mixing, limits."""

from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter

from daemon.messages import ZERO3
from daemon.sim import airframe_files
from daemon.sim.rate_control import LowPass3, RateLoop

SIH = airframe_files.load("sih")
X500 = airframe_files.load("x500")


def test_the_gyro_filter_is_a_second_order_butterworth():
    samples = np.random.default_rng(1).standard_normal((200, 3))
    filtered = LowPass3(40.0)
    mine = [filtered.update(tuple(sample)) for sample in samples.tolist()]
    b, a = butter(2, 40.0, fs=250.0)
    assert np.array(mine) == pytest.approx(lfilter(b, a, samples, axis=0), abs=1e-9)


@pytest.mark.parametrize(("axis", "signs"), [(0, (-1, 1, 1, -1)), (1, (1, -1, 1, -1)), (2, (1, 1, -1, -1))])
def test_a_wanted_rate_raises_the_rotors_of_its_side(axis, signs):
    loop = RateLoop(SIH, 0.0)
    rates = [0.0, 0.0, 0.0]
    rates[axis] = 0.5
    signals = loop.run(tuple(rates), 0.5, False)
    assert tuple(np.sign(np.array(signals) - 0.5).astype(int)) == signs
    assert np.mean(signals) == pytest.approx(0.5)


def test_roll_gain_is_that_of_px4s_normalized_allocation():
    """A unit of roll torque moves each rotor of an x by 1/sqrt(2): 0.15 rad/s error x MC_ROLLRATE_P 0.15."""
    signals = RateLoop(SIH, 0.0).run((0.15, 0.0, 0.0), 0.5, False)
    assert signals[1] - 0.5 == pytest.approx(0.15 * 0.15 / np.sqrt(2.0), rel=1e-6)


def test_a_nan_rate_asks_for_no_torque_and_a_nan_thrust_stops_the_motors():
    loop = RateLoop(SIH, 0.0)
    assert loop.run((nan, 0.0, nan), 0.4, False) == pytest.approx((0.4,) * 4)
    assert loop.run((1.0, 0.0, 0.0), nan, False) == (0.0,) * 4


def test_thrust_command_is_linear_in_force_when_the_curve_is_known():
    for factor in (0.0, 0.3, 1.0):
        signal = RateLoop(X500, factor).run(ZERO3, 0.49, False)[0]
        assert factor * signal**2 + (1.0 - factor) * signal == pytest.approx(0.49)


def test_a_rate_that_is_not_a_number_asks_for_nothing_but_keeps_the_integral():
    loop = RateLoop(SIH, 0.0)
    for _ in range(250):
        loop.run((0.1, 0.0, 0.0), 0.5, False)
    kept = 0.5 + 0.2 * 0.1 * 1.0 / np.sqrt(2.0)
    assert loop.run((np.nan, 0.0, 0.0), 0.5, False)[1] == pytest.approx(kept, rel=1e-3)
    assert loop.run((np.nan, 0.0, 0.0), 0.5, False)[1] == pytest.approx(kept, rel=1e-3)


def test_the_integral_takes_out_a_standing_error_waits_on_the_ground_and_goes_with_disarming():
    loop = RateLoop(SIH, 0.0)
    first = loop.run((0.1, 0.0, 0.0), 0.5, False)[1]
    for _ in range(250):
        later = loop.run((0.1, 0.0, 0.0), 0.5, False)[1]
    assert later - first == pytest.approx(0.2 * 0.1 * 1.0 / np.sqrt(2.0), rel=0.02)
    for _ in range(250):
        landed = loop.run((0.1, 0.0, 0.0), 0.5, True)[1]
    assert landed == pytest.approx(later, rel=1e-3)
    loop.stop()
    assert loop.run((0.1, 0.0, 0.0), 0.5, True)[1] == pytest.approx(first)


def test_roll_and_pitch_come_before_yaw_at_the_limit():
    alone = RateLoop(SIH, 0.0).run((2.0, 0.0, 0.0), 0.9, False)
    both = RateLoop(SIH, 0.0).run((2.0, 0.0, 3.0), 0.9, False)
    assert max(both) <= 1.0
    roll_alone, roll_both = (s[1] + s[2] - s[0] - s[3] for s in (alone, both))
    assert roll_both == pytest.approx(roll_alone, abs=1e-9)


numbers = st.floats(allow_nan=True, allow_infinity=True)


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(st.tuples(numbers, numbers, numbers), numbers), min_size=1, max_size=5))
def test_signals_stay_within_0_and_1_whatever_is_asked(wishes):
    loop = RateLoop(X500, 1.0)
    for rates, thrust in wishes:
        loop.sense((0.1, -0.2, 0.3))
        for signal in loop.run(rates, thrust, False):
            assert 0.0 <= signal <= 1.0


def test_near_zero_thrust_the_torque_gives_way_and_not_the_thrust():
    signals = RateLoop(SIH, 0.0).run((3.0, 0.0, 0.0), 0.05, False)
    assert np.mean(signals) == pytest.approx(0.05)
    assert min(signals) == pytest.approx(0.0, abs=1e-9)


def test_a_saturated_axis_does_not_wind_up():
    loop = RateLoop(SIH, 0.0)
    for _ in range(250):
        loop.run((3.0, 0.0, 0.0), 0.05, False)
    at_rest = loop.run((0.0, 0.0, 0.0), 0.5, False)
    assert at_rest == pytest.approx((0.5,) * 4, abs=0.003)
