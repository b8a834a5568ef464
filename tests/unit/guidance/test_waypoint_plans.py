"""Plans to waypoints and to a hover: continuous from any flown state, within limits, arriving, the shorter way."""

from dataclasses import replace
from itertools import pairwise
from math import cos, dist, hypot, pi, radians, sin, sqrt
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon.frames import from_yaw, is_finite, scale, wrap_pi
from daemon.guidance.brake import brake
from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.goals import WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.plan import Plan
from daemon.guidance.planner import plan
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

PROFILES = [GuidanceParameters(profile=profile) for profile in Profile]
NED = st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0), st.floats(-20.0, 20.0))
YAW = st.floats(-3.14, 3.14)


def references(limits: MotionLimits, time_s: float = 3.0) -> st.SearchStrategy[Reference]:
    """States in flight from which the limits can be kept."""
    share = st.floats(-0.5, 0.5)
    vertical = min(limits.climb_m_s, limits.descent_m_s)
    sideways_a = min(limits.acceleration_m_s2, limits.speed_m_s)
    vertical_a = 0.5 * min(limits.vertical_acceleration_m_s2, vertical)

    def build(place: Vec3, v: Vec3, a: Vec3, yaw: float, rate: float) -> Reference:
        return Reference(
            time_s=time_s,
            position_ned_m=place,
            velocity_ned_m_s=(v[0] * limits.speed_m_s, v[1] * limits.speed_m_s, v[2] * vertical),
            acceleration_ned_m_s2=(a[0] * sideways_a, a[1] * sideways_a, a[2] * vertical_a),
            yaw_rad=yaw,
            yaw_rate_rad_s=rate * limits.yaw_rate_rad_s,
        )

    three = st.tuples(share, share, share)
    return st.builds(build, st.tuples(*[st.floats(-50.0, 50.0)] * 3), three, three, st.floats(-3.14, 3.14), share)


motion_limits = st.builds(
    MotionLimits,
    speed_m_s=st.floats(1.0, 12.0),
    climb_m_s=st.floats(0.5, 4.0),
    descent_m_s=st.floats(0.5, 3.0),
    acceleration_m_s2=st.floats(1.0, 6.0),
    vertical_acceleration_m_s2=st.floats(0.5, 4.0),
    jerk_m_s3=st.floats(6.0, 40.0),
    yaw_rate_rad_s=st.floats(0.2, 2.0),
    yaw_acceleration_rad_s2=st.floats(0.5, 4.0),
)


def rest(time_s: float = 0.0) -> Reference:
    return Reference(time_s=time_s, position_ned_m=ZERO3)


def to(position: tuple[float, float, float], yaw: float = 0.0) -> WaypointGoal:
    return WaypointGoal(position_ned_m=position, attitude_wb=from_yaw(yaw))


def arrival_s(flown: Plan) -> float:
    """When the reference has come within 5 cm and 3 degrees for good."""
    last = time = flown.start_s
    while time < flown.end_s + 30.0:
        now = flown.sample(time)
        off = dist(now.position_ned_m, flown.target.position_ned_m) > 0.05
        if off or abs(wrap_pi(now.yaw_rad - flown.target.yaw_rad)) > 0.05:
            last = time
        time += 0.1
    return last


@pytest.mark.parametrize("parameters", PROFILES, ids=lambda p: p.profile.value)
@settings(max_examples=30, deadline=None)
@given(data=st.data(), limits=motion_limits, goal=NED, yaw=YAW)
def test_keeps_the_limits_starts_where_it_was_and_arrives(
    checks: SimpleNamespace,
    parameters: GuidanceParameters,
    data: st.DataObject,
    limits: MotionLimits,
    goal: tuple[float, float, float],
    yaw: float,
) -> None:
    start = data.draw(references(limits))
    flown = plan(start, to(goal, yaw), limits, parameters)
    checks.continuous(start, flown.sample(start.time_s))
    time, end = start.time_s, flown.end_s + 25.0
    while time < end:
        checks.within(limits, flown.sample(time))
        time += 0.0437
    at_end = flown.sample(end)
    assert dist(at_end.position_ned_m, goal) < 0.01
    assert abs(wrap_pi(at_end.yaw_rad - yaw)) < 0.01


