"""The whole control flow, once, as pure code: telemetry in, setpoint out.

The live control task, the tests in virtual time and the replay of a flight record call the same ``step``. It raises
nothing in flight: what cannot be used is named in the record, and the supervisor acts on it.
"""

from dataclasses import dataclass, field, replace

from daemon import frames
from daemon.control import controller
from daemon.control.controller import ControlState
from daemon.control.law import ControlRecord
from daemon.control.parameters import ControlParameters
from daemon.estimation import estimator, predictor
from daemon.estimation.estimator import Estimate, EstimatorParameters, EstimatorState
from daemon.estimation.predictor import PredictorParameters, SentRates
from daemon.guidance.brake import brake
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.messages import (
    WINDOW_SPACING_S,
    ZERO3,
    AutopilotStatus,
    EstimatedState,
    ExternalPose,
    FlightMode,
    FrameShift,
    Imu,
    Odometry,
    Reference,
    ReferenceWindow,
    Setpoint,
    Vec3,
    VehicleRequest,
)
from daemon.safety import supervision as safety
from daemon.safety.conditions import Bounds, Conditions, Facts
from daemon.safety.supervision import Drive, Supervision, Timing
from daemon.safety.supervisor import FLYING, OURS


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """All that the flow can be tuned by.

    ``command_latency_s``: from sending a setpoint until it acts. ``fence_shift``: the frame in which the fence's anchor
    was computed; resets since then move it.
    """

    estimator: EstimatorParameters
    predictor: PredictorParameters
    control: ControlParameters
    limits: MotionLimits
    bounds: Bounds
    timing: Timing
    command_latency_s: float = 0.02
    fence_shift: FrameShift = field(default_factory=FrameShift)


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """The newest of everything at this tick; what did not change since the last tick is the same object."""

    odometry: Odometry | None
    imu: Imu | None
    status: AutopilotStatus
    window: ReferenceWindow | None
    request: VehicleRequest | None
    latched: bool
    parameters: Parameters
    pose: ExternalPose | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PipelineState:
    """Memory between ticks. ``flown`` is the reference of the last tick, the one that a new plan starts from."""

    estimator: EstimatorState
    control: ControlState
    supervision: Supervision
    acceleration_ned_m_s2: Vec3 = ZERO3
    sent: tuple[SentRates, ...] = ()
    flown: Reference | None = None
    braking: Plan | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """All that happened in a tick, for the tasks, the flight record and the replay."""

    now_s: float
    dt_s: float
    estimate: Estimate
    predicted: EstimatedState | None
    supervision: Supervision
    conditions: Conditions
    drive: Drive
    reference: Reference | None
    control: ControlRecord | None
    setpoint: Setpoint | None
    modes: tuple[FlightMode, ...]


def initial(parameters: Parameters) -> PipelineState:
    """The state before the first tick."""
    return PipelineState(
        estimator=estimator.initial(parameters.estimator),
        control=controller.initial(parameters.control),
        supervision=Supervision(),
    )


def step(
    state: PipelineState, inputs: Inputs, now_s: float, dt_s: float
) -> tuple[PipelineState, Setpoint | None, Record]:
    """One tick at ``now_s`` of the loop's clock: the new state, what to send (None: nothing), and the record."""
    parameters = inputs.parameters
    estimation, estimate = estimator.step(
        state.estimator,
        inputs.odometry,
        inputs.imu,
        state.acceleration_ned_m_s2,
        now_s,
        parameters=parameters.estimator,
        pose=inputs.pose,
    )
    state = _with_reset(replace(state, estimator=estimation), estimate)
    supervision, conditions, modes = _supervise(state, inputs, estimate, now_s)
    how = safety.drive(supervision, conditions)
    act_s = now_s + parameters.command_latency_s
    predicted = estimate.newest and predictor.predict(
        estimate.newest, act_s, state.acceleration_ned_m_s2, state.sent, parameters=parameters.predictor
    )
    state = _with_supervision(state, supervision, inputs.window, predicted, estimate.shift, act_s, parameters)
    state, setpoint, control = _command(state, how, estimate.newest, predicted, act_s, dt_s, parameters.control)
    sent = (
        ()
        if setpoint is None
        else predictor.remembered(state.sent, now_s, setpoint.rates_frd_rad_s, parameters=parameters.predictor)
    )
    state = replace(state, sent=sent)
    record = Record(
        now_s=now_s,
        dt_s=dt_s,
        estimate=estimate,
        predicted=predicted,
        supervision=supervision,
        conditions=conditions,
        drive=how,
        reference=state.flown,
        control=control,
        setpoint=setpoint,
        modes=modes,
    )
    return state, setpoint, record


