"""What the controller commands, in hover, off its place, when it matches or levels, and with feed-forward."""

from dataclasses import replace
from math import cos, hypot, nan, radians, sin

import pytest
from support.controller_rig import DT, HERE, P, at, flown

from daemon import frames
from daemon.control import controller
from daemon.control.parameters import AttitudeLaw
from daemon.messages import IDENTITY, ZERO3, Quat, Reference


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


def test_without_any_state_the_thrust_is_that_which_hovers_within_its_limits() -> None:
    """Hover thrust that was learned may lie outside: by a load, or where the limits were changed in flight."""
    state = controller.initial(P)
    weak, strong = (replace(state, model=replace(state.model, hover_thrust=hover)) for hover in (0.97, 0.03))
    p = replace(P, thrust_min=0.2, thrust_max=0.9)
    flown = [controller.blind(at_hover, parameters=p) for at_hover in (weak, strong, state)]
    assert [setpoint.thrust for setpoint in flown] == [0.9, 0.2, P.hover_thrust]
    assert [setpoint.rates_frd_rad_s for setpoint in flown] == [ZERO3] * 3


@pytest.mark.parametrize(
    "attitude", [(0.0, 0.0, 0.0, 0.0), (nan, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (0.1, 0.1, 0.0, 0.0)]
)
def test_an_attitude_that_is_no_rotation_is_not_levelled(attitude: Quat) -> None:
    state = controller.initial(P)
    setpoint = controller.level(state, at(0.0, attitude=attitude), parameters=P)
    assert (setpoint.rates_frd_rad_s, setpoint.thrust) == (ZERO3, P.hover_thrust)
