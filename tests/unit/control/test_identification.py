from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import TransferFunction, lsim

from daemon.control.identification import (
    Fit,
    Samples,
    ThrustFit,
    answer,
    answer_of_thrust,
    fit_first_order,
    fit_second_order,
    fit_thrust,
    margins,
)
from daemon.control.parameters import ControlParameters, from_airframe


def pulses(seconds: float = 6.0) -> tuple[Samples, Samples]:
    """Commands at 100 Hz: pulses of both signs, 0.5 s each."""
    time = np.arange(0.0, seconds, 0.01)
    return time, np.select([(time % 2 > 0.3) & (time % 2 < 0.8), (time % 2 > 1.0) & (time % 2 < 1.5)], [0.7, -0.7], 0.0)


def responded(
    time: Samples, command: Samples, numerator: list[float], denominator: list[float], delay: float
) -> Samples:
    """Response by scipy's continuous simulation on a fine grid of the held command."""
    fine = np.arange(0.0, time[-1] + 0.01, 0.0005)
    held = command[np.clip(np.searchsorted(time, fine - delay + 1e-12, side="right") - 1, 0, None)]
    held[fine < delay] = 0.0
    _, out, _ = lsim(TransferFunction(numerator, denominator), held, fine, interp=False)
    return np.interp(time, fine, out)


def test_first_order_is_found() -> None:
    time, command = pulses()
    fit = fit_first_order(time, command, responded(time, command, [0.9], [0.055, 1.0], 0.038))
    assert fit.lag_s == pytest.approx(0.055, abs=0.002)
    assert fit.dead_time_s == pytest.approx(0.038, abs=0.003)
    assert fit.gain == pytest.approx(0.9, rel=0.01)
    assert fit.unexplained < 1e-3


@pytest.mark.parametrize(("frequency", "damping", "delay"), [(23.0, 0.8, 0.016), (5.8, 0.92, 0.048)])
def test_second_order_is_found_with_noise(frequency: float, damping: float, delay: float) -> None:
    time, command = pulses(10.0)
    clean = responded(time, command, [1.04], [frequency**-2, 2 * damping / frequency, 1.0], delay)
    noisy = clean + np.random.default_rng(3).normal(0.0, 0.04, len(time)) + 0.05
    fit = fit_second_order(time, command, noisy)
    assert fit.natural_frequency_rad_s == pytest.approx(frequency, rel=0.08)
    assert fit.damping == pytest.approx(damping, rel=0.12)
    assert fit.dead_time_s == pytest.approx(delay, abs=0.008)
    assert fit.gain == pytest.approx(1.04, rel=0.05)


def test_thrust_is_found_from_the_vertical_velocity() -> None:
    """v = -k / ((s + d) (T s + 1)) on the thrust beyond hover, with noise; hover at 0.49 of 20 m/s2."""
    time, steps = pulses(10.0)
    thrust = 0.45 + 0.1 * steps
    beyond_hover = thrust - 0.49
    drag, lag, delay = 1.0, 0.05, 0.025
    beyond_hover = np.concatenate(([0.0], beyond_hover[1:]))
    velocity = responded(time, beyond_hover, [-20.0], [lag, 1.0 + drag * lag, drag], delay)
    started = time > 0.3  # past the switch from rest to the constant part
    noisy = velocity + np.random.default_rng(5).normal(0.0, 0.02, len(time))
    fit = fit_thrust(time[started], thrust[started], noisy[started])
    assert fit.full_thrust_m_s2 == pytest.approx(20.0, rel=0.04)
    assert fit.drag_1_s == pytest.approx(1.0, abs=0.08)
    assert fit.hover_thrust == pytest.approx(0.49, abs=0.005)
    assert fit.dead_time_s + fit.lag_s == pytest.approx(delay + lag, abs=0.015)


def test_thrust_that_does_not_raise_is_refused() -> None:
    time, steps = pulses()
    falling = responded(time, steps, [5.0], [0.05, 1.05, 1.0], 0.02)
    with pytest.raises(ValueError, match="raise"):
        fit_thrust(time, 0.5 + 0.1 * steps, falling)


def test_nothing_to_fit_is_said() -> None:
    time, command = pulses()
    with pytest.raises(ValueError, match="samples"):
        fit_first_order(time[:5], command[:5], command[:5])
    with pytest.raises(ValueError, match="change"):
        fit_first_order(time, command, np.zeros_like(time))
    with pytest.raises(ValueError, match="finite"):
        fit_first_order(time, command, np.full_like(time, np.nan))
    with pytest.raises(ValueError, match="ascend"):
        fit_first_order(time[::-1], command, command)


def test_margins_of_the_attitude_loop_alone_are_those_of_the_textbook() -> None:
    """1 / (s tau (T s + 1)) with tau = 2 T: crossover 0.9102 / tau, phase margin 65.5 degrees."""
    p = replace(ControlParameters(), position_gain_1_s2=(0.0,) * 3, velocity_gain_1_s=(0.0,) * 3)
    found = margins(replace(p, attitude_time_constant_s=(0.1, 0.1, 0.7)), rate_lag_s=0.05)
    assert found.crossover_rad_s == pytest.approx(9.102, rel=1e-3)
    assert found.phase_rad * 180.0 / pi == pytest.approx(65.5, abs=0.2)
    assert found.gain == inf