def _with_reset(state: PipelineState, estimate: Estimate) -> PipelineState:
    """A reset of the autopilot's estimate moves every number of the world frame within the same tick."""
    reset = estimate.reset
    if reset is None:
        return state
    return replace(
        state,
        control=controller.shifted(state.control, reset),
        acceleration_ned_m_s2=frames.rotate_about_down(state.acceleration_ned_m_s2, reset.yaw_rad),
        flown=state.flown
        and _shifted(state.flown, reset.position_ned_m, reset.velocity_ned_m_s, reset.yaw_rad, state.flown.time_s),
        braking=None,
    )


def _supervise(
    state: PipelineState, inputs: Inputs, estimate: Estimate, now_s: float
) -> tuple[Supervision, Conditions, tuple[FlightMode, ...]]:
    facts = Facts(
        status=inputs.status,
        state=estimate.newest,
        age_s=estimate.age_s,
        position_variance_m2=estimate.position_variance_m2,
        disagreement_rad=estimate.disagreement_rad,
        truth_returned=estimate.reset is not None and estimate.reset.truth_returned,
        goal_active=inputs.window is not None and inputs.window.goal_id is not None,
        latched=inputs.latched,
    )
    return safety.step(
        state.supervision,
        facts,
        inputs.request,
        now_s,
        bounds=_bounds(inputs.parameters, estimate.shift),
        timing=inputs.parameters.timing,
    )


def _bounds(parameters: Parameters, shift: FrameShift) -> Bounds:
    """The bounds with the fence where it is called now."""
    if shift.count == parameters.fence_shift.count:
        return parameters.bounds
    fence = parameters.bounds.fence
    dp = frames.subtract(shift.position_ned_m, parameters.fence_shift.position_ned_m)
    return replace(parameters.bounds, fence=replace(fence, anchor_ned_m=frames.add(fence.anchor_ned_m, dp)))


def _with_supervision(
    state: PipelineState,
    supervision: Supervision,
    window: ReferenceWindow | None,
    predicted: EstimatedState | None,
    shift: FrameShift,
    act_s: float,
    parameters: Parameters,
) -> PipelineState:
    """The reference of this tick: from the window while it covers the moment, else braking to a hover."""
    was_ours = state.supervision.state in OURS
    state = replace(state, supervision=supervision)
    if supervision.state not in OURS:
        return replace(state, flown=None, braking=None, acceleration_ned_m_s2=ZERO3)
    if not was_ours:
        state = replace(state, control=controller.initial(parameters.control), flown=None, braking=None)
    if supervision.state not in FLYING and state.flown is None:
        return state
    if state.flown is None:
        if predicted is None:
            return state
        state = replace(state, flown=at_rest(predicted, act_s))
    flown = _sample(window, shift, act_s) if _covers(window, act_s) else None
    if flown is not None:
        return replace(state, flown=flown, braking=None)
    assert state.flown is not None
    braking = state.braking or brake(state.flown, parameters.limits)
    return replace(state, flown=braking.sample(act_s), braking=braking)


