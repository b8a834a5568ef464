from dataclasses import fields, replace
from math import atan2, cos, hypot, inf, isfinite, nan, radians, sin
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.control import controller
from daemon.control.controller import ControlState
from daemon.control.parameters import AttitudeLaw, ControlParameters, mavros_controllers
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reference, Reset, Setpoint, Vec3

P = ControlParameters()
DT = 0.01
HERE = (3.0, -2.0, -10.0)


def at(time_s: float, position: Vec3 = HERE, velocity: Vec3 = ZERO3, attitude: Quat = IDENTITY) -> EstimatedState:
    return EstimatedState(time_s, position, velocity, attitude, ZERO3)


def flown(
    state: ControlState, ticks: int, parameters: ControlParameters = P, **of: object
) -> tuple[ControlState, Setpoint]:
    """Step with the vehicle as it is at the reference, and return the last setpoint."""
    start = 0.0 if state.setpoint is None else state.time_s
    setpoint = Setpoint(ZERO3, 0.0)
    for i in range(1, ticks + 1):
        t = start + i * DT
        now = at(t, **of)  # type: ignore[arg-type]
        state, setpoint, _ = controller.step(state, now, now, Reference(t, HERE), DT, parameters=parameters)
    return state, setpoint


mad = st.one_of(st.floats(-20.0, 20.0), st.sampled_from([0.0, nan, inf, -inf, 1e300, -1e300, 1e-320, 1e7]))
mad_vectors = st.tuples(mad, mad, mad)
wild_vectors = st.tuples(*[st.floats(-300.0, 300.0)] * 3)
wild_states = st.builds(
    EstimatedState,
    time_s=st.floats(0.0, 1.0),
    position_ned_m=wild_vectors,
    velocity_ned_m_s=wild_vectors,
    attitude_wb=st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(frames.exp),
    rates_frd_rad_s=wild_vectors,
)
wild_references = st.builds(
    Reference,
    time_s=st.floats(0.0, 1.0),
    position_ned_m=wild_vectors,
    velocity_ned_m_s=wild_vectors,
    acceleration_ned_m_s2=wild_vectors,
    jerk_ned_m_s3=wild_vectors,
    yaw_rad=st.floats(-10.0, 10.0),
    yaw_rate_rad_s=st.floats(-300.0, 300.0),
)


@st.composite
def mad_of(draw: st.DrawFn, wild: st.SearchStrategy[Any]) -> Any:
    """A wild but finite message in which up to two fields are mad."""
    message = draw(wild)
    names = draw(st.sets(st.sampled_from([f.name for f in fields(message)]), max_size=2))
    for name in names:
        value = getattr(message, name)
        bad = draw(st.tuples(*[mad] * len(value)) if isinstance(value, tuple) else mad)
        message = replace(message, **{name: bad})
    return message


mad_states, mad_references = mad_of(wild_states), mad_of(wild_references)
mad_resets = st.builds(
    Reset, time_s=mad, kinds=st.just(frozenset()), position_ned_m=mad_vectors, velocity_ned_m_s=mad_vectors, yaw_rad=mad
)
variants = st.sampled_from(
    [
        P,
        replace(P, attitude_law=AttitudeLaw.GEOMETRIC, velocity_yaw=True, thrust_curve=0.7),
        replace(P, attitude_law=AttitudeLaw.JERK, feedthrough=True, drag_1_s=(0.3, 0.2, 0.1)),
        replace(mavros_controllers(), thrust_max=0.9),
        replace(P, rate_lag_s=ZERO3, thrust_lag_s=0.0, hover_thrust=0.95, hover_range=0.9),
    ]
)


def assert_within_limits(setpoint: Setpoint, p: ControlParameters) -> None:
    x, y, z = setpoint.rates_frd_rad_s
    assert all(isfinite(v) for v in (x, y, z, setpoint.thrust))
    assert hypot(x, y) <= p.rate_max_rad_s * (1.0 + 1e-12) and abs(z) <= p.yaw_rate_max_rad_s
    assert p.thrust_min <= setpoint.thrust <= p.thrust_max


