from math import exp, nan

import pytest

from daemon.control import observer
from daemon.control.observer import START, Observer, update
from daemon.messages import Vec3


def follow(accelerations: list[Vec3], model: Vec3, bandwidth: float, maximum: float = 6.0) -> list[Observer]:
    """Velocities of a body that accelerates so, observed with a constant model."""
    state, velocity, out = START, (0.0, 0.0, 0.0), []
    for i, a in enumerate(accelerations):
        state = update(state, i * 0.01, velocity, model, bandwidth_rad_s=bandwidth, maximum=maximum)
        velocity = (velocity[0] + a[0] * 0.01, velocity[1] + a[1] * 0.01, velocity[2] + a[2] * 0.01)
        out.append(state)
    return out


def test_step_disturbance_is_learned_as_two_equal_poles_do() -> None:
    out = follow([(2.0, -1.0, 0.5)] * 200, (0.0, 0.0, 0.0), 5.0)
    for i in (20, 50, 100):
        t = 5.0 * i * 0.01
        share = 1.0 - (1.0 + t) * exp(-t)  # step response of w^2 / (s + w)^2
        assert out[i].unexplained[0] == pytest.approx(2.0 * share, abs=0.06)
    assert out[-1].unexplained == pytest.approx((2.0, -1.0, 0.5), abs=0.01)


def test_what_the_model_explains_is_no_disturbance() -> None:
    out = follow([(2.0, -1.0, 0.5)] * 100, (2.0, -1.0, 0.5), 5.0)
    assert out[-1].unexplained == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_bound_is_horizontal_by_norm_and_vertical_and_recovery_does_not_wind_up() -> None:
    out = follow([(30.0, 40.0, -20.0)] * 300 + [(0.0, 0.0, 0.0)] * 300, (0.0, 0.0, 0.0), 5.0, maximum=5.0)
    assert out[299].unexplained == pytest.approx((3.0, 4.0, -5.0), abs=1e-6)
    assert out[-1].unexplained == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert max(abs(o.unexplained[2]) for o in out) <= 5.0


def test_bandwidth_zero_keeps_it_at_zero() -> None:
    assert follow([(2.0, 0.0, 0.0)] * 100, (0.0, 0.0, 0.0), 0.0)[-1].unexplained == (0.0, 0.0, 0.0)


def test_sample_that_is_not_newer_changes_nothing() -> None:
    state = follow([(2.0, 0.0, 0.0)] * 50, (0.0, 0.0, 0.0), 5.0)[-1]
    again = update(state, state.time_s, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0), bandwidth_rad_s=5.0, maximum=6.0)
    assert again is state
    assert update(state, nan, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0), bandwidth_rad_s=5.0, maximum=6.0) is state


def test_gap_between_samples_keeps_what_was_learned_and_takes_the_velocity_anew() -> None:
    state = follow([(2.0, 0.0, 0.0)] * 200, (0.0, 0.0, 0.0), 5.0)[-1]
    later = update(
        state,
        state.time_s + observer.STEP_MAX_S + 0.2,
        (50.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        bandwidth_rad_s=5.0,
        maximum=6.0,
    )
    assert later.unexplained == state.unexplained and later.quantity == (50.0, 0.0, 0.0)


@pytest.mark.parametrize(("gap_s", "anew"), [(0.09, False), (0.11, True)])
def test_a_tenth_of_a_second_is_a_gap(gap_s: float, anew: bool) -> None:
    state = follow([(2.0, 0.0, 0.0)] * 50, (0.0, 0.0, 0.0), 5.0)[-1]
    later = update(state, state.time_s + gap_s, (50.0, 0.0, 0.0), (0.0, 0.0, 0.0), bandwidth_rad_s=5.0, maximum=1e3)
    assert (later.quantity[0] == 50.0) is anew


def test_an_observer_that_is_switched_off_forgets() -> None:
    state = follow([(2.0, 0.0, 0.0)] * 50, (0.0, 0.0, 0.0), 5.0)[-1]
    off = update(state, state.time_s + 0.01, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), bandwidth_rad_s=0.0, maximum=6.0)
    assert off.unexplained == (0.0, 0.0, 0.0)