@pytest.mark.parametrize("parameters", PROFILES, ids=lambda p: p.profile.value)
@settings(max_examples=30, deadline=None)
@given(data=st.data(), goals=st.lists(st.tuples(NED, YAW, st.floats(0.0, 6.0)), min_size=2, max_size=6))
def test_preemption_at_any_time_is_continuous_and_keeps_the_limits(
    checks: SimpleNamespace, parameters: GuidanceParameters, data: st.DataObject, goals: list[tuple]
) -> None:
    limits = MotionLimits()
    flown: Plan = plan(data.draw(references(limits)), to((0.0, 0.0, 0.0)), limits, parameters)
    now = flown.start_s
    for position, yaw, flown_s in goals:
        now += flown_s
        before = flown.sample(now)
        flown = plan(before, to(position, yaw), limits, parameters)
        for i, reference in enumerate(flown.window(now, 60)):
            checks.within(limits, reference)
            if i == 0:
                checks.continuous(before, reference)


def stop_s(speed_m_s: float, limits: MotionLimits) -> float:
    """How long bounded acceleration and jerk take from a speed to rest."""
    ramp_s = limits.acceleration_m_s2 / limits.jerk_m_s3
    if speed_m_s > limits.acceleration_m_s2 * ramp_s:
        return speed_m_s / limits.acceleration_m_s2 + ramp_s
    return 2.0 * sqrt(speed_m_s / limits.jerk_m_s3)


@settings(max_examples=100, deadline=None)
@given(
    speed=st.floats(0.0, 4.99), course=st.floats(-pi, pi), distance=st.floats(15.0, 400.0), bearing=st.floats(-pi, pi)
)
@example(speed=4.9, course=0.0, distance=100.0, bearing=0.5 * pi)
def test_a_moving_start_is_no_slower_than_stopping_first_and_no_quicker_than_the_limits(
    checks: SimpleNamespace, speed: float, course: float, distance: float, bearing: float
) -> None:
    limits = MotionLimits()
    velocity = (speed * cos(course), speed * sin(course), 0.0)
    goal = (distance * cos(bearing), distance * sin(bearing), 0.0)
    start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=velocity)
    flown = plan(start, to(goal), limits, GuidanceParameters(profile=Profile.JERK_LIMITED))
    stopping_s = stop_s(speed, limits)
    rest_of_way_m = dist(goal, scale(velocity, 0.5 * stopping_s))
    assert rest_of_way_m > limits.speed_m_s * stop_s(limits.speed_m_s, limits)  # the whole speed is reached
    going_s = rest_of_way_m / limits.speed_m_s + stop_s(limits.speed_m_s, limits)
    assert flown.end_s <= stopping_s + going_s + 1e-6
    assert flown.end_s >= distance / limits.speed_m_s + 0.5 * stop_s(limits.speed_m_s, limits) - 1e-6
    for i in range(200):
        checks.within(limits, flown.sample(i / 199.0 * flown.end_s))


def test_a_small_change_of_course_hardly_costs_time() -> None:
    limits = MotionLimits()
    for degrees_off in (0.1, 1.0, 5.0, 15.0):
        velocity = (4.9 * cos(radians(degrees_off)), 4.9 * sin(radians(degrees_off)), 0.0)
        start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=velocity)
        flown = plan(start, to((100.0, 0.0, 0.0)), limits, GuidanceParameters(profile=Profile.JERK_LIMITED))
        straight_s = 100.0 / limits.speed_m_s + 0.5 * stop_s(limits.speed_m_s, limits)
        assert flown.end_s < straight_s + 0.6


def test_a_goal_that_is_moved_ten_times_a_second_is_approached_at_the_whole_speed() -> None:
    limits, parameters = MotionLimits(), GuidanceParameters(profile=Profile.JERK_LIMITED)
    flown, fastest = rest(), 0.0
    for tick in range(215):
        goal = (100.0, 2.0 * sin(0.05 * tick), 0.0)
        flown = plan(flown, to(goal), limits, parameters).sample(flown.time_s + 0.1)
        fastest = max(fastest, hypot(*flown.velocity_ned_m_s[:2]))
    assert fastest > 0.98 * limits.speed_m_s
    assert dist(flown.position_ned_m, goal) < 1.0