@given(variants, st.lists(st.tuples(mad_states, mad_states, mad_references, mad, st.none() | mad_resets), max_size=5))
@settings(deadline=None, max_examples=200)
def test_no_input_makes_a_setpoint_that_is_not_finite_or_not_within_limits(
    p: ControlParameters,
    inputs: list[tuple[EstimatedState, EstimatedState, Reference, float, Reset | None]],
) -> None:
    state = controller.initial(p)
    for estimate, predicted, reference, dt_s, reset in inputs:
        assert_within_limits(controller.match(state, estimate, parameters=p), p)
        assert_within_limits(controller.level(state, predicted, parameters=p), p)
        if reset is not None:
            state = controller.shifted(state, reset)
        state, setpoint, record = controller.step(state, estimate, predicted, reference, dt_s, parameters=p)
        assert_within_limits(setpoint, p)
        assert all(isfinite(v) for v in (*record.disturbance_ned_m_s2, *record.acceleration_ned_m_s2))
    # and a sane vehicle is flown again at once
    now = at(1e4)
    _, setpoint, record = controller.step(state, now, now, Reference(1e4, HERE), DT, parameters=p)
    assert record.refused == ()
    assert setpoint.rates_frd_rad_s == pytest.approx(ZERO3, abs=1e-9)


@pytest.mark.parametrize("law", list(AttitudeLaw))
def test_hover_upon_the_reference_is_no_rates_and_hover_thrust(law: AttitudeLaw) -> None:
    p = replace(P, attitude_law=law)
    _, setpoint = flown(controller.initial(p), 20, p)
    assert setpoint.rates_frd_rad_s == pytest.approx(ZERO3, abs=1e-9)
    assert setpoint.thrust == pytest.approx(P.hover_thrust, abs=1e-6)


@pytest.mark.parametrize("law", list(AttitudeLaw))
def test_vehicle_south_of_the_point_pitches_down_and_east_of_it_rolls_left(law: AttitudeLaw) -> None:
    p = replace(P, attitude_law=law)
    _, south = flown(controller.initial(p), 2, p, position=(2.5, -2.0, -10.0))
    _, east = flown(controller.initial(p), 2, p, position=(3.0, -1.5, -10.0))
    _, below = flown(controller.initial(p), 2, p, position=(3.0, -2.0, -9.5))
    assert south.rates_frd_rad_s[1] < -0.1
    assert east.rates_frd_rad_s[0] < -0.1
    assert below.thrust > P.hover_thrust + 0.01


def test_bad_inputs_are_named() -> None:
    good, bad = at(1.0), at(1.0, position=(nan, 0.0, 0.0))
    reference, far = Reference(1.0, HERE), Reference(1.0, HERE, jerk_ned_m_s3=(inf, 0.0, 0.0))
    state = controller.initial(P)
    for estimate, predicted, wanted, names in (
        (bad, good, reference, ("estimate",)),
        (good, bad, reference, ("predicted",)),
        (good, good, far, ("reference",)),
        (bad, bad, far, ("estimate", "predicted", "reference")),
        (good, at(1.0, attitude=(0.0, 0.0, 0.0, 0.0)), reference, ("predicted",)),
    ):
        assert controller.step(state, estimate, predicted, wanted, DT, parameters=P)[2].refused == names


@pytest.mark.parametrize("time_s", [nan, 1.0])
def test_bad_estimate_does_not_stop_the_law_from_flying_on_the_prediction(time_s: float) -> None:
    bad, good = at(time_s, velocity=(nan, 0.0, 0.0)), at(1.02, position=(2.5, -2.0, -10.0))
    _, setpoint, _ = controller.step(controller.initial(P), bad, good, Reference(1.02, HERE), DT, parameters=P)
    assert setpoint.rates_frd_rad_s[1] < -0.1


def test_without_a_reference_the_vehicle_is_levelled() -> None:
    tilted = at(1.0, attitude=frames.from_rpy(0.3, 0.0, 1.0))
    _, setpoint, _ = controller.step(
        controller.initial(P), tilted, tilted, Reference(nan, HERE, yaw_rad=nan), DT, parameters=P
    )
    assert setpoint.rates_frd_rad_s[0] < -0.5
    assert setpoint.rates_frd_rad_s[2] == pytest.approx(0.0, abs=1e-9)


def test_match_holds_the_vehicle_as_it_is() -> None:
    setpoint = controller.match(
        controller.initial(P), at(1.0, attitude=frames.from_rpy(radians(20.0), 0.0, 2.0)), parameters=P
    )
    assert setpoint.rates_frd_rad_s == ZERO3
    assert setpoint.thrust == pytest.approx(0.5 / cos(radians(20.0)))


