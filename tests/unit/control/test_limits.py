from math import cos, hypot, inf, nan, radians, sin

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.control import limits
from daemon.messages import Quat, Setpoint, Vec3

TILT, FULL, LEAST = radians(35.0), 19.0, 3.0
vectors = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


def cut(thrust: Vec3) -> tuple[Vec3, bool]:
    return limits.thrust_vector(thrust, tilt_max_rad=TILT, full_m_s2=FULL, vertical_min_m_s2=LEAST)


@given(vectors)
@settings(deadline=None, max_examples=100)
def test_thrust_vector_stays_within_tilt_full_thrust_and_upward(thrust: Vec3) -> None:
    (x, y, z), _ = cut(thrust)
    assert -z >= LEAST
    assert frames.norm((x, y, z)) <= FULL + 1e-9
    assert hypot(x, y) <= -z * 0.7002076  # tan 35 deg
    assert x * thrust[1] == pytest.approx(y * thrust[0], rel=1e-6, abs=1e-6)


def test_thrust_vector_within_limits_is_left_alone() -> None:
    assert cut((2.0, -1.0, -9.8)) == ((2.0, -1.0, -9.8), False)


def test_height_comes_before_tilt_when_thrust_runs_out() -> None:
    (x, _, z), was_cut = limits.thrust_vector(
        (15.0, 0.0, -16.0), tilt_max_rad=radians(60.0), full_m_s2=19.0, vertical_min_m_s2=3.0
    )
    assert was_cut and z == -16.0
    assert x == pytest.approx((19.0**2 - 16.0**2) ** 0.5)


def guarded(rates: Vec3, q: Quat, now: Vec3 = (0.0, 0.0, 0.0)) -> Vec3:
    return limits.tilt_guard(rates, q, now, tilt_max_rad=TILT, rate_lag_s=0.05)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-20.0, 20.0)] * 3))
@example((0.00390625, 0.00390625, 0.0), (0.0, 18.0, 0.0))
@settings(deadline=None, max_examples=100)
def test_guard_bounds_the_outward_turn(rotation: Vec3, rates: Vec3) -> None:
    q: Quat = frames.exp(rotation)
    x, y, z = guarded(rates, q)
    tilt, dt = frames.tilt_of(q), 1e-8  # short: across the tilt it turns at up to rate^2 / tilt
    assert z == rates[2]
    if 1e-3 < tilt < 3.1:
        outward = (frames.tilt_of(frames.integrate(q, (x, y, z), dt)) - tilt) / dt
        assert outward <= (TILT - tilt) / 0.05 + 1e-2


def test_guard_leaves_inward_rates_alone() -> None:
    q = frames.from_rpy(radians(20.0), 0.0, 0.0)
    assert guarded((-3.0, 0.5, 1.0), q) == (-3.0, 0.5, 1.0)


@pytest.mark.parametrize("late_s", [0.02, 0.04, 0.06])
def test_guarded_turn_of_a_late_vehicle_stops_at_the_limit_too(late_s: float) -> None:
    """The command acts later than the guard believes: it sees the rate that there would be without the delay."""
    dt, q, commanded = 0.001, frames.exp((0.0, 0.0, 0.0)), [0.0] * 2001
    true = believed = largest = 0.0
    for i in range(2000):
        commanded[i] = limits.tilt_guard(
            (3.8, 0.0, 0.0), q, (believed, 0.0, 0.0), tilt_max_rad=TILT, rate_lag_s=0.05, late_s=late_s
        )[0]
        believed += (commanded[i] - believed) * dt / 0.05
        true += (commanded[max(i - round(late_s / dt), 0)] - true) * dt / 0.05
        q = frames.integrate(q, (true, 0.0, 0.0), dt)
        largest = max(largest, frames.tilt_of(q))
    assert 0.9 * TILT < largest < TILT + 0.005


def test_guarded_turn_with_the_lag_stops_at_the_limit() -> None:
    q, rate, dt = frames.from_rpy(0.1, 0.0, 0.5), 0.0, 0.001
    largest = 0.0
    for _ in range(2000):
        wanted = guarded((3.0, 0.0, 0.0), q, (rate, 0.0, 0.0))[0]
        rate += (wanted - rate) * dt / 0.05
        q = frames.integrate(q, (rate, 0.0, 0.0), dt)
        largest = max(largest, frames.tilt_of(q))
    assert largest == pytest.approx(TILT, abs=radians(0.1))


def test_slew_is_bounded_per_step_and_reaches_the_target() -> None:
    last, wanted = Setpoint((0.0, 0.0, 0.0), 0.5), Setpoint((3.0, 4.0, -2.0), 0.9)
    step = limits.toward(last, wanted, rate_step_rad_s=0.5, thrust_step=0.1)
    assert step.rates_frd_rad_s == pytest.approx((0.3, 0.4, -0.5))
    assert step.thrust == pytest.approx(0.6)
    for _ in range(20):
        last = limits.toward(last, wanted, rate_step_rad_s=0.5, thrust_step=0.1)
    assert last.rates_frd_rad_s == pytest.approx((3.0, 4.0, -2.0)) and last.thrust == pytest.approx(0.9)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize("place", range(4))
