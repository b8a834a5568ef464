"""The control law as the pipeline calls it: state and reference in, body rates and thrust out.

position law -> thrust vector within limits -> attitude -> attitude law and feed-forward -> thrust map -> limits.
Time constants and dead times: the caller predicts the state to the moment at which the command acts; what remains, the
lags of rates and thrust, is compensated here.
"""

from dataclasses import dataclass, replace
from math import exp

from daemon.control import attitude_laws, flatness, limits, position_law, thrust_map, velocity_yaw
from daemon.control.model import VehicleModel, commanded, observed
from daemon.control.parameters import AttitudeLaw, ControlParameters
from daemon.control.soundness import refusals, sound_dt_s, sound_state
from daemon.frames import (
    add,
    clamp,
    conjugate,
    dot,
    down_axis,
    multiply,
    normalized,
    rotate,
    rotate_about_down,
    subtract,
)
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reference, Reset, Setpoint, Vec3

RESTART_S = 0.5  # memories of the flow are forgotten after a longer pause
_LEAD_RATIO = 2.5  # of the lead filter; bounds what it makes of a step of the feed-forward
_MATCH_COSINE_MIN = 0.5  # thrust is raised for a tilt up to 60 degrees


@dataclass(frozen=True, slots=True, eq=False)
class ControlState:
    """Memory between two steps: last command (None: none yet), vehicle model, filter of the feed-forward."""

    time_s: float
    setpoint: Setpoint | None
    model: VehicleModel
    slow_feed_forward_rad_s: Vec3 | None = None
    heading_rad: float | None = None

    @property
    def hover_thrust(self) -> float:
        """Command that hovers, as estimated so far."""
        return self.model.hover_thrust


@dataclass(frozen=True, slots=True, eq=False)
class ControlRecord:
    """What the law saw and did in one step; errors are measured minus reference.

    ``refused`` names the inputs that were unusable (estimate, predicted, reference), ``limited`` the limits that cut
    (thrust_vector, rates, thrust, slew). ``acceleration_ned_m_s2`` is what the vehicle is expected to accelerate with
    now, for prediction.
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
    hover_thrust: float = 0.0
    acceleration_ned_m_s2: Vec3 = ZERO3


@dataclass(frozen=True, slots=True, eq=False)
class _Flow:
    """What one pass through the law gives before the setpoint's limits."""

    setpoint: Setpoint
    slow_feed_forward_rad_s: Vec3 | None
    heading_rad: float | None
    record: ControlRecord


def initial(parameters: ControlParameters) -> ControlState:
    """State before the first step."""
    return ControlState(float("-inf"), None, VehicleModel(hover_thrust=parameters.hover_thrust))


def step(
    state: ControlState,
    estimate: EstimatedState,
    predicted: EstimatedState,
    reference: Reference,
    dt_s: float,
    *,
    parameters: ControlParameters,
) -> tuple[ControlState, Setpoint, ControlRecord]:
    """One step of the control law.

    ``estimate`` is the newest accepted state at its own stamp, for the observers; ``predicted`` the state at the
    moment at which the command acts; ``reference`` is sampled at that moment; ``dt_s`` since the last step.
    Never raises; whatever comes in, the setpoint is finite and within limits. Without a usable predicted state: zero
    rates at hover thrust; without a usable reference: level.
    """
    p = parameters
    dt_s = sound_dt_s(dt_s)
    refused = refusals(estimate, predicted, reference)
    if "predicted" not in refused and abs(predicted.time_s - state.time_s) > RESTART_S:
        state = ControlState(state.time_s, None, VehicleModel(hover_thrust=state.model.hover_thrust))
    model = state.model if "estimate" in refused else observed(state.model, estimate, p)
    state = replace(state, model=model)
    if "predicted" in refused:
        flow = _Flow(blind(state, parameters=p), None, state.heading_rad, ControlRecord())
        last = state.setpoint or flow.setpoint
    else:
        predicted = replace(predicted, attitude_wb=normalized(predicted.attitude_wb))
        last = state.setpoint or match(state, predicted, parameters=p)
        if "reference" in refused:
            flow = _Flow(level(state, predicted, parameters=p), None, state.heading_rad, ControlRecord())
        else:
            flow = _law(state, predicted, reference, dt_s, p)
    setpoint, limited = _limited(flow.setpoint, last, model.hover_thrust, dt_s, p)
    time_s = state.time_s if "predicted" in refused else predicted.time_s
    model = commanded(model, time_s, setpoint.thrust)
    record = replace(
        flow.record,
        refused=refused,
        limited=flow.record.limited + limited,
        disturbance_ned_m_s2=model.observer.disturbance_ned_m_s2,
        hover_thrust=model.hover_thrust,
        acceleration_ned_m_s2=model.acceleration_ned_m_s2,
    )
    return ControlState(time_s, setpoint, model, flow.slow_feed_forward_rad_s, flow.heading_rad), setpoint, record