def test_delay_margin_is_used_up_by_a_delay_of_its_size() -> None:
    p = ControlParameters()
    free = margins(p, rate_lag_s=0.055)
    assert 0.02 < free.delay_s < 0.2
    assert margins(p, rate_lag_s=0.055, unpredicted_delay_s=free.delay_s).phase_rad == pytest.approx(0.0, abs=0.01)
    assert margins(p, rate_lag_s=0.055, unpredicted_delay_s=0.02).gain > 1.0


@pytest.mark.parametrize("lag_s", [0.03, 0.055, 0.1])
def test_derived_gains_keep_their_phase_margin_on_every_airframe(lag_s: float) -> None:
    assert margins(from_airframe(0.5, lag_s), rate_lag_s=lag_s).phase_rad == pytest.approx(
        margins(from_airframe(0.5, 0.055), rate_lag_s=0.055).phase_rad, abs=0.01
    )


def test_gain_margin_is_the_gain_at_which_the_phase_is_a_half_turn() -> None:
    """1 / (s tau (T s + 1)) exp(-s d): a quarter turn, atan(w T) and w d make a half turn."""
    tau, lag_s, delay_s = 0.1, 0.05, 0.03
    at_half_turn = brentq(lambda w: np.arctan(w * lag_s) + w * delay_s - pi / 2, 1.0, 100.0)
    expected = at_half_turn * tau * np.hypot(1.0, at_half_turn * lag_s)
    p = replace(ControlParameters(), position_gain_1_s2=(0.0,) * 3, velocity_gain_1_s=(0.0,) * 3)
    p = replace(p, attitude_time_constant_s=(tau, tau, 0.7))
    found = margins(p, rate_lag_s=lag_s, unpredicted_delay_s=delay_s)
    assert found.gain == pytest.approx(expected, rel=2e-3)
    assert found.delay_s == pytest.approx(found.phase_rad / found.crossover_rad_s)


def test_the_loop_that_is_judged_is_the_one_with_the_larger_horizontal_gains() -> None:
    p = replace(ControlParameters(), position_gain_1_s2=(5.0, 2.0, 90.0), velocity_gain_1_s=(3.2, 1.0, 90.0))
    other = replace(p, position_gain_1_s2=(2.0, 5.0, 1.0), velocity_gain_1_s=(1.0, 3.2, 1.0))
    both = replace(p, position_gain_1_s2=(5.0, 5.0, 1.0), velocity_gain_1_s=(3.2, 3.2, 1.0))
    assert margins(p, rate_lag_s=0.05) == margins(other, rate_lag_s=0.05) == margins(both, rate_lag_s=0.05)


def test_a_fit_answers_as_the_system_that_it_describes() -> None:
    time, command = pulses()
    first = Fit(dead_time_s=0.038, lag_s=0.055, gain=0.9, unexplained=0.0)
    expected = responded(time, command, [0.9], [0.055, 1.0], 0.038)
    assert answer(first, time, command) == pytest.approx(expected, abs=0.025)
    w, z = 12.0, 0.6
    second = Fit(dead_time_s=0.02, lag_s=2.0 * z / w, gain=1.1, unexplained=0.0, natural_frequency_rad_s=w, damping=z)
    expected = responded(time, command, [1.1], [w**-2, 2.0 * z / w, 1.0], 0.02)
    assert answer(second, time, command) == pytest.approx(expected, abs=0.025)


def test_a_fit_of_thrust_answers_with_the_velocity_of_the_body_that_it_describes() -> None:
    """dv/dt = k (hover - lagged thrust) - d v from rest at hover."""
    time, steps = pulses()
    fit = ThrustFit(
        dead_time_s=0.025, lag_s=0.05, full_thrust_m_s2=20.0, drag_1_s=1.0, hover_thrust=0.49, unexplained=0.0
    )
    expected = responded(time, 0.1 * steps, [-20.0], [0.05, 1.05, 1.0], 0.025)
    assert answer_of_thrust(fit, time, 0.49 + 0.1 * steps) == pytest.approx(expected, abs=0.02)


def test_twenty_samples_are_enough_and_each_array_has_to_be_as_long() -> None:
    time, command = pulses()
    time, command = time[20:40], command[20:40]
    fit_first_order(time, command, command)
    for short in (
        (time[:19], command[:19], command[:19]),
        (time, command, command[:19]),
        (time, command[:19], command),
        (time[:19], command, command),
    ):
        with pytest.raises(ValueError, match="samples"):
            fit_first_order(*short)


@pytest.mark.parametrize("place", range(3))
def test_one_number_that_is_not_finite_is_refused(place: int) -> None:
    time, command = pulses()
    arrays = [time.copy(), command.copy(), command.copy()]
    arrays[place][50] = np.nan
    with pytest.raises(ValueError, match="finite"):
        fit_first_order(*arrays)


def test_a_command_that_does_not_change_teaches_nothing_and_times_must_not_repeat() -> None:
    time, command = pulses()
    with pytest.raises(ValueError, match="change"):
        fit_first_order(time, np.full_like(time, 0.3), command)
    twice = time.copy()
    twice[7] = twice[6]
    with pytest.raises(ValueError, match="ascend"):
        fit_first_order(twice, command, command)