@pytest.mark.parametrize("parameters", PROFILES, ids=lambda p: p.profile.value)
@settings(max_examples=20, deadline=None)
@given(goal=NED, yaw=YAW, share=st.floats(0.01, 0.99))
def test_derivatives_belong_to_each_other(
    checks: SimpleNamespace, parameters: GuidanceParameters, goal: tuple[float, float, float], yaw: float, share: float
) -> None:
    flown = plan(rest(), to(goal, yaw), MotionLimits(), parameters)
    steps = int(share * (flown.end_s - flown.start_s) / WINDOW_SPACING_S)
    checks.derivatives_agree(flown, (steps + 0.5) * WINDOW_SPACING_S)


@pytest.mark.parametrize("parameters", PROFILES, ids=lambda p: p.profile.value)
@settings(max_examples=30, deadline=None)
@given(start_yaw=YAW, turn=st.floats(-3.1, 3.1))
def test_heading_turns_the_shorter_way(parameters: GuidanceParameters, start_yaw: float, turn: float) -> None:
    start = Reference(time_s=0.0, position_ned_m=ZERO3, yaw_rad=start_yaw)
    flown = plan(start, to(ZERO3, start_yaw + turn), MotionLimits(), parameters)
    turned, before = 0.0, start_yaw
    for i in range(200):
        yaw = flown.sample(0.1 * i).yaw_rad
        turned += wrap_pi(yaw - before)
        before = yaw
        assert min(turn, 0.0) - 1e-3 <= turned <= max(turn, 0.0) + 1e-3
    assert turned == pytest.approx(turn, abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(data=st.data(), limits=motion_limits, goal=NED, yaw=YAW)
def test_time_to_go_of_the_filter_is_what_it_takes(
    data: st.DataObject, limits: MotionLimits, goal: tuple[float, float, float], yaw: float
) -> None:
    start = data.draw(references(limits))
    flown = FilterPlan(start, goal, yaw, limits, GuidanceParameters())
    end_s = flown.end_s
    assert arrival_s(flown) <= end_s <= arrival_s(flown) + 4.0
    assert flown.end_s == end_s


@pytest.mark.parametrize(
    ("limits", "velocity", "yaw_rate_rad_s", "goal_m"),
    [
        (MotionLimits().tightened(speed_m_s=0.1, jerk_m_s3=0.5), (0.0, 0.1, 0.0), 0.0, 0.5),
        (MotionLimits().tightened(acceleration_m_s2=0.1), (4.0, 1.0, 0.0), 0.0, 60.0),
        (MotionLimits().tightened(acceleration_m_s2=0.5, jerk_m_s3=2.0), (-2.0, 2.0, 1.0), 0.0, 10.0),
        (MotionLimits(yaw_rate_rad_s=0.02), ZERO3, -0.9, 0.5),
        (MotionLimits(yaw_acceleration_rad_s2=0.02), ZERO3, 0.5, 0.5),
    ],
)
def test_the_filter_has_come_to_rest_when_it_says_so_whatever_the_limits(
    limits: MotionLimits, velocity: Vec3, yaw_rate_rad_s: float, goal_m: float
) -> None:
    start = Reference(0.0, ZERO3, velocity, yaw_rate_rad_s=yaw_rate_rad_s)
    parameters = GuidanceParameters(omega_rad_s=1.0, omega_yaw_rad_s=1.0)
    flown = FilterPlan(start, (goal_m, 0.0, -1.0), 1.0, limits, parameters)
    for i in range(100):
        now = flown.sample(flown.end_s + 0.5 * i)
        assert dist(now.position_ned_m, (goal_m, 0.0, -1.0)) < 0.05
        assert hypot(*now.velocity_ned_m_s) < 0.05
        assert abs(wrap_pi(now.yaw_rad - 1.0)) < 0.05


@settings(max_examples=40, deadline=None)
@given(data=st.data(), limits=motion_limits)
def test_brake_stops_within_limits_and_holds(
    checks: SimpleNamespace, data: st.DataObject, limits: MotionLimits
) -> None:
    start = data.draw(references(limits))
    stopped = brake(start, limits)
    checks.continuous(start, stopped.sample(start.time_s))
    for i in range(60):
        checks.within(limits, stopped.sample(start.time_s + i / 59.0 * (stopped.end_s - start.time_s)))
    before, after = stopped.sample(stopped.end_s - 1e-9), stopped.sample(stopped.end_s + 60.0)
    checks.continuous(before, after)
    assert after.velocity_ned_m_s == ZERO3
    assert after.yaw_rate_rad_s == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_a_moving_start_turns_to_its_goal_within_the_limits_and_sooner_than_by_stopping(
    checks: SimpleNamespace, seed: int
) -> None:
    limits, rng, parameters = MotionLimits(), Random(seed), GuidanceParameters(profile=Profile.JERK_LIMITED)
    took_s = stopping_s = 0.0
    for _ in range(60):
        way, push = rng.uniform(-pi, pi), rng.uniform(-pi, pi)
        speed, pushing = rng.uniform(1.0, 4.5), rng.uniform(0.0, 3.0)
        start = Reference(
            time_s=3.0,
            position_ned_m=ZERO3,
            velocity_ned_m_s=(speed * cos(way), speed * sin(way), rng.uniform(-1.0, 1.0)),
            acceleration_ned_m_s2=(pushing * cos(push), pushing * sin(push), 0.0),
        )
        goal = (rng.choice((2.0, 10.0, 40.0, 100.0)), 0.0, rng.uniform(-3.0, 3.0))
        flown = plan(start, to(goal), limits, parameters)
        checks.continuous(start, flown.sample(3.0))
        spacing_s = (flown.end_s - 3.0) / 400.0
        for i in range(400):
            before, after = flown.sample(3.0 + i * spacing_s), flown.sample(3.0 + (i + 1) * spacing_s)
            checks.within(limits, before)
            change = limits.jerk_m_s3 * spacing_s * (1.0 + 1e-6) + 1e-6
            assert dist(before.acceleration_ned_m_s2[:2], after.acceleration_ned_m_s2[:2]) <= change
        assert dist(flown.sample(flown.end_s - 1e-9).position_ned_m, goal) < 1e-6
        stopped = brake(start, limits)
        onward = plan(replace(stopped.target, time_s=stopped.end_s), to(goal), limits, parameters)
        assert flown.end_s <= onward.end_s + 0.5
        took_s, stopping_s = took_s + flown.end_s - 3.0, stopping_s + onward.end_s - 3.0
    assert took_s < 0.93 * stopping_s


def test_a_goal_to_the_side_is_flown_to_without_stopping() -> None:
    start = Reference(0.0, ZERO3, velocity_ned_m_s=(5.0, 0.0, 0.0))
    parameters = GuidanceParameters(profile=Profile.JERK_LIMITED)
    flown = plan(start, to((0.0, 40.0, 0.0)), MotionLimits(), parameters)
    assert min(hypot(*flown.sample(0.1 * i).velocity_ned_m_s) for i in range(80)) > 2.0


@pytest.mark.parametrize("seed", range(4))
def test_brake_keeps_whatever_limits_the_start_can_keep(checks: SimpleNamespace, seed: int) -> None:
    """Over the whole range of settings; a start can keep them when taking its acceleration back leads to no excess."""
    rng = Random(seed)

    def between(low: float, high: float) -> float:
        return low * (high / low) ** rng.random()

    for _ in range(60):
        limits = MotionLimits(
            speed_m_s=between(0.1, 25.0), acceleration_m_s2=between(0.1, 20.0), jerk_m_s3=between(0.5, 200.0)
        )
        way, push = rng.uniform(-pi, pi), rng.uniform(-pi, pi)
        speed, pushing = limits.speed_m_s * rng.random() ** 0.3, limits.acceleration_m_s2 * rng.random() ** 0.3
        gained = 0.5 * pushing * pushing / limits.jerk_m_s3
        if hypot(speed * cos(way) + gained * cos(push), speed * sin(way) + gained * sin(push)) > limits.speed_m_s:
            continue
        velocity = (speed * cos(way), speed * sin(way), 0.0)
        start = Reference(3.0, ZERO3, velocity, (pushing * cos(push), pushing * sin(push), 0.0))
        stopped = brake(start, limits)
        flown = [stopped.sample(3.0 + (stopped.end_s - 3.0) * (i / 200) ** 2) for i in range(201)]
        checks.continuous(start, flown[0])
        checks.continuous(flown[-1], stopped.sample(stopped.end_s + 10.0))
        for before, after in pairwise(flown):
            checks.within(limits, after)
            most = limits.acceleration_m_s2 * (after.time_s - before.time_s)
            assert dist(before.velocity_ned_m_s, after.velocity_ned_m_s) <= most * (1.0 + 1e-6) + 1e-9


@pytest.mark.parametrize("turning", [1.0, 0.98, 0.5])
def test_brake_out_of_a_fast_turn_takes_little_longer_than_out_of_straight_flight(turning: float) -> None:
    """The acceleration of the turn is taken back in a / j; then there is the whole of it to brake with."""
    limits = MotionLimits()
    start = Reference(0.0, ZERO3, (5.0, 0.0, 0.0), (0.0, 3.0 * turning, 0.0))
    stopped, straight = brake(start, limits), brake(replace(start, acceleration_ned_m_s2=ZERO3), limits)
    assert stopped.end_s <= straight.end_s + 0.4
    assert hypot(*stopped.target.position_ned_m) <= hypot(*straight.target.position_ned_m) + 2.0


def test_brake_from_cruise_takes_the_time_of_the_trapezoid() -> None:
    limits = MotionLimits()
    start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=(3.0, 4.0, 0.0))
    stopped = brake(start, limits)
    ramp = limits.acceleration_m_s2 / limits.jerk_m_s3
    assert stopped.end_s == pytest.approx(5.0 / limits.acceleration_m_s2 + ramp, abs=1e-9)
    way = 2.5 * stopped.end_s  # symmetric: half the speed on average
    assert stopped.target.position_ned_m == pytest.approx((0.6 * way, 0.8 * way, 0.0), abs=1e-9)