def blind(state: ControlState, *, parameters: ControlParameters) -> Setpoint:
    """What flies without any state: zero rates at hover thrust."""
    p = parameters
    return Setpoint(ZERO3, clamp(state.hover_thrust, p.thrust_min, p.thrust_max))


def match(state: ControlState, estimate: EstimatedState, *, parameters: ControlParameters) -> Setpoint:
    """Hold the vehicle as it is, for engaging: zero rates, hover thrust raised for the tilt."""
    hover = blind(state, parameters=parameters)
    if not sound_state(estimate):
        return hover
    cosine = down_axis(normalized(estimate.attitude_wb))[2]
    return _within(Setpoint(ZERO3, hover.thrust / clamp(cosine, _MATCH_COSINE_MIN, 1.0)), hover.thrust, parameters)


def level(state: ControlState, predicted: EstimatedState, *, parameters: ControlParameters) -> Setpoint:
    """Level the predicted attitude by the shortest turn at hover thrust; zero rates once level."""
    hover = blind(state, parameters=parameters)
    if not sound_state(predicted):
        return hover
    attitude_wb = normalized(predicted.attitude_wb)
    desired_wb = flatness.shortest_turn(attitude_wb, (0.0, 0.0, 1.0))
    rates = attitude_laws.quaternion(attitude_wb, desired_wb, parameters.attitude_time_constant_s)
    return _within(Setpoint(rates, hover.thrust), hover.thrust, parameters)


def shifted(state: ControlState, reset: Reset) -> ControlState:
    """State after a jump of the estimate: memories in NED turn by the heading, velocity memories shift.

    The command in the body does not change by it.
    """
    observer = state.model.observer
    turned = replace(
        observer,
        velocity_ned_m_s=add(observer.velocity_ned_m_s, reset.velocity_ned_m_s),
        disturbance_ned_m_s2=rotate_about_down(observer.disturbance_ned_m_s2, reset.yaw_rad),
        model_ned_m_s2=rotate_about_down(observer.model_ned_m_s2, reset.yaw_rad),
    )
    heading_rad = None if state.heading_rad is None else state.heading_rad + reset.yaw_rad
    return replace(state, model=replace(state.model, observer=turned), heading_rad=heading_rad)


def _law(
    state: ControlState, predicted: EstimatedState, reference: Reference, dt_s: float, p: ControlParameters
) -> _Flow:
    """The law itself, on sound inputs."""
    position_error = subtract(predicted.position_ned_m, reference.position_ned_m)
    velocity_error = subtract(predicted.velocity_ned_m_s, reference.velocity_ned_m_s)
    feedback = ZERO3
    if not p.feedthrough:
        feedback = position_law.feedback(
            position_error,
            velocity_error,
            p.position_gain_1_s2,
            p.velocity_gain_1_s,
            approach_max_m_s=p.approach_max_m_s,
            feedback_max_m_s2=p.feedback_max_m_s2,
        )
    yaw_rad, yaw_rate_rad_s, heading_rad = _heading(state, reference, p)
    thrust, thrust_derivative = _thrust_vector(
        predicted, reference, feedback, state.model.observer.disturbance_ned_m_s2, yaw_rad, p
    )
    full_m_s2 = _full_thrust_m_s2(state.model, p)
    thrust, cut = limits.thrust_vector(
        thrust, tilt_max_rad=p.tilt_max_rad, full_m_s2=full_m_s2, vertical_min_m_s2=p.vertical_thrust_min_m_s2
    )
    attitude_wb = predicted.attitude_wb
    desired_wb = flatness.attitude_from_thrust(thrust, yaw_rad, attitude_wb, p.heading_axis)
    rates = _attitude_rates(attitude_wb, desired_wb, thrust, p)
    feed_forward, slow = ZERO3, None
    if p.rate_feed_forward:
        wanted = flatness.body_rates(desired_wb, thrust, thrust_derivative, yaw_rad, yaw_rate_rad_s)
        lead, slow = _lead(state, wanted, dt_s, p)
        feed_forward = rotate(multiply(conjugate(attitude_wb), desired_wb), lead)
    rates = add(rates, feed_forward)
    rates = limits.tilt_guard(rates, attitude_wb, p.tilt_max_rad, p.attitude_time_constant_s[0])
    lead_m_s2 = p.thrust_lag_s * flatness.thrust_rate(thrust, thrust_derivative) if p.lag_compensation else 0.0
    setpoint = Setpoint(rates, _thrust_command(state.model, thrust, attitude_wb, lead_m_s2, p))
    record = ControlRecord(
        limited=("thrust_vector",) if cut else (),
        position_error_ned_m=position_error,
        velocity_error_ned_m_s=velocity_error,
        feedback_ned_m_s2=feedback,
        thrust_ned_m_s2=thrust,
        desired_wb=desired_wb,
        feed_forward_frd_rad_s=feed_forward,
    )
    return _Flow(setpoint, slow, heading_rad, record)


