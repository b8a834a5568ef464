"""Whatever jerk is wanted, velocity, acceleration and jerk stay in bounds; unsaturated it is Fossen's filter."""

from math import dist, hypot

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import TransferFunction, step

from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.saturation import Cascade, cascade, keep_axis, keep_plane
from daemon.messages import ZERO3, Reference

cascades = st.builds(
    cascade,
    omega_rad_s=st.just(2.0),
    zeta=st.just(1.0),
    speed_high_m_s=st.floats(0.3, 8.0),
    speed_low_m_s=st.floats(-8.0, -0.3),
    acceleration_m_s2=st.floats(0.3, 6.0),
    jerk_m_s3=st.floats(0.5, 40.0),
    dt_s=st.sampled_from([0.01, 0.05]),
)
# pushing one way for a while, then the other: what a cruel planner would ask for
pushes = st.lists(st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.integers(1, 150)), max_size=6)


@settings(max_examples=60, deadline=None)
@given(gains=cascades, pushes=pushes)
def test_no_wanted_jerk_drives_an_axis_out_of_its_bounds(
    gains: Cascade, pushes: list[tuple[float, float, int]]
) -> None:
    v = a = 0.0
    dt, ripple = gains.dt_s, gains.jerk_m_s3 * gains.dt_s**2 / 8.0 + 1e-9
    for push, _, steps in pushes:
        for _ in range(steps):
            jerk = keep_axis(gains, v, a, push)
            assert abs(jerk) <= gains.jerk_m_s3 + 1e-9
            v, a = v + a * dt + 0.5 * jerk * dt * dt, a + jerk * dt
            assert gains.speed_low_m_s - ripple <= v <= gains.speed_high_m_s + ripple
            assert abs(a) <= gains.acceleration_m_s2 + 1e-9


@settings(max_examples=60, deadline=None)
@given(gains=cascades, pushes=pushes)
def test_no_wanted_jerk_drives_a_plane_out_of_its_bounds(
    gains: Cascade, pushes: list[tuple[float, float, int]]
) -> None:
    vx = vy = ax = ay = 0.0
    dt, ripple = gains.dt_s, gains.jerk_m_s3 * gains.dt_s**2 / 8.0 + 1e-9
    for push_x, push_y, steps in pushes:
        for _ in range(steps):
            jx, jy = keep_plane(gains, vx, vy, ax, ay, push_x, push_y)
            assert hypot(jx, jy) <= gains.jerk_m_s3 + 1e-9
            vx, ax = vx + ax * dt + 0.5 * jx * dt * dt, ax + jx * dt
            vy, ay = vy + ay * dt + 0.5 * jy * dt * dt, ay + jy * dt
            assert hypot(vx, vy) <= gains.speed_high_m_s + ripple
            assert hypot(ax, ay) <= gains.acceleration_m_s2 + 1e-9


@pytest.mark.parametrize("push", [0.0, 3.0, -3.0])
def test_from_outside_of_the_bounds_an_axis_comes_back_and_never_goes_further(push: float) -> None:
    bounds = {"speed_high_m_s": 1.0, "speed_low_m_s": -0.5, "acceleration_m_s2": 1.0, "jerk_m_s3": 5.0}
    gains = cascade(omega_rad_s=2.0, zeta=1.0, dt_s=0.01, **bounds)
    for v in (3.0, -2.0):
        a, outside = 0.0, abs(v)
        for _ in range(500):
            jerk = keep_axis(gains, v, a, push)
            v, a = v + a * 0.01 + 0.5 * jerk * 1e-4, a + jerk * 0.01
            assert abs(v) <= outside + 1e-9
        assert -0.5 <= v <= 1.0


def test_a_start_that_is_too_fast_comes_back_with_the_whole_acceleration() -> None:
    limits = MotionLimits(speed_m_s=2.0, acceleration_m_s2=0.1, jerk_m_s3=2.0)
    start = Reference(0.0, ZERO3, velocity_ned_m_s=(-4.1, -1.4, 0.0), acceleration_ned_m_s2=(-0.2, 1.6, 0.0))
    flown = FilterPlan(start, (0.3, 0.4, 0.0), 0.0, limits, GuidanceParameters(omega_rad_s=1.0))
    for time_s in (4.0, 10.0, 16.0):
        assert hypot(*flown.sample(time_s).velocity_ned_m_s) > 2.1
        assert hypot(*flown.sample(time_s).acceleration_ned_m_s2) == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("zeta", [1.0, 1.5])
