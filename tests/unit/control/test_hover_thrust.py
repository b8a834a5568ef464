from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control.hover_thrust import learn

G = 9.8


def one(hover: float, down: float, dt: float = 0.01, tau: float = 3.0, start: float = 0.5) -> tuple[float, float]:
    return learn(hover, down, dt, start=start, relative_range=0.5, time_constant_s=tau, gravity_m_s2=G)


@given(st.floats(0.3, 0.7), st.floats(-5.0, 5.0))
@settings(deadline=None, max_examples=80)
def test_the_command_that_hovers_does_not_change_by_learning(hover: float, down: float) -> None:
    learned, left = one(hover, down)
    assert learned * (1.0 + left / G) == pytest.approx(hover * (1.0 + down / G), rel=1e-9)


def test_standing_disturbance_becomes_hover_thrust() -> None:
    hover, down = 0.4, G * 0.25  # flies with 0.5 while it believes in 0.4
    for _ in range(2000):
        hover, down = one(hover, down)
    assert hover == pytest.approx(0.5, abs=1e-3) and down == pytest.approx(0.0, abs=0.05)


def test_it_is_slow() -> None:
    hover = 0.4
    down = G * 0.25
    for _ in range(100):
        hover, down = one(hover, down)
    assert 0.41 < hover < 0.44


def test_it_stays_within_its_range_and_the_rest_remains_disturbance() -> None:
    hover, down = 0.7, 8.0
    for _ in range(5000):
        hover, down = one(hover, down)
    assert hover == pytest.approx(0.75) and hover * (1.0 + down / G) == pytest.approx(0.7 * (1.0 + 8.0 / G))


def test_infinite_time_constant_learns_nothing() -> None:
    assert one(0.4, 2.0, tau=inf) == pytest.approx((0.4, 2.0))


def test_a_fall_harder_than_gravity_teaches_nothing() -> None:
    assert one(0.4, -9.5) == (0.4, -9.5)


def test_the_range_is_a_share_of_the_start_below_as_above() -> None:
    """0.5 (1 - 0.5) = 0.25: a vehicle that keeps rising on it is left to the disturbance."""
    hover, down = 0.4, -6.0
    for _ in range(5000):
        hover, down = one(hover, down)
    assert hover == pytest.approx(0.25)
    assert hover * (1.0 + down / G) == pytest.approx(0.4 * (1.0 - 6.0 / G))


def test_a_step_longer_than_the_time_constant_learns_all_of_it_and_no_more() -> None:
    hover, left = one(0.4, 0.2 * G, dt=10.0, tau=3.0)
    assert (hover, left) == pytest.approx((0.48, 0.0))


def test_a_share_of_what_is_left_is_learned_in_a_step() -> None:
    """To first order dt / tau of the disturbance becomes hover thrust."""
    hover, left = one(0.4, 0.01 * G, dt=0.3, tau=3.0)
    assert hover == pytest.approx(0.4 * (1.0 + 0.1 * 0.01), rel=1e-4)
    assert left == pytest.approx(0.009 * G, rel=1e-3)


def test_a_range_of_three_tenths_ends_at_seven_tenths_of_the_start() -> None:
    hover, _ = learn(0.36, -0.9 * G, 10.0, start=0.5, relative_range=0.3, time_constant_s=1.0, gravity_m_s2=G)
    assert hover == pytest.approx(0.35)
    hover, _ = learn(0.6, 2.0 * G, 10.0, start=0.5, relative_range=0.3, time_constant_s=1.0, gravity_m_s2=G)
    assert hover == pytest.approx(0.65)