def test_a_start_outside_of_tightened_limits_comes_back_into_them(checks: SimpleNamespace) -> None:
    start = Reference(time_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=(5.0, 0.0, 1.5))
    limits = MotionLimits().tightened(speed_m_s=1.0, acceleration_m_s2=2.0)
    for parameters in PROFILES:
        flown = plan(start, to((40.0, 10.0, 5.0)), limits, parameters)
        checks.continuous(start, flown.sample(0.0))
        for i in range(400):
            reference = flown.sample(4.0 + 0.1 * i)
            assert dist(reference.velocity_ned_m_s[:2], (0.0, 0.0)) <= 1.0 + 1e-6
            assert abs(reference.velocity_ned_m_s[2]) <= 1.0 + 1e-6


@pytest.mark.parametrize("parameters", PROFILES, ids=lambda p: p.profile.value)
@pytest.mark.parametrize("dv", [ZERO3, (0.4, -0.3, 0.1)])
def test_a_reset_moves_the_plan_with_the_estimate(
    checks: SimpleNamespace, parameters: GuidanceParameters, dv: tuple[float, float, float]
) -> None:
    goal = (20.0, 5.0, -3.0)
    flown = plan(rest(), to(goal, 1.0), MotionLimits(), parameters)
    now = flown.sample(2.0)
    moved = flown.shifted((1.0, -2.0, 0.5), dv, 0.3, 2.0)
    after = moved.sample(2.0)
    expected = [p + d for p, d in zip(now.position_ned_m, (1.0, -2.0, 0.5), strict=True)]
    assert after.position_ned_m == pytest.approx(expected)
    assert after.velocity_ned_m_s == pytest.approx([v + d for v, d in zip(now.velocity_ned_m_s, dv, strict=True)])
    assert after.acceleration_ned_m_s2 == pytest.approx(now.acceleration_ned_m_s2)
    assert wrap_pi(after.yaw_rad - now.yaw_rad) == pytest.approx(0.3)
    checks.derivatives_agree(moved, 2.505)
    at_end = moved.sample(moved.end_s + 20.0)
    assert at_end.position_ned_m == pytest.approx((21.0, 3.0, -2.5), abs=1e-3)
    assert moved.target.position_ned_m == pytest.approx((21.0, 3.0, -2.5), abs=1e-9)
    assert at_end.yaw_rad == pytest.approx(1.3, abs=1e-3)