def test_a_small_step_is_the_step_response_of_the_linear_filter(zeta: float) -> None:
    omega, c = 2.0, 2.0 * zeta + 1.0
    system = TransferFunction([omega**3], [1.0, c * omega, c * omega**2, omega**3])
    times = np.arange(0.0, 6.0, 0.25)
    _, expected = step(system, T=times)
    start = Reference(time_s=0.0, position_ned_m=ZERO3)
    parameters = GuidanceParameters(omega_rad_s=omega, zeta=zeta)
    flown = FilterPlan(start, (0.1, 0.05, -0.02), 0.0, MotionLimits(), parameters, step_s=0.001)
    found = np.array([flown.sample(float(t)).position_ned_m for t in times])
    assert found == pytest.approx(np.outer(expected, (0.1, 0.05, -0.02)), abs=2e-4)


@pytest.mark.parametrize("velocity", [(5.0, -4.0, 0.0), (3.0, 4.8, 0.0)])
def test_time_to_go_counts_the_way_back_of_a_start_that_passes_its_goal_by(velocity: tuple[float, ...]) -> None:
    limits = MotionLimits(speed_m_s=12.0, acceleration_m_s2=1.5)
    start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=velocity)  # type: ignore[arg-type]
    goal = (0.5, 0.8, 0.0)
    flown = FilterPlan(start, goal, 0.0, limits, GuidanceParameters())
    estimate_s = flown.end_s
    on_the_way = [t for t in np.arange(0.0, 20.0, 0.1) if dist(flown.sample(float(t)).position_ned_m, goal) > 0.05]
    assert 0.8 * max(on_the_way) < estimate_s < 1.3 * max(on_the_way)


@pytest.mark.parametrize(
    ("omega_rad_s", "zeta", "speed", "acceleration", "jerk", "goal_m"),
    [
        (1.0, 1.0, 5.0, 3.0, 0.5, 0.5),
        (2.0, 1.0, 2.0, 3.0, 0.5, 0.5),
        (5.0, 2.0, 5.0, 3.0, 1.0, 10.0),
        (1.94, 0.81, 15.0, 17.0, 1.6, 10.0),
        (1.0, 1.8, 22.0, 16.0, 0.5, 0.5),
    ],
)
def test_a_moving_start_comes_to_its_goal_however_little_jerk_there_is(
    omega_rad_s: float, zeta: float, speed: float, acceleration: float, jerk: float, goal_m: float
) -> None:
    limits = MotionLimits(speed_m_s=speed, acceleration_m_s2=acceleration, jerk_m_s3=jerk)
    start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=(0.0, 0.95 * speed, 0.0))
    goal = (goal_m, 0.0, 0.0)
    flown = FilterPlan(start, goal, 0.0, limits, GuidanceParameters(omega_rad_s=omega_rad_s, zeta=zeta))
    quickest_s = 2.0 * speed / acceleration + 8.0 * (speed / jerk) ** 0.5  # to stop, and to fly back as far
    assert dist(flown.sample(8.0 * quickest_s).position_ned_m, goal) < 0.05


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_that_are_not_positive_and_finite_are_refused_by_name(value: float) -> None:
    with pytest.raises(ValueError, match="jerk_m_s3"):
        MotionLimits(jerk_m_s3=value)


def test_goals_can_only_tighten_the_limits() -> None:
    limits = MotionLimits()
    tight = limits.tightened(speed_m_s=1.0, acceleration_m_s2=0.5, jerk_m_s3=2.0, yaw_rate_rad_s=0.1)
    assert (tight.speed_m_s, tight.climb_m_s, tight.descent_m_s) == (1.0, 1.0, 1.0)
    assert (tight.acceleration_m_s2, tight.vertical_acceleration_m_s2) == (0.5, 0.5)
    assert (tight.jerk_m_s3, tight.yaw_rate_rad_s) == (2.0, 0.1)
    assert limits.tightened(speed_m_s=99.0, acceleration_m_s2=99.0, jerk_m_s3=99.0, yaw_rate_rad_s=99.0) == limits
