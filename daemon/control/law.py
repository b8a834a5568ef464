"""The law itself: position law, thrust vector, attitude, attitude law with feed-forward, thrust map."""

from math import exp

from daemon.control import attitude_laws, flatness, limits, position_law, thrust_map
from daemon.control.drag import total
from daemon.control.parameters import AttitudeLaw, ControlParameters
from daemon.control.reference_drag import reference_drag
from daemon.control.vehicle_model import VehicleModel
from daemon.frames import add, conjugate, dot, down_axis, multiply, rotate, subtract
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reference, Setpoint, Vec3
from daemon.values import value


@value
class ControlRecord:
    """What the law saw and did in one step; errors are measured minus reference.

    ``refused`` names the inputs that were unusable (estimate, predicted, reference), ``limited`` the limits that cut
    (thrust_vector, rates, thrust, slew). ``acceleration_ned_m_s2`` is what the vehicle is expected to accelerate with
    now, for prediction; ``drag_learned_1_s`` adds to the configured drag along each axis;
    ``late_s`` is by how much later than modelled the vehicle follows commanded rates.
    """

    refused: tuple[str, ...] = ()
    limited: tuple[str, ...] = ()
    position_error_ned_m: Vec3 = ZERO3
    velocity_error_ned_m_s: Vec3 = ZERO3
    feedback_ned_m_s2: Vec3 = ZERO3
    thrust_ned_m_s2: Vec3 = ZERO3
    desired_wb: Quat = IDENTITY
    feed_forward_frd_rad_s: Vec3 = ZERO3
    disturbance_ned_m_s2: Vec3 = ZERO3
    velocity_bias_ned_m_s: Vec3 = ZERO3
    hover_thrust: float = 0.0
    acceleration_ned_m_s2: Vec3 = ZERO3
    drag_learned_1_s: float = 0.0
    late_s: float = 0.0


@value
class Memory:
    """What the law remembers: the lead filter's state."""

    slow_feed_forward_rad_s: Vec3 | None = None


NOTHING = Memory()


@value
class Flow:
    """What one pass through the law gives, before the setpoint's limits."""

    setpoint: Setpoint
    memory: Memory
    record: ControlRecord


_LEAD_RATIO = 2.5  # of the lead filter; bounds what it makes of a step of the feed-forward


def fly(
    model: VehicleModel,
    memory: Memory,
    predicted: EstimatedState,
    reference: Reference,
    dt_s: float,
    p: ControlParameters,
) -> Flow:
    """One pass on sound inputs: rates and thrust wanted, within the limits of tilt and full thrust."""
    position_error = subtract(predicted.position_ned_m, reference.position_ned_m)
    velocity_error = subtract(predicted.velocity_ned_m_s, reference.velocity_ned_m_s)
    feedback = position_law.feedback(
        position_error,
        velocity_error,
        p.position_gain_1_s2,
        p.velocity_gain_1_s,
        approach_max_m_s=p.approach_max_m_s,
        feedback_max_m_s2=p.feedback_max_m_s2,
    )
    thrust, derivative = _thrust_vector(predicted.attitude_wb, reference, feedback, model, p)
    thrust, cut = limits.thrust_vector(
        thrust,
        tilt_max_rad=p.tilt_max_rad,
        full_m_s2=_full_thrust_m_s2(model, p),
        vertical_min_m_s2=p.vertical_thrust_min_m_s2,
    )
    attitude_wb = predicted.attitude_wb
    yaw_rad = reference.yaw_rad
    desired_wb = flatness.attitude_from_thrust(thrust, yaw_rad, attitude_wb, p.heading_axis)
    feed_forward, slow = ZERO3, None
    if p.rate_feed_forward:
        wanted = flatness.body_rates(desired_wb, thrust, derivative, yaw_rad, reference.yaw_rate_rad_s, p.heading_axis)
        lead, slow = _lead(memory, wanted, dt_s, p)
        feed_forward = rotate(multiply(conjugate(attitude_wb), desired_wb), lead)
    rates = add(_attitude_rates(attitude_wb, desired_wb, thrust, p), feed_forward)
    rates = limits.tilt_guard(
        rates,
        attitude_wb,
        predicted.rates_frd_rad_s,
        tilt_max_rad=p.tilt_max_rad,
        rate_lag_s=p.rate_lag_s[0],
        late_s=model.lateness.late_s,
    )
    record = ControlRecord(
        limited=("thrust_vector",) if cut else (),
        position_error_ned_m=position_error,
        velocity_error_ned_m_s=velocity_error,
        feedback_ned_m_s2=feedback,
        thrust_ned_m_s2=thrust,
        desired_wb=desired_wb,
        feed_forward_frd_rad_s=feed_forward,
    )
    command = _thrust_command(model, thrust, derivative, attitude_wb, p)
    return Flow(Setpoint(rates, command), Memory(slow), record)


