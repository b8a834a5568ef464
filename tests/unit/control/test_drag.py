"""A particle under drag and wind whose disturbance is as an observer would see it, flown along a path."""

from math import pi, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.control import drag
from daemon.control.drag import UNKNOWN, Drag
from daemon.messages import Reset, Vec3

DT = 0.01
NONE = (0.0, 0.0, 0.0)


def velocity(t: float, speed: float = 5.0, lap_s: float = 12.0) -> Vec3:
    angle = 2.0 * pi * t / lap_s
    return (speed * sin(angle), 0.5 * speed * sin(2.0 * angle), 0.0)


def learned(
    true_1_s: float,
    seconds: float = 40.0,
    *,
    wind: Vec3 = NONE,
    noise_m_s2: float = 0.0,
    speed: float = 5.0,
    configured: Vec3 = NONE,
    maximum_1_s: float = 2.0,
    start: Drag = UNKNOWN,
) -> Drag:
    state, generator = start, np.random.default_rng(1)
    for i in range(round(seconds / DT)):
        v = velocity(i * DT, speed)
        left = true_1_s - drag.total(state, configured)[0]
        n = noise_m_s2 * generator.standard_normal(2)
        seen = (
            -left * v[0] + true_1_s * wind[0] + float(n[0]),
            -left * v[1] + true_1_s * wind[1] + float(n[1]),
            0.0,
        )
        state = drag.learn(state, v, v, seen, DT, configured_1_s=configured, maximum_1_s=maximum_1_s)
    return state


@pytest.mark.parametrize("true_1_s", [0.0, 0.3, 1.0, 1.8])
def test_drag_is_found_whatever_the_wind(true_1_s: float) -> None:
    found = learned(true_1_s, wind=(6.0, -4.0, 0.0), noise_m_s2=1.0)
    assert found.learned_1_s == pytest.approx(true_1_s, abs=0.03 + 0.03 * true_1_s)


def test_most_of_it_is_found_within_the_first_turns() -> None:
    assert learned(1.0, 12.0).learned_1_s > 0.85


@pytest.mark.parametrize(("configured", "true_1_s"), [(0.5, 0.8), (0.5, 0.2)])
def test_a_wrong_configured_drag_is_corrected_slowly(configured: float, true_1_s: float) -> None:
    def total(seconds: float) -> float:
        given = (configured, configured, configured)
        return drag.total(learned(true_1_s, seconds, configured=given), given)[2]

    assert abs(total(10.0) - configured) < 0.35 * abs(true_1_s - configured)
    assert total(200.0) == pytest.approx(true_1_s, abs=0.02)


def test_nothing_is_learned_in_hover() -> None:
    state = learned(1.0, 12.0)
    kept = state.learned_1_s
    generator = np.random.default_rng(2)
    for _ in range(3000):  # gusts move the vehicle and the disturbance alike
        gust = generator.standard_normal(2)
        moved, pushed = (
            (0.4 * float(gust[0]), 0.4 * float(gust[1]), 0.0),
            (3.0 * float(gust[0]), 3.0 * float(gust[1]), 0.0),
        )
        state = drag.learn(state, NONE, moved, pushed, DT, configured_1_s=NONE, maximum_1_s=2.0)
    assert state.learned_1_s == pytest.approx(kept, abs=0.1)


def test_a_sudden_wind_hardly_moves_what_is_known() -> None:
    state = learned(1.0, 60.0)
    before, largest = state.learned_1_s, 0.0
    for i in range(1000):
        v = velocity(i * DT)
        left = 1.0 - state.learned_1_s
        seen = (5.0 - left * v[0], -left * v[1], 0.0)
        state = drag.learn(state, v, v, seen, DT, configured_1_s=NONE, maximum_1_s=2.0)
        largest = max(largest, abs(state.learned_1_s - before))
    assert largest < 0.12


def test_frozen_while_the_vehicle_does_not_follow() -> None:
    state = learned(1.0, 12.0)
    for i in range(300):
        v = velocity(i * DT)
        after = drag.learn(state, v, frames.scale(v, -1.0), v, DT, configured_1_s=NONE, maximum_1_s=2.0)
        if frames.norm(v) > 1.0:
            assert after.learned_1_s == state.learned_1_s
        state = after