def test_a_hold_that_meets_a_velocity_reset_takes_it_out_again_smoothly(checks: SimpleNamespace) -> None:
    held = (
        brake(rest(), MotionLimits())
        .shifted(ZERO3, (0.5, 0.0, 0.0), 0.0, 7.0)
        .shifted((1.0, 0.0, 0.0), ZERO3, 0.2, 7.5)
        .shifted(ZERO3, ZERO3, 0.1, 7.6)
    )
    assert held.sample(7.0).velocity_ned_m_s == pytest.approx((0.5, 0.0, 0.0))
    for i in range(1, 80):
        reference = held.sample(7.0 + 0.05 * i)
        assert abs(reference.acceleration_ned_m_s2[0]) <= 1.0
        checks.derivatives_agree(held, 7.0 + 0.05 * i)
    assert held.sample(held.end_s).position_ned_m == pytest.approx((1.0, 0.0, 0.0))
    assert held.target.yaw_rad == pytest.approx(0.3)


def test_window_is_spaced_for_the_control_task_and_progress_runs_from_zero_to_one() -> None:
    flown = plan(rest(5.0), to((10.0, 0.0, -2.0)), MotionLimits(), GuidanceParameters())
    window = flown.window(5.3, 60)
    assert [round(r.time_s - 5.3, 9) for r in window] == [round(0.01 * i, 9) for i in range(60)]
    assert (flown.progress(5.0), flown.progress(1e9)) == (0.0, 1.0)
    assert 0.0 < flown.progress(6.0) < flown.progress(7.0) < 1.0


