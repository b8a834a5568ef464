"""A rate loop of two lags and a delay, integrated finely, followed by the estimate at its own coarse steps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control import lateness
from daemon.control.lateness import IN_TIME, Lateness

DT, FINE_S, LAG_S = 0.01, 0.001, 0.055


def steps(t: float) -> tuple[float, float]:
    """A vehicle that tilts, stops and tilts back, on roll, and half as much on pitch."""
    rate = 3.0 if t % 2.0 < 0.2 else -3.0 if 1.0 < t % 2.0 < 1.2 else 0.0
    return rate, -0.5 * rate


def follow(late_s: float, seconds: float = 4.0, noise_rad_s: float = 0.0, scale: float = 1.0) -> Lateness:
    state, generator = IN_TIME, np.random.default_rng(3)
    first, second = [0.0, 0.0], [0.0, 0.0]
    for i in range(round(seconds / DT)):
        for k in range(round(DT / FINE_S)):
            acting = steps(i * DT + k * FINE_S - late_s)
            for axis in (0, 1):
                first[axis] += (scale * acting[axis] - first[axis]) * FINE_S / LAG_S
                second[axis] += (first[axis] - second[axis]) * FINE_S / 0.03
        commanded = steps(i * DT + 0.5 * DT)
        noise = noise_rad_s * generator.standard_normal(2)
        seen = (second[0] + float(noise[0]), second[1] + float(noise[1]))
        state = lateness.learn(state, (scale * commanded[0], scale * commanded[1]), seen, DT, lag_s=LAG_S)
    return state


@pytest.mark.parametrize("late_s", [0.0, 0.02, 0.04, 0.06])
@pytest.mark.parametrize("noise_rad_s", [0.0, 0.1])
def test_a_late_vehicle_is_found_to_be_late(late_s: float, noise_rad_s: float) -> None:
    assert follow(late_s, noise_rad_s=noise_rad_s).late_s == pytest.approx(late_s, abs=0.006 + 0.3 * late_s)


def test_it_is_known_before_the_vehicle_has_tilted_far() -> None:
    """At 3 rad/s a delay of 40 ms shows within 0.13 s of the command."""
    assert follow(0.04, 0.13).late_s > 0.03
    assert follow(0.0, 0.13).late_s < 0.005


def test_a_hover_says_nothing() -> None:
    assert abs(follow(0.04, noise_rad_s=0.05, scale=0.0).late_s) < 1e-9


def test_what_was_learned_is_forgotten_by_new_turns() -> None:
    state = Lateness(0.08, 15.0)
    for i in range(400):
        rate = steps(i * DT)
        state = lateness.learn(state, rate, state.rates_rad_s, DT, lag_s=LAG_S)
    assert state.late_s < 0.02


rates = st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(rates, rates, st.floats(0.001, 0.1)), max_size=30), st.sampled_from([0.0, 0.055, 2.0]))
def test_it_stays_within_bounds(
    inputs: list[tuple[tuple[float, float], tuple[float, float], float]], lag_s: float
) -> None:
    state = IN_TIME
    states = [state]
    for commanded, measured, dt_s in inputs:
        state = lateness.learn(state, commanded, measured, dt_s, lag_s=lag_s)
        assert abs(state.late_s) <= 0.1 and state.information_rad2_s3 <= 15.0
        states.append(state)
    assert all(b.information_rad2_s3 >= min(a.information_rad2_s3, 15.0) for a, b in pairwise(states))