def test_last_check_replaces_what_is_not_finite(bad: float, place: int) -> None:
    numbers = [0.1, 0.2, 0.3, 0.5]
    numbers[place] = bad
    out = limits.within(
        Setpoint((numbers[0], numbers[1], numbers[2]), numbers[3]),
        rate_max_rad_s=3.0,
        yaw_rate_max_rad_s=1.0,
        thrust_min=0.1,
        thrust_max=0.9,
        fallback_thrust=0.4,
    )
    assert out.rates_frd_rad_s == (0.0, 0.0, 0.0) and out.thrust == 0.4


def test_rates_and_thrust_are_cut_at_their_limits_with_the_direction_of_the_tilt_kept() -> None:
    out = limits.within(
        Setpoint((3.0, -4.0, 9.0), 1.4),
        rate_max_rad_s=2.5,
        yaw_rate_max_rad_s=1.0,
        thrust_min=0.1,
        thrust_max=0.9,
        fallback_thrust=0.4,
    )
    assert out.rates_frd_rad_s == pytest.approx((1.5, -2.0, 1.0)) and out.thrust == 0.9


tilts = st.tuples(st.floats(0.05, 1.2), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))


@given(tilts, st.tuples(*[st.floats(-9.0, 9.0)] * 3), st.tuples(*[st.floats(-4.0, 4.0)] * 3))
@example((0.4, 0.5, 1.0), (8.0, -6.0, 1.0), (1.5, 2.0, 0.0))
@example((0.4, 2.5, 1.0), (8.0, -6.0, 1.0), (1.5, 2.0, 0.0))
@example((0.4, -0.7, 1.0), (8.0, -6.0, 1.0), (1.5, 2.0, 0.0))
@settings(deadline=None, max_examples=60)
def test_guard_cuts_the_outward_part_alone_to_the_room_that_the_turn_of_now_leaves(
    tilt: Vec3, rates: Vec3, now: Vec3
) -> None:
    """Outward is what the tilt grows with, by differences."""
    angle, toward, heading = tilt
    q = frames.multiply(frames.from_yaw(heading), frames.exp((angle * cos(toward), angle * sin(toward), 0.0)))

    def outward(v: Vec3) -> float:
        grown = [frames.tilt_of(frames.integrate(q, (v[0], v[1], 0.0), dt)) for dt in (-1e-6, 1e-6)]
        return (grown[1] - grown[0]) / 2e-6

    room = TILT - angle - max(outward(now), 0.0) * 0.05
    out = guarded(rates, q, now)
    assert outward(out) == pytest.approx(min(outward(rates), room / 0.05), abs=1e-6)
    square = (-outward((0.0, 1.0, 0.0)), outward((1.0, 0.0, 0.0)), 0.0)
    assert frames.dot(out, square) == pytest.approx(frames.dot(rates, square), abs=1e-6)


def test_guard_with_no_lag_to_speak_of_turns_back_within_a_fiftieth_of_a_second() -> None:
    q = frames.from_rpy(TILT + 0.1, 0.0, 0.0)
    out = limits.tilt_guard((3.0, 0.0, 0.0), q, (0.0, 0.0, 0.0), tilt_max_rad=TILT, rate_lag_s=0.0)
    assert out == pytest.approx((-0.1 / 0.02, 0.0, 0.0))


def test_guard_leaves_a_level_vehicle_alone() -> None:
    assert guarded((20.0, -20.0, 1.0), (1.0, 0.0, 0.0, 0.0)) == (20.0, -20.0, 1.0)


def test_thrust_that_the_least_upward_part_uses_up_has_nothing_sideways() -> None:
    out = limits.thrust_vector((5.0, 0.0, -9.0), tilt_max_rad=TILT, full_m_s2=2.0, vertical_min_m_s2=3.0)
    assert out == ((0.0, 0.0, -3.0), True)


def test_the_vertical_part_alone_can_be_what_is_cut() -> None:
    assert cut((0.0, 0.0, -30.0)) == ((0.0, 0.0, -FULL), True)
    assert cut((0.5, 0.0, 2.0)) == ((0.5, 0.0, -LEAST), True)


def test_height_may_take_all_thrust_but_a_tenth_that_is_wanted_sideways() -> None:
    assert cut((0.5, 0.0, -0.99 * FULL)) == ((0.5, 0.0, -0.99 * FULL), False)
    (x, _, z), was_cut = cut((5.0, 0.0, -30.0))
    assert was_cut and x == pytest.approx(0.1 * FULL) and hypot(x, z) == pytest.approx(FULL)
    (x, _, z), was_cut = cut((1.0, 0.0, -30.0))
    assert was_cut and x == pytest.approx(1.0) and hypot(x, z) == pytest.approx(FULL)


def test_slew_of_both_signs_and_within_its_step() -> None:
    last = Setpoint((0.5, -0.5, 0.25), 0.5)
    back = limits.toward(last, Setpoint((-2.5, -4.5, 3.0), 0.1), rate_step_rad_s=0.5, thrust_step=0.1)
    assert back.rates_frd_rad_s == pytest.approx((0.2, -0.9, 0.75)) and back.thrust == pytest.approx(0.4)
    near = Setpoint((0.6, -0.4, 0.2), 0.55)
    assert limits.toward(last, near, rate_step_rad_s=0.5, thrust_step=0.1).rates_frd_rad_s == near.rates_frd_rad_s