def _command(
    state: PipelineState,
    how: Drive,
    newest: EstimatedState | None,
    predicted: EstimatedState | None,
    act_s: float,
    dt_s: float,
    parameters: ControlParameters,
) -> tuple[PipelineState, Setpoint | None, ControlRecord | None]:
    if how is Drive.SILENT:
        return state, None, None
    if newest is None or predicted is None:
        return state, controller.blind(state.control, parameters=parameters), None
    if how is Drive.MATCH:
        return state, controller.match(state.control, newest, parameters=parameters), None
    if how is Drive.LEVEL and predicted.time_s < act_s - 1e-6:
        # Nothing is known of now: levelling a prediction that stands still would keep turning.
        return state, controller.blind(state.control, parameters=parameters), None
    if how is Drive.LEVEL or state.flown is None:
        return state, controller.level(state.control, predicted, parameters=parameters), None
    control, setpoint, record = controller.step(
        state.control, newest, predicted, state.flown, dt_s, parameters=parameters
    )
    return replace(state, control=control, acceleration_ned_m_s2=record.acceleration_ned_m_s2), setpoint, record


def _covers(window: ReferenceWindow | None, time_s: float) -> bool:
    return (
        window is not None
        and bool(window.samples)
        and window.samples[0].time_s <= time_s <= window.samples[-1].time_s + WINDOW_SPACING_S
    )


def _sample(window: ReferenceWindow | None, shift: FrameShift, time_s: float) -> Reference:
    """The window at a moment, by its own derivatives from the sample before, in the frame of now."""
    assert window is not None
    first = window.samples[0].time_s
    index = min(int((time_s - first) / WINDOW_SPACING_S), len(window.samples) - 1)
    reference = _extrapolated(window.samples[index], time_s)
    if window.shift.count == shift.count:
        return reference
    return _shifted(
        reference,
        frames.subtract(shift.position_ned_m, window.shift.position_ned_m),
        frames.subtract(shift.velocity_ned_m_s, window.shift.velocity_ned_m_s),
        shift.yaw_rad - window.shift.yaw_rad,
        shift.time_s,
    )


def _extrapolated(r: Reference, time_s: float) -> Reference:
    t = time_s - r.time_s
    p, v, a, j = r.position_ned_m, r.velocity_ned_m_s, r.acceleration_ned_m_s2, r.jerk_ned_m_s3
    t2, t3 = 0.5 * t * t, t * t * t / 6.0
    return Reference(
        time_s=time_s,
        position_ned_m=(
            p[0] + v[0] * t + a[0] * t2 + j[0] * t3,
            p[1] + v[1] * t + a[1] * t2 + j[1] * t3,
            p[2] + v[2] * t + a[2] * t2 + j[2] * t3,
        ),
        velocity_ned_m_s=(v[0] + a[0] * t + j[0] * t2, v[1] + a[1] * t + j[1] * t2, v[2] + a[2] * t + j[2] * t2),
        acceleration_ned_m_s2=(a[0] + j[0] * t, a[1] + j[1] * t, a[2] + j[2] * t),
        jerk_ned_m_s3=j,
        yaw_rad=frames.wrap_pi(r.yaw_rad + r.yaw_rate_rad_s * t),
        yaw_rate_rad_s=r.yaw_rate_rad_s,
    )


def _shifted(r: Reference, dp: Vec3, dv: Vec3, dyaw: float, since_s: float) -> Reference:
    since = max(0.0, r.time_s - since_s)
    return replace(
        r,
        position_ned_m=frames.add(frames.add(r.position_ned_m, dp), frames.scale(dv, since)),
        velocity_ned_m_s=frames.add(r.velocity_ned_m_s, dv),
        yaw_rad=frames.wrap_pi(r.yaw_rad + dyaw),
    )


def at_rest(state: EstimatedState, time_s: float) -> Reference:
    """The reference that a vehicle flies at a moment at which nobody gave it one: as it is, unaccelerated."""
    return Reference(
        time_s=time_s,
        position_ned_m=state.position_ned_m,
        velocity_ned_m_s=state.velocity_ned_m_s,
        yaw_rad=frames.yaw_of(state.attitude_wb),
    )
