"""One pass through the law: each axis with its own lag and time constant, each law by its name."""

from dataclasses import replace
from math import radians, sin

import pytest

from daemon import frames
from daemon.control import law
from daemon.control.law import NOTHING, Flow, Memory
from daemon.control.parameters import AttitudeLaw, ControlParameters, HeadingAxis
from daemon.control.vehicle_model import VehicleModel
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reference, Vec3

P = ControlParameters(tilt_max_rad=radians(80.0), rate_feed_forward=False, attitude_time_constant_s=(0.1, 0.2, 0.8))
MODEL = VehicleModel(hover_thrust=0.5)
DT_S = 0.01


def fly(
    p: ControlParameters,
    reference: Reference,
    attitude: Quat = IDENTITY,
    *,
    position: Vec3 = ZERO3,
    velocity: Vec3 = ZERO3,
    memory: Memory = NOTHING,
    model: VehicleModel = MODEL,
    dt_s: float = DT_S,
) -> Flow:
    return law.fly(model, memory, EstimatedState(0.0, position, velocity, attitude, ZERO3), reference, dt_s, p)


HOVER = Reference(0.0, ZERO3)


@pytest.mark.parametrize("axis", range(3))
def test_each_attitude_law_turns_back_in_its_own_way(axis: int) -> None:
    """An error of one radian about one axis: 2 sin(1/2), sin(1) and twice that, over the axis' time constant."""
    p = replace(P, heading_error_max_rad=3.0)
    off = frames.exp(tuple(float(i == axis) for i in range(3)))  # type: ignore[arg-type]
    for parameters, expected in (
        (replace(p, attitude_law=AttitudeLaw.QUATERNION), 2.0 * sin(0.5)),
        (replace(p, attitude_law=AttitudeLaw.GEOMETRIC), sin(1.0)),
        (replace(p, attitude_law=AttitudeLaw.GEOMETRIC, original_gain=True), 2.0 * sin(1.0)),
    ):
        rates = [0.0, 0.0, 0.0]
        rates[axis] = -expected / p.attitude_time_constant_s[axis]
        assert fly(parameters, HOVER, off).setpoint.rates_frd_rad_s == pytest.approx(rates, abs=1e-9)


def test_the_jerk_law_tilts_with_one_time_constant_and_turns_the_nose_as_the_quaternion_law() -> None:
    jerk, small = replace(P, attitude_law=AttitudeLaw.JERK), 0.01
    x, y, _ = fly(jerk, HOVER, frames.from_rpy(small, -2.0 * small, 0.0)).setpoint.rates_frd_rad_s
    assert (x, y) == pytest.approx((-small / 0.1, 2.0 * small / 0.1), rel=0.01)
    turned = fly(jerk, HOVER, frames.from_yaw(0.3)).setpoint.rates_frd_rad_s
    assert turned == pytest.approx((0.0, 0.0, -2.0 * sin(0.15) / 0.8), abs=1e-9)


def test_the_heading_error_that_the_law_sees_is_limited() -> None:
    turned = fly(replace(P, heading_error_max_rad=0.4), HOVER, frames.from_yaw(2.0)).setpoint.rates_frd_rad_s
    assert turned[2] == pytest.approx(-2.0 * sin(0.2) / 0.8)


def test_feed_forward_is_led_by_the_lag_of_each_axis() -> None:
    """Ramps: (1 + T s) / (1 + T s / 2.5) is ahead of a ramp by its slope times T (1 - 1 / 2.5)."""
    lags_s, slopes, dt_s = (0.05, 0.1, 0.2), (0.3, -0.2, 0.4), 0.0005
    p = replace(P, rate_feed_forward=True, rate_lag_s=lags_s)
    memory, g = NOTHING, p.gravity_m_s2
    for i in range(4000):
        t = i * dt_s
        jerk = (-slopes[1] * t * g, slopes[0] * t * g, 0.0)  # the thrust vector of a hover turns by jerk over gravity
        flow = fly(p, Reference(0.0, ZERO3, ZERO3, ZERO3, jerk, 0.0, slopes[2] * t), memory=memory, dt_s=dt_s)
        memory = flow.memory
    ahead = frames.subtract(flow.record.feed_forward_frd_rad_s, frames.scale(slopes, t))
    expected = tuple(slope * lag * 0.6 for slope, lag in zip(slopes, lags_s, strict=True))
    assert ahead == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("changes", [{"lag_compensation": False}, {"rate_lag_s": ZERO3}])
def test_feed_forward_without_a_lag_is_not_led(changes: dict[str, object]) -> None:
    p = replace(P, rate_feed_forward=True, **changes)  # type: ignore[arg-type]
    memory = fly(p, HOVER).memory
    flow = fly(p, Reference(0.0, ZERO3, yaw_rate_rad_s=0.7), memory=memory)
    assert flow.record.feed_forward_frd_rad_s == pytest.approx((0.0, 0.0, 0.7))