def test_level_turns_back_by_the_shortest_way_and_then_rests() -> None:
    state = controller.initial(P)
    q = frames.from_rpy(0.6, -0.5, 2.0)
    for _ in range(300):
        setpoint = controller.level(state, at(0.0, attitude=q), parameters=P)
        assert setpoint.thrust == P.hover_thrust
        q = frames.integrate(q, setpoint.rates_frd_rad_s, DT)
    assert frames.tilt_of(q) < 1e-6
    assert setpoint.rates_frd_rad_s == pytest.approx(ZERO3, abs=1e-5)


def test_heading_reset_does_not_change_the_command_in_the_body() -> None:
    turn = 0.5
    wind = (0.5, 0.2, 0.0)  # velocity grows by it, unexplained
    state, t = controller.initial(P), 0.0
    for i in range(100):
        t = i * DT
        x, v = frames.add(HERE, frames.scale(wind, 0.5 * t * t)), frames.scale(wind, t)
        now = at(t, x, v)
        state, before, record = controller.step(state, now, now, Reference(t, x, v), DT, parameters=P)
    assert record.disturbance_ned_m_s2[0] > 0.4
    state = controller.shifted(state, Reset(t, frozenset({"heading"}), yaw_rad=turn))
    t += DT
    now = at(t, x, v, frames.from_yaw(turn))
    kept = replace(P, disturbance_bandwidth_rad_s=1e-6, velocity_bias_bandwidth_rad_s=1e-6)
    state, after, record = controller.step(state, now, now, Reference(t, x, v, yaw_rad=turn), DT, parameters=kept)
    assert after.thrust == pytest.approx(before.thrust, abs=2e-3)
    down = frames.down_axis(frames.multiply(frames.conjugate(now.attitude_wb), record.desired_wb))
    expected = frames.rotate_inverse(frames.from_yaw(turn), frames.rotate_about_down(wind, turn))
    # leans into the wind, as seen from the body
    assert down[0] * expected[1] == pytest.approx(down[1] * expected[0], abs=2e-3)


def test_velocity_reset_is_no_disturbance() -> None:
    state, _ = flown(controller.initial(P), 100)
    jump = (2.0, -1.0, 0.5)
    reset = Reset(state.time_s, frozenset({"velocity_ne", "velocity_d"}), velocity_ned_m_s=jump)
    state = controller.shifted(state, reset)
    t = state.time_s + DT
    now = at(t, position=frames.add(HERE, frames.scale(jump, DT)), velocity=jump)
    _, _, record = controller.step(state, now, now, Reference(t, HERE, jump), DT, parameters=P)
    assert frames.norm(record.disturbance_ned_m_s2) < 0.02


def test_position_reset_is_no_velocity_bias() -> None:
    state, _ = flown(controller.initial(P), 100)
    jump = (3.0, -1.0, 0.5)
    state = controller.shifted(state, Reset(state.time_s, frozenset({"position_ne"}), position_ned_m=jump))
    t = state.time_s + DT
    now = at(t, position=frames.add(HERE, jump))
    _, _, record = controller.step(state, now, now, Reference(t, HERE), DT, parameters=P)
    assert frames.norm(record.velocity_bias_ned_m_s) < 1e-9


def test_bias_of_the_velocity_is_learned_and_taken_off() -> None:
    bias = (0.3, -0.2, 0.1)
    state, _ = flown(controller.initial(P), 400, velocity=bias)
    t = state.time_s + DT
    now = at(t, velocity=bias)
    _, _, record = controller.step(state, now, now, Reference(t, HERE), DT, parameters=P)
    assert record.velocity_bias_ned_m_s == pytest.approx(bias, abs=1e-3)
    assert record.velocity_error_ned_m_s == pytest.approx(ZERO3, abs=1e-3)


def test_predicted_position_is_freed_of_the_bias_over_the_time_of_prediction() -> None:
    bias = (0.3, -0.2, 0.1)
    state, _ = flown(controller.initial(P), 400, velocity=bias)
    t = state.time_s + DT
    ahead = at(t + 0.05, frames.add(HERE, frames.scale(bias, 0.05)), bias)
    _, _, record = controller.step(state, at(t, velocity=bias), ahead, Reference(t + 0.05, HERE), DT, parameters=P)
    assert record.position_error_ned_m == pytest.approx(ZERO3, abs=1e-3)