def test_outline_leads_from_start_to_goal_near_the_path_flown() -> None:
    for parameters in PROFILES:
        flown = plan(rest(), to((30.0, -10.0, -5.0)), MotionLimits(), parameters)
        for reference in flown.outline(40):
            assert dist(reference.position_ned_m, flown.sample(reference.time_s).position_ned_m) < 0.5


def test_modes_that_take_their_place_from_now_stop_where_braking_ends() -> None:
    start = Reference(time_s=0.0, position_ned_m=(1.0, 2.0, -3.0), velocity_ned_m_s=(3.0, 0.0, 1.0))
    stop = brake(start, MotionLimits()).target.position_ned_m
    turn = WaypointGoal(attitude_wb=from_yaw(1.0), mode=WaypointMode.ONLY_ORIENTATION)
    flat = WaypointGoal(position_ned_m=(9.0, 9.0, 9.0), mode=WaypointMode.XY_AND_YAW)
    for parameters in PROFILES:
        turned = plan(start, turn, MotionLimits(), parameters).target
        assert turned.position_ned_m == pytest.approx(stop)
        assert turned.yaw_rad == pytest.approx(1.0)
        assert plan(start, flat, MotionLimits(), parameters).target.position_ned_m == pytest.approx((9.0, 9.0, stop[2]))


def test_without_yaw_the_heading_stays_and_forward_heading_looks_ahead() -> None:
    start = Reference(time_s=0.0, position_ned_m=ZERO3, yaw_rad=0.7)
    keep = WaypointGoal(position_ned_m=(5.0, 5.0, 0.0))
    ahead = WaypointGoal(position_ned_m=(-5.0, 0.0, 0.0), mode=WaypointMode.FORWARD_HEADING)
    assert plan(start, keep, MotionLimits(), GuidanceParameters()).target.yaw_rad == pytest.approx(0.7)
    assert abs(plan(start, ahead, MotionLimits(), GuidanceParameters()).target.yaw_rad) == pytest.approx(pi)


@settings(max_examples=30, deadline=None)
@given(limits=motion_limits, goal=NED)
def test_a_start_at_rest_does_not_overshoot(limits: MotionLimits, goal: tuple[float, float, float]) -> None:
    for parameters in PROFILES:
        flown = plan(rest(), to(goal), limits, parameters)
        for i in range(60):
            position = flown.sample(i / 50.0 * flown.end_s).position_ned_m
            for reached, wanted in zip(position, goal, strict=True):
                assert min(0.0, wanted) - 1e-3 <= reached <= max(0.0, wanted) + 1e-3


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    "change",
    [
        {"velocity_ned_m_s": (INF, 0.0, 0.0)},
        {"acceleration_ned_m_s2": (0.0, NAN, 0.0)},
        {"yaw_rad": NAN},
        {"yaw_rate_rad_s": -INF},
        {"velocity_ned_m_s": (1e6, 0.0, 0.0), "acceleration_ned_m_s2": (500.0, 3.0, 0.0)},
    ],
)
def test_brake_of_nonsense_is_finite_and_near(change: dict[str, Any]) -> None:
    start = replace(Reference(time_s=0.0, position_ned_m=(1.0, 2.0, -3.0)), **change)
    stopped = brake(start, MotionLimits())
    for reference in (stopped.sample(0.3), stopped.target):
        assert is_finite((*reference.position_ned_m, *reference.velocity_ned_m_s, reference.yaw_rad))
    assert stopped.target.position_ned_m == pytest.approx((1.0, 2.0, -3.0))
