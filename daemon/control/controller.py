"""The control law as the pipeline calls it: state and reference in, body rates and thrust out.

position law -> thrust vector within limits -> attitude -> attitude law and feed-forward -> thrust map -> limits.
Time constants and dead times: the caller predicts the state to the moment at which the command acts; what remains, the
lags of rates and thrust, is compensated here.
"""

from dataclasses import replace

from daemon.control import attitude_laws, flatness, limits, vehicle_model
from daemon.control.law import NOTHING, ControlRecord, Flow, Memory, fly
from daemon.control.parameters import ControlParameters
from daemon.control.soundness import refusals, sound_dt_s, sound_reset, sound_state
from daemon.control.vehicle_model import VehicleModel
from daemon.frames import (
    clamp,
    down_axis,
    normalized,
    scale,
    subtract,
)
from daemon.messages import ZERO3, EstimatedState, Reference, Reset, Setpoint
from daemon.values import value

RESTART_S = 0.5  # memories of the flow are forgotten after a longer pause
_MATCH_COSINE_MIN = 0.5  # thrust is raised for a tilt up to 60 degrees


@value
class ControlState:
    """Memory between two steps: last command (None: none yet), vehicle model, filter of the feed-forward."""

    time_s: float
    setpoint: Setpoint | None
    model: VehicleModel
    memory: Memory = NOTHING

    @property
    def hover_thrust(self) -> float:
        """Command that hovers, as estimated so far."""
        return self.model.hover_thrust


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
        state = ControlState(state.time_s, None, vehicle_model.restarted(state.model))
    flown = ZERO3 if "reference" in refused else reference.velocity_ned_m_s
    model = state.model if "estimate" in refused else vehicle_model.observed(state.model, estimate, p, flown)
    state = ControlState(state.time_s, state.setpoint, model, state.memory)
    if "predicted" in refused:
        flow = Flow(blind(state, parameters=p), state.memory, ControlRecord())
        last = state.setpoint or flow.setpoint
    else:
        last = state.setpoint or match(state, predicted, parameters=p)
        if "reference" in refused:
            flow = Flow(level(state, predicted, parameters=p), state.memory, ControlRecord())
        else:
            seen_s = predicted.time_s if "estimate" in refused else estimate.time_s
            flow = fly(model, state.memory, _unbiased(predicted, seen_s, model), reference, dt_s, p)
    setpoint, limited = _limited(flow.setpoint, last, model.hover_thrust, dt_s, p)
    time_s = state.time_s if "predicted" in refused else predicted.time_s
    model = vehicle_model.commanded(model, time_s, setpoint)
    seen = flow.record
    record = ControlRecord(
        refused,
        seen.limited + limited,
        seen.position_error_ned_m,
        seen.velocity_error_ned_m_s,
        seen.feedback_ned_m_s2,
        seen.thrust_ned_m_s2,
        seen.desired_wb,
        seen.feed_forward_frd_rad_s,
        model.disturbance_ned_m_s2,
        model.velocity_bias_ned_m_s,
        model.hover_thrust,
        model.acceleration_ned_m_s2,
        model.drag.learned_1_s,
        model.lateness.late_s,
    )
    return ControlState(time_s, setpoint, model, flow.memory), setpoint, record


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

    The command in the body does not change by it. A jump that is no number starts the observers anew.
    """
    if not sound_reset(reset):
        return replace(state, model=vehicle_model.restarted(state.model))
    return replace(state, model=vehicle_model.shifted(state.model, reset))


def _unbiased(predicted: EstimatedState, seen_s: float, model: VehicleModel) -> EstimatedState:
    """The state predicted from ``seen_s``, with a unit quaternion and the velocity at which the position moves."""
    bias = model.velocity_bias_ned_m_s
    ahead_s = clamp(predicted.time_s - seen_s, 0.0, RESTART_S)
    return EstimatedState(
        predicted.time_s,
        subtract(predicted.position_ned_m, scale(bias, ahead_s)),
        subtract(predicted.velocity_ned_m_s, bias),
        normalized(predicted.attitude_wb),
        predicted.rates_frd_rad_s,
        predicted.position_variance_m2,
    )


def _limited(
    wanted: Setpoint, last: Setpoint, hover_thrust: float, dt_s: float, p: ControlParameters
) -> tuple[Setpoint, tuple[str, ...]]:
    """The setpoint within slew, rates and thrust, and the names of the limits that cut."""
    bounded = _within(wanted, hover_thrust, p)
    slewed = limits.toward(
        last, bounded, rate_step_rad_s=p.rate_slew_max_rad_s2 * dt_s, thrust_step=p.thrust_slew_max_1_s * dt_s
    )
    limited: tuple[str, ...] = ()
    if bounded.rates_frd_rad_s != wanted.rates_frd_rad_s:
        limited += ("rates",)
    if bounded.thrust != wanted.thrust:
        limited += ("thrust",)
    if slewed.rates_frd_rad_s != bounded.rates_frd_rad_s or slewed.thrust != bounded.thrust:
        limited += ("slew",)
    return _within(slewed, hover_thrust, p), limited


def _within(setpoint: Setpoint, hover_thrust: float, p: ControlParameters) -> Setpoint:
    return limits.within(
        setpoint,
        rate_max_rad_s=p.rate_max_rad_s,
        yaw_rate_max_rad_s=p.yaw_rate_max_rad_s,
        thrust_min=p.thrust_min,
        thrust_max=p.thrust_max,
        fallback_thrust=hover_thrust,
    )