def _thrust_vector(
    attitude_wb: Quat, reference: Reference, feedback: Vec3, model: VehicleModel, p: ControlParameters
) -> tuple[Vec3, Vec3]:
    """Wanted thrust acceleration and its derivative by the reference (NED), before limits."""
    gravity = (0.0, 0.0, p.gravity_m_s2)
    bare = subtract(reference.acceleration_ned_m_s2, gravity)
    drag_1_s = total(model.drag, p.drag_1_s)
    drag, drag_derivative = reference_drag(
        reference, bare, attitude_wb, drag_1_s, p.heading_axis, original=p.original_drag
    )
    wanted = subtract(add(bare, feedback), add(drag, model.disturbance_ned_m_s2))
    return wanted, subtract(reference.jerk_ned_m_s3, drag_derivative)


def _attitude_rates(attitude_wb: Quat, desired_wb: Quat, thrust_ned_m_s2: Vec3, p: ControlParameters) -> Vec3:
    """Feedback rates of the chosen law."""
    near_wb = attitude_laws.tilt_first(attitude_wb, desired_wb, p.heading_error_max_rad)
    time_constant_s = p.attitude_time_constant_s
    if p.attitude_law is AttitudeLaw.GEOMETRIC:
        return attitude_laws.geometric(attitude_wb, near_wb, time_constant_s, original_gain=p.original_gain)
    rates = attitude_laws.quaternion(attitude_wb, near_wb, time_constant_s)
    if p.attitude_law is AttitudeLaw.QUATERNION:
        return rates
    tilting = attitude_laws.jerk_to(attitude_wb, thrust_ned_m_s2, down_axis(attitude_wb), time_constant_s[0])
    return (tilting[0], tilting[1], rates[2])


def _lead(memory: Memory, rates: Vec3, dt_s: float, p: ControlParameters) -> tuple[Vec3, Vec3]:
    """Feed-forward rates led by the rate loop's lag, (1 + T s) / (1 + T s / ratio), and the filter's memory."""
    slow = memory.slow_feed_forward_rad_s or rates
    if not p.lag_compensation:
        return rates, rates
    share = tuple(1.0 - exp(-dt_s * _LEAD_RATIO / lag_s) if lag_s > 0.0 else 1.0 for lag_s in p.rate_lag_s)
    gain = _LEAD_RATIO - 1.0
    slow = (
        slow[0] + share[0] * (rates[0] - slow[0]),
        slow[1] + share[1] * (rates[1] - slow[1]),
        slow[2] + share[2] * (rates[2] - slow[2]),
    )
    led = (
        rates[0] + gain * (rates[0] - slow[0]),
        rates[1] + gain * (rates[1] - slow[1]),
        rates[2] + gain * (rates[2] - slow[2]),
    )
    return led, slow


def _full_thrust_m_s2(model: VehicleModel, p: ControlParameters) -> float:
    """Acceleration at the largest thrust command."""
    return thrust_map.acceleration_from_command(p.thrust_max, model.hover_thrust, p.thrust_curve, p.gravity_m_s2)


def _thrust_command(
    model: VehicleModel, thrust_ned_m_s2: Vec3, derivative_ned_m_s3: Vec3, attitude_wb: Quat, p: ControlParameters
) -> float:
    """Command for the part of the wanted thrust along the thrust axis of now, led by the lag of thrust."""
    along_m_s2 = -dot(thrust_ned_m_s2, down_axis(attitude_wb))
    if p.lag_compensation:
        along_m_s2 += p.thrust_lag_s * flatness.thrust_rate(thrust_ned_m_s2, derivative_ned_m_s3)
    if p.linear_thrust is not None:
        return thrust_map.linear_command(along_m_s2, *p.linear_thrust)
    return thrust_map.command_from_acceleration(along_m_s2, model.hover_thrust, p.thrust_curve, p.gravity_m_s2)