def _heading(state: ControlState, reference: Reference, p: ControlParameters) -> tuple[float, float, float | None]:
    """Wanted yaw and yaw rate, and the heading to remember."""
    if not p.velocity_yaw:
        return reference.yaw_rad, reference.yaw_rate_rad_s, None
    before = reference.yaw_rad if state.heading_rad is None else state.heading_rad
    yaw_rad, rate = velocity_yaw.heading(
        reference.velocity_ned_m_s, reference.acceleration_ned_m_s2, before, minimum_m_s=p.velocity_yaw_min_m_s
    )
    return yaw_rad, rate, yaw_rad


def _thrust_vector(
    predicted: EstimatedState,
    reference: Reference,
    feedback: Vec3,
    disturbance: Vec3,
    yaw_rad: float,
    p: ControlParameters,
) -> tuple[Vec3, Vec3]:
    """Wanted thrust acceleration and its derivative by the reference (NED), before limits."""
    gravity = (0.0, 0.0, p.gravity_m_s2)
    bare = subtract(reference.acceleration_ned_m_s2, gravity)
    flat_wb = flatness.attitude_from_thrust(bare, yaw_rad, predicted.attitude_wb, p.heading_axis)
    drag = flatness.rotor_drag(flat_wb, reference.velocity_ned_m_s, p.drag_1_s)
    drag_derivative = flatness.rotor_drag(flat_wb, reference.acceleration_ned_m_s2, p.drag_1_s)
    wanted = subtract(add(bare, feedback), add(drag, disturbance))
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


def _lead(state: ControlState, rates: Vec3, dt_s: float, p: ControlParameters) -> tuple[Vec3, Vec3]:
    """Feed-forward rates led by the rate loop's lag, (1 + T s) / (1 + T s / ratio), and the filter's memory."""
    slow = state.slow_feed_forward_rad_s or rates
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
    model: VehicleModel, thrust_ned_m_s2: Vec3, attitude_wb: Quat, lead_m_s2: float, p: ControlParameters
) -> float:
    """Command for the part of the wanted thrust that lies along the thrust axis of now."""
    along_m_s2 = -dot(thrust_ned_m_s2, down_axis(attitude_wb)) + lead_m_s2
    if p.linear_thrust is not None:
        return thrust_map.linear_command(along_m_s2, *p.linear_thrust)
    return thrust_map.command_from_acceleration(along_m_s2, model.hover_thrust, p.thrust_curve, p.gravity_m_s2)


def _limited(
    wanted: Setpoint, last: Setpoint, hover_thrust: float, dt_s: float, p: ControlParameters
) -> tuple[Setpoint, tuple[str, ...]]:
    """The setpoint within slew, rates and thrust, and the names of the limits that cut."""
    bounded = _within(wanted, hover_thrust, p)
    slewed = limits.toward(
        last, bounded, rate_step_rad_s=p.rate_slew_max_rad_s2 * dt_s, thrust_step=p.thrust_slew_max_1_s * dt_s
    )
    names = (
        ("rates", bounded.rates_frd_rad_s != wanted.rates_frd_rad_s),
        ("thrust", bounded.thrust != wanted.thrust),
        ("slew", slewed.rates_frd_rad_s != bounded.rates_frd_rad_s or slewed.thrust != bounded.thrust),
    )
    return _within(slewed, hover_thrust, p), tuple(name for name, cut in names if cut)


def _within(setpoint: Setpoint, hover_thrust: float, p: ControlParameters) -> Setpoint:
    return limits.within(
        setpoint,
        rate_max_rad_s=p.rate_max_rad_s,
        yaw_rate_max_rad_s=p.yaw_rate_max_rad_s,
        thrust_min=p.thrust_min,
        thrust_max=p.thrust_max,
        fallback_thrust=hover_thrust,
    )