@pytest.mark.parametrize(
    "other",
    [
        replace(P, attitude_law=AttitudeLaw.JERK),
        replace(P, attitude_law=AttitudeLaw.GEOMETRIC, original_gain=True),
        replace(P, position_gain_1_s2=(20.0, 20.0, 20.0), velocity_gain_1_s=(9.0, 9.0, 9.0)),
        replace(P, disturbance_bandwidth_rad_s=0.0, rate_feed_forward=False),
        replace(P, attitude_time_constant_s=(0.05, 0.05, 0.2)),
    ],
)
def test_switching_law_or_gains_in_flight_stays_within_slew(other: ControlParameters) -> None:
    off = (2.6, -1.7, -9.8)
    state, before = flown(controller.initial(P), 50, position=off)
    for _ in range(20):
        state, after = flown(state, 1, other, position=off)
        (ax, ay, az), (bx, by, bz) = after.rates_frd_rad_s, before.rates_frd_rad_s
        assert hypot(ax - bx, ay - by) <= P.rate_slew_max_rad_s2 * DT + 1e-9
        assert abs(az - bz) <= P.rate_slew_max_rad_s2 * DT + 1e-9
        assert abs(after.thrust - before.thrust) <= P.thrust_slew_max_1_s * DT + 1e-9
        before = after


def test_pause_forgets_the_flow_but_keeps_the_hover_thrust() -> None:
    state, _ = flown(controller.initial(P), 300, velocity=ZERO3, position=(3.0, -2.0, -9.7))
    learned = state.hover_thrust
    assert learned != P.hover_thrust
    t = state.time_s + 10.0
    state, setpoint, record = controller.step(state, at(t), at(t), Reference(t, HERE), DT, parameters=P)
    assert record.disturbance_ned_m_s2 == ZERO3 and state.hover_thrust == learned
    assert setpoint.thrust == pytest.approx(learned)


def test_velocity_yaw_turns_the_nose_along_the_reference_and_holds_it_at_rest() -> None:
    p = replace(P, velocity_yaw=True)
    state, t = controller.initial(p), 1.0
    moving = Reference(t, HERE, (0.0, 2.0, 0.0))
    state, _, record = controller.step(state, at(t), at(t), moving, DT, parameters=p)
    assert frames.yaw_of(record.desired_wb) == pytest.approx(radians(90.0))
    t += DT
    _, _, record = controller.step(state, at(t), at(t), Reference(t, HERE), DT, parameters=p)
    assert frames.yaw_of(record.desired_wb) == pytest.approx(radians(90.0))


def test_feedthrough_flies_the_acceleration_of_the_reference_alone() -> None:
    p = replace(P, feedthrough=True, disturbance_bandwidth_rad_s=0.0)
    t = 1.0
    away = at(t, position=(9.0, 9.0, -3.0))
    reference = Reference(t, HERE, acceleration_ned_m_s2=(1.0, 0.5, -0.5))
    _, _, record = controller.step(controller.initial(p), away, away, reference, DT, parameters=p)
    assert record.thrust_ned_m_s2 == pytest.approx((1.0, 0.5, -0.5 - P.gravity_m_s2))


def test_turning_with_the_reference_is_fed_forward() -> None:
    """On a circle at constant height the body turns with the thrust vector: rates from geometry, no feedback."""
    w, radius = 1.0, 2.0
    rates = []
    p = replace(P, disturbance_bandwidth_rad_s=0.0, velocity_bias_bandwidth_rad_s=0.0)
    state = controller.initial(p)
    attitude = IDENTITY
    for i in range(100):
        t = i * DT
        c, s = cos(w * t), sin(w * t)
        r = Reference(
            t,
            (radius * c, radius * s, -10.0),
            (-radius * w * s, radius * w * c, 0.0),
            (-radius * w * w * c, -radius * w * w * s, 0.0),
            (radius * w**3 * s, -radius * w**3 * c, 0.0),
        )
        now = at(t, r.position_ned_m, r.velocity_ned_m_s, attitude)
        state, setpoint, record = controller.step(state, now, now, r, DT, parameters=p)
        attitude = record.desired_wb  # the attitude follows exactly
        rates.append(setpoint.rates_frd_rad_s)
    x, y, _ = rates[-1]
    # the thrust vector's horizontal part a = r w^2 turns at w: tilting rate a w / |f| and its lead are bounded by that
    length = hypot(radius * w * w, P.gravity_m_s2)
    assert hypot(x, y) == pytest.approx(radius * w**3 / length, rel=0.1)