def test_the_first_feed_forward_is_no_step_for_the_lead() -> None:
    flow = fly(replace(P, rate_feed_forward=True), Reference(0.0, ZERO3, yaw_rate_rad_s=0.7))
    assert flow.record.feed_forward_frd_rad_s == pytest.approx((0.0, 0.0, 0.7))


def test_the_tilt_guard_knows_the_lag_of_roll_and_pitch() -> None:
    """5 degrees below the limit the tilt may grow by 5 degrees in a lag."""
    p = replace(P, tilt_max_rad=radians(35.0), rate_lag_s=(0.05, 0.08, 0.5), attitude_time_constant_s=(0.01, 0.01, 0.8))
    ahead = fly(p, Reference(0.0, (50.0, 0.0, 0.0)), frames.from_rpy(0.0, radians(-30.0), 0.0))
    assert ahead.setpoint.rates_frd_rad_s[1] == pytest.approx(-radians(5.0) / 0.05)


def test_thrust_is_what_gravity_drag_and_disturbance_leave_to_do() -> None:
    """a_ref - g - Kp e - Kv e_v + R D R' v - disturbance, worked out by hand."""
    p = replace(P, drag_1_s=(0.2, 0.2, 0.2), position_gain_1_s2=(5.0, 4.0, 3.0), velocity_gain_1_s=(2.0, 1.5, 1.0))
    model = replace(MODEL, by_velocity=replace(MODEL.by_velocity, unexplained=(0.5, -0.4, 0.3)))
    reference = Reference(0.0, (1.0, 2.0, -3.0), (2.0, -1.0, 0.5))
    flow = fly(p, reference, position=(1.1, 1.8, -3.3), velocity=(2.1, -1.2, 0.2), model=model)
    assert flow.record.position_error_ned_m == pytest.approx((0.1, -0.2, -0.3))
    assert flow.record.velocity_error_ned_m_s == pytest.approx((0.1, -0.2, -0.3))
    feedback = (-0.5 - 0.2, 0.8 + 0.3, 0.9 + 0.3)
    assert flow.record.feedback_ned_m_s2 == pytest.approx(feedback)
    expected = (
        feedback[0] + 0.4 - 0.5,
        feedback[1] - 0.2 + 0.4,
        feedback[2] + 0.1 - 0.3 - p.gravity_m_s2,
    )
    assert flow.record.thrust_ned_m_s2 == pytest.approx(expected)


def test_drag_turns_the_thrust_with_the_acceleration() -> None:
    """Level flight north at 2 m/s2 with drag d: the thrust vector's derivative is the jerk plus d times that."""
    p = replace(P, rate_feed_forward=True, lag_compensation=False, drag_1_s=(0.4, 0.4, 0.4))
    reference = Reference(0.0, ZERO3, ZERO3, (2.0, 0.0, 0.0))
    thrust = (2.0, 0.0, -p.gravity_m_s2)
    attitude = frames.from_rpy(0.0, -0.2011812, 0.0)  # atan(2 / 9.80665)
    flow = fly(p, reference, attitude)
    across = 0.8 * p.gravity_m_s2 / frames.norm(thrust)  # the part of 0.8 m/s3 north that is square to the thrust
    assert flow.record.feed_forward_frd_rad_s == pytest.approx((0.0, -across / frames.norm(thrust), 0.0), abs=1e-5)


def test_thrust_command_is_the_part_along_the_axis_of_now() -> None:
    """A vehicle tilted by 60 degrees gives half of the wanted 9.8 m/s2 upwards."""
    p = replace(P, lag_compensation=False)
    tilted = fly(p, HOVER, frames.from_rpy(radians(60.0), 0.0, 0.0))
    assert tilted.setpoint.thrust == pytest.approx(0.25)
    line = fly(replace(p, linear_thrust=(0.04, 0.1)), HOVER)
    assert line.setpoint.thrust == pytest.approx(0.04 * p.gravity_m_s2 + 0.1)


def test_the_lateral_convention_heads_by_the_right_side() -> None:
    reference = Reference(0.0, ZERO3, ZERO3, (3.0, 0.0, 0.0), yaw_rad=0.5)
    q = fly(replace(P, heading_axis=HeadingAxis.LATERAL), reference).record.desired_wb
    right = frames.rotate(q, (0.0, 1.0, 0.0))
    assert frames.dot(right, frames.rotate(frames.from_yaw(0.5), (1.0, 0.0, 0.0))) == pytest.approx(0.0, abs=1e-12)


def test_full_thrust_is_what_the_largest_command_gives() -> None:
    """Hover at 0.5 of a linear thrust: 0.8 gives 1.6 g, all of which may go upwards."""
    p = replace(P, thrust_max=0.8, feedback_max_m_s2=100.0, approach_max_m_s=100.0)
    flow = fly(p, Reference(0.0, (0.0, 0.0, -50.0)))
    assert flow.record.thrust_ned_m_s2 == pytest.approx((0.0, 0.0, -1.6 * p.gravity_m_s2))
    assert flow.record.limited == ("thrust_vector",)