def test_a_reset_of_velocity_and_heading_leaves_what_is_next_as_it_was() -> None:
    state = learned(1.0, 12.0)
    reset = Reset(time_s=1.0, kinds=frozenset(), velocity_ned_m_s=(3.0, -2.0, 0.0), yaw_rad=0.8)
    v, seen = velocity(12.0), (0.4, -0.7, 0.0)
    plain = drag.learn(state, v, v, seen, DT, configured_1_s=NONE, maximum_1_s=2.0)
    v = frames.add(v, reset.velocity_ned_m_s)
    turned = frames.rotate_about_down(seen, reset.yaw_rad)
    moved = drag.learn(drag.shifted(state, reset), v, v, turned, DT, configured_1_s=NONE, maximum_1_s=2.0)
    assert moved.steady_velocity_ne_m_s == pytest.approx(
        np.add(plain.steady_velocity_ne_m_s or (), reset.velocity_ned_m_s[:2]), abs=1e-12
    )
    expected = frames.rotate_about_down((*plain.steady_disturbance_ne_m_s2, 0.0), reset.yaw_rad)
    assert moved.steady_disturbance_ne_m_s2 == pytest.approx(expected[:2], abs=1e-12)


def test_a_pause_keeps_what_was_learned() -> None:
    state = drag.paused(learned(1.0, 12.0))
    assert state.learned_1_s > 0.85
    assert state.steady_velocity_ne_m_s is None


def test_another_configured_drag_starts_anew() -> None:
    state, one = learned(1.0, 12.0), (1.0, 1.0, 1.0)
    state = drag.learn(state, NONE, NONE, NONE, DT, configured_1_s=one, maximum_1_s=2.0)
    assert drag.total(state, one) == one


numbers = st.floats(-1e6, 1e6) | st.sampled_from([0.0, 25.0, -25.0])
vectors = st.tuples(numbers, numbers, numbers)
configured_drags = st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.0, 5.0)) | st.just(NONE)


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(vectors, vectors, vectors, st.floats(0.0, 0.1)), max_size=30), configured_drags)
def test_total_stays_within_its_bounds(inputs: list[tuple[Vec3, Vec3, Vec3, float]], configured: Vec3) -> None:
    state = UNKNOWN
    for reference, moved, seen, dt_s in inputs:
        before = state.learned_1_s
        state = drag.learn(state, reference, moved, seen, dt_s, configured_1_s=configured, maximum_1_s=2.0)
        assert abs(state.learned_1_s - before) <= 0.5 * dt_s + 1e-12
        total = drag.total(state, configured)
        assert min(total) >= -1e-12
        assert max(total) <= max(2.0, *configured) + 1e-12


def test_a_step_by_hand() -> None:
    """Rate -(z u) / information, and a high-pass of three seconds: z = (3, 1), u = (-0.9, 0.6)."""
    state = Drag(0.2, 50.0, (1.0, -2.0), (0.3, 0.4))
    v = (4.0, -1.0, 9.0)
    after = drag.learn(state, v, v, (-0.6, 1.0, 9.0), 0.05, configured_1_s=NONE, maximum_1_s=2.0)
    share = 0.05 / 3.05
    assert after.learned_1_s == pytest.approx(0.2 + (2.7 - 0.6) / 50.0 * 0.05)
    assert after.information_m2_s == pytest.approx(50.0 + 10.0 * 0.05)
    assert after.steady_velocity_ne_m_s == pytest.approx((1.0 + 3.0 * share, -2.0 + share))
    assert after.steady_disturbance_ne_m_s2 == pytest.approx((0.3 - 0.9 * share, 0.4 + 0.6 * share))


@pytest.mark.parametrize(("apart_m_s", "follows"), [(2.4, True), (2.6, False)])
def test_following_is_a_metre_a_second_and_three_tenths_of_the_speed(apart_m_s: float, follows: bool) -> None:
    state = Drag(0.2, 50.0, (1.0, -2.0), (0.3, 0.4))
    flown = (3.0 + 0.6 * apart_m_s, 4.0 - 0.8 * apart_m_s, 0.0)
    after = drag.learn(state, (3.0, 4.0, 0.0), flown, (-0.6, 1.0, 0.0), DT, configured_1_s=NONE, maximum_1_s=2.0)
    assert (after.learned_1_s != 0.2) is follows


def test_each_axis_has_its_configured_drag_and_what_was_learned() -> None:
    assert drag.total(Drag(0.5), (0.1, 0.2, 0.3)) == pytest.approx((0.6, 0.7, 0.8))


def test_what_is_learned_keeps_the_sum_between_nothing_and_the_maximum() -> None:
    configured = (0.3, 0.2, 0.4)
    for push, bound in ((50.0, -0.2), (-50.0, 1.0 - 0.4)):
        state = Drag(0.0, 6.0, (0.0, 0.0), (0.0, 0.0), configured)
        for i in range(2000):
            v = (5.0, 0.0, 0.0) if i % 200 < 100 else (-5.0, 0.0, 0.0)
            seen = (push * v[0], 0.0, 0.0)
            state = drag.learn(state, v, v, seen, DT, configured_1_s=configured, maximum_1_s=1.0)
        assert state.learned_1_s == pytest.approx(bound)