BARE = replace(P, disturbance_bandwidth_rad_s=0.0, velocity_bias_bandwidth_rad_s=0.0)


def test_thrust_is_led_by_its_lag() -> None:
    """Upward jerk j for a lag T: the command is ahead by j T."""
    jerk, t = -4.0, 1.0
    reference = Reference(t, HERE, jerk_ned_m_s3=(0.0, 0.0, jerk))
    _, led, _ = controller.step(controller.initial(BARE), at(t), at(t), reference, DT, parameters=BARE)
    plain = replace(BARE, lag_compensation=False)
    _, unled, _ = controller.step(controller.initial(plain), at(t), at(t), reference, DT, parameters=plain)
    assert unled.thrust == pytest.approx(P.hover_thrust)
    expected = P.hover_thrust * (1.0 - jerk * P.thrust_lag_s / P.gravity_m_s2)
    assert led.thrust == pytest.approx(expected)


def test_feed_forward_rates_are_led_by_the_lag_of_the_rate_loop() -> None:
    """A yaw rate that grows by a rad/s each second is commanded ahead by the lag, as the lead filter has it."""
    lag_s, growth = 0.055, 1.0
    p = replace(BARE, rate_lag_s=(lag_s, lag_s, lag_s), rate_slew_max_rad_s2=9000.0)
    state = controller.initial(p)
    for i in range(100):
        t = i * DT
        yaw, rate = 0.5 * growth * t * t, growth * t
        now = at(t, attitude=frames.from_yaw(yaw))
        reference = Reference(t, HERE, yaw_rad=yaw, yaw_rate_rad_s=rate)
        state, setpoint, _ = controller.step(state, now, now, reference, DT, parameters=p)
    lead_s = (setpoint.rates_frd_rad_s[2] - rate) / growth
    assert 0.4 * lag_s < lead_s < lag_s


def test_feed_forward_is_turned_into_the_body_of_now() -> None:
    """The nose is a quarter turn off: what the wanted body does by pitching, the body of now does by rolling."""
    t, off = 1.0, radians(90.0)
    now = at(t, attitude=frames.from_yaw(off))
    reference = Reference(t, HERE, jerk_ned_m_s3=(3.0, 0.0, 0.0))
    _, _, record = controller.step(controller.initial(BARE), now, now, reference, DT, parameters=BARE)
    pitch_rate = -3.0 / P.gravity_m_s2  # nose down to accelerate north
    expected = frames.rotate_inverse(frames.from_yaw(off), (0.0, pitch_rate, 0.0))
    assert record.feed_forward_frd_rad_s == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_state_without_a_time_is_refused(bad: float) -> None:
    state = controller.initial(P)
    _, _, record = controller.step(state, at(1.0), at(bad), Reference(1.0, HERE), DT, parameters=P)
    assert record.refused == ("predicted",)


def test_level_begins_with_the_tilt_over_the_time_constant_of_its_axis() -> None:
    """Twice the sine of half the angle: Brescianini's law."""
    p = replace(P, attitude_time_constant_s=(0.2, 0.4, 0.7))
    for attitude, rates in (
        (frames.from_rpy(0.3, 0.0, 0.0), (-2.0 * sin(0.15) / 0.2, 0.0, 0.0)),
        (frames.from_rpy(0.0, 0.3, 0.0), (0.0, -2.0 * sin(0.15) / 0.4, 0.0)),
    ):
        setpoint = controller.level(controller.initial(p), at(0.0, attitude=attitude), parameters=p)
        assert setpoint.rates_frd_rad_s == pytest.approx(rates, abs=1e-12)


@pytest.mark.parametrize("tilt_deg", [60.0, 80.0, 120.0, 180.0])
def test_match_raises_the_thrust_to_the_double_at_most(tilt_deg: float) -> None:
    p = replace(P, hover_thrust=0.3)
    setpoint = controller.match(
        controller.initial(p), at(1.0, attitude=frames.from_rpy(0.0, radians(tilt_deg), 0.0)), parameters=p
    )
    assert setpoint.thrust == pytest.approx(0.6)


@pytest.mark.parametrize(("pause_s", "forgotten"), [(0.45, False), (0.55, True)])
def test_a_pause_of_half_a_second_is_forgotten_after(pause_s: float, forgotten: bool) -> None:
    state, _ = flown(controller.initial(P), 30, position=(3.0, -2.0, -9.0))  # climbs: thrust is high
    t = state.time_s + pause_s
    slow = replace(P, thrust_slew_max_1_s=0.01)
    _, setpoint, _ = controller.step(state, at(t), at(t), Reference(t, HERE), DT, parameters=slow)
    assert state.setpoint is not None
    assert (setpoint.thrust < state.setpoint.thrust - 0.01) is forgotten


def test_a_state_that_is_predicted_for_a_moment_before_its_own_is_not_moved_back() -> None:
    state, _ = flown(controller.initial(P), 400, velocity=(0.3, -0.2, 0.1))
    t = state.time_s + DT
    now = at(t, velocity=(0.3, -0.2, 0.1))
    before = at(t - 0.3, velocity=(0.3, -0.2, 0.1))
    _, _, record = controller.step(state, now, before, Reference(t, HERE), DT, parameters=P)
    assert record.position_error_ned_m == pytest.approx(ZERO3, abs=1e-12)


def test_the_heading_that_is_remembered_turns_with_a_reset() -> None:
    p = replace(P, velocity_yaw=True)
    t, turn = 1.0, 0.4
    moving = Reference(t, HERE, (0.0, 2.0, 0.0))
    state, _, _ = controller.step(controller.initial(p), at(t), at(t), moving, DT, parameters=p)
    state = controller.shifted(state, Reset(t, frozenset({"heading"}), yaw_rad=turn))
    _, _, record = controller.step(state, at(t + DT), at(t + DT), Reference(t + DT, HERE), DT, parameters=p)
    assert frames.yaw_of(record.desired_wb) == pytest.approx(radians(90.0) + turn)


FREE = replace(P, rate_slew_max_rad_s2=9999.0, thrust_slew_max_1_s=999.0, tilt_max_rad=radians(80.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_limit_is_named_when_it_cuts_and_only_then(sign: float) -> None:
    def names(offset: Vec3, p: ControlParameters) -> tuple[str, ...]:
        _, hovering = flown(controller.initial(p), 1, p)
        state = replace(controller.initial(p), time_s=0.9, setpoint=hovering)
        now = at(1.0, frames.add(HERE, frames.scale(offset, sign)))
        return controller.step(state, now, now, Reference(1.0, HERE), DT, parameters=p)[2].limited

    assert names((0.05, 0.02, 0.03), FREE) == ()
    assert names((0.5, 0.3, 0.0), replace(FREE, rate_max_rad_s=0.1)) == ("rates",)
    assert names((0.0, 0.0, 0.5), replace(FREE, thrust_min=0.49, thrust_max=0.51))[-1] == "thrust"
    assert names(ZERO3, replace(FREE, linear_thrust=(0.05, 0.1), thrust_max=0.55))[-1] == "thrust"
    assert names((0.5, 0.3, 0.0), replace(FREE, rate_slew_max_rad_s2=1.0)) == ("slew",)
    assert names((0.0, 0.0, 0.5), replace(FREE, thrust_slew_max_1_s=0.1)) == ("slew",)
    assert names((3.0, 2.0, 0.0), replace(FREE, tilt_max_rad=radians(10.0))) == ("thrust_vector",)


@pytest.mark.parametrize("bad", [False, True])
def test_drag_is_learned_with_the_velocity_of_the_reference_and_not_without_one(bad: bool) -> None:
    """Five metres a second to and fro in a drag of 0.5 1/s that was not configured; the vehicle follows exactly."""
    p = replace(P, drag_max_1_s=2.0, thrust_lag_s=0.0)
    state = controller.initial(p)
    for i in range(1200):
        t = i * DT
        x, v, a = -10.0 / 3.0 * cos(1.5 * t), 5.0 * sin(1.5 * t), 7.5 * cos(1.5 * t)
        pitch = atan2(-(a + 0.5 * v), P.gravity_m_s2)
        now = at(t, (x, 0.0, -5.0), (v, 0.0, 0.0), frames.from_rpy(0.0, pitch, 0.0))
        reference = Reference(t, (x, 0.0, -5.0), (v, 0.0, 0.0), (a, 0.0, 0.0), yaw_rad=nan if bad else 0.0)
        state, _, record = controller.step(state, now, now, reference, DT, parameters=p)
    assert (record.drag_learned_1_s > 0.1) is not bad
