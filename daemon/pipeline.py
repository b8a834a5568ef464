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
from daemon.guidance import reference_window
from daemon.guidance.brake import brake
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.messages import (
    ZERO3,
    AutopilotStatus,
    ClockSync,
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
from daemon.safety.supervisor import FLYING, OURS, State
from daemon.values import value


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """All that the flow can be tuned by.

    ``command_latency_s``: from sending a setpoint until it acts. ``fence_shift``: the frame in which the fence's anchor
    was computed; what moved the frame's origin since then moves it.
    """

    estimator: EstimatorParameters
    predictor: PredictorParameters
    control: ControlParameters
    limits: MotionLimits
    bounds: Bounds
    timing: Timing
    command_latency_s: float = 0.02
    fence_shift: FrameShift = field(default_factory=FrameShift)


@value
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
    clock: ClockSync | None = None


@value
class PipelineState:
    """Memory between ticks. ``flown`` is the reference of the last tick, the one that a new plan starts from."""

    estimator: EstimatorState
    control: ControlState
    supervision: Supervision
    acceleration_ned_m_s2: Vec3 = ZERO3
    sent: tuple[SentRates, ...] = ()
    flown: Reference | None = None
    braking: Plan | None = None


@value
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
        sync=inputs.clock,
    )
    state = _with_reset(state, estimate)
    supervision, conditions, modes = _supervise(state, inputs, estimate, now_s, dt_s)
    how = safety.drive(supervision, conditions)
    act_s = now_s + parameters.command_latency_s
    predicted = estimate.newest and predictor.predict(
        estimate.newest, act_s, state.acceleration_ned_m_s2, state.sent, parameters=parameters.predictor
    )
    memory, acceleration, flown, braking = state.control, ZERO3, None, None
    if supervision.state in OURS:
        acceleration = state.acceleration_ned_m_s2
        if state.supervision.state in OURS:
            flown, braking = state.flown, state.braking
        else:
            memory = controller.initial(parameters.control)
        flown, braking = _reference(
            flown, braking, supervision.state, inputs.window, predicted, estimate.shift, act_s, parameters.limits
        )
    memory, setpoint, control = _command(
        memory, flown, how, estimate.newest, predicted, act_s, dt_s, parameters.control
    )
    sent = (
        ()
        if setpoint is None
        else predictor.remembered(state.sent, now_s, setpoint.rates_frd_rad_s, parameters=parameters.predictor)
    )
    acceleration = acceleration if control is None else control.acceleration_ned_m_s2
    state = PipelineState(estimation, memory, supervision, acceleration, sent, flown, braking)
    record = Record(
        now_s=now_s,
        dt_s=dt_s,
        estimate=estimate,
        predicted=predicted,
        supervision=supervision,
        conditions=conditions,
        drive=how,
        reference=flown,
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
        and reference_window.shifted(
            state.flown, reset.position_ned_m, reset.velocity_ned_m_s, reset.yaw_rad, state.flown.time_s
        ),
        braking=None,
    )


def _supervise(
    state: PipelineState, inputs: Inputs, estimate: Estimate, now_s: float, dt_s: float
) -> tuple[Supervision, Conditions, tuple[FlightMode, ...]]:
    facts = Facts(
        status=inputs.status,
        state=estimate.newest,
        age_s=estimate.age_s,
        position_variance_m2=estimate.position_variance_m2,
        variance_grows=estimate.quality.variance_grows,
        innovation=estimate.quality.innovation,
        disagreement_rad=estimate.disagreement_rad,
        truth_returned=estimate.reset is not None and estimate.reset.truth_returned,
        goal_active=inputs.window is not None and inputs.window.goal_id is not None,
        latched=inputs.latched,
        deviation_ned_m=_deviation_ned_m(state.flown, estimate.newest),
        round_trip_s=0.0 if inputs.clock is None else inputs.clock.round_trip_s,
        tick_s=dt_s,
    )
    return safety.step(
        state.supervision,
        facts,
        inputs.request,
        now_s,
        bounds=_bounds(inputs.parameters, estimate.shift),
        timing=inputs.parameters.timing,
    )


def _deviation_ned_m(flown: Reference | None, newest: EstimatedState | None) -> Vec3:
    """From the reference of the last tick to the vehicle; none while nothing is flown."""
    if flown is None or newest is None:
        return ZERO3
    return frames.subtract(newest.position_ned_m, flown.position_ned_m)


def _bounds(parameters: Parameters, shift: FrameShift) -> Bounds:
    """The bounds with the fence where it is called now."""
    if shift.count == parameters.fence_shift.count:
        return parameters.bounds
    fence = parameters.bounds.fence
    dp = frames.subtract(shift.origin_ned_m, parameters.fence_shift.origin_ned_m)
    return replace(parameters.bounds, fence=replace(fence, anchor_ned_m=frames.add(fence.anchor_ned_m, dp)))


def _reference(
    flown: Reference | None,
    braking: Plan | None,
    ours: State,
    window: ReferenceWindow | None,
    predicted: EstimatedState | None,
    shift: FrameShift,
    act_s: float,
    limits: MotionLimits,
) -> tuple[Reference | None, Plan | None]:
    """The reference of this tick: from the window while it covers the moment, else braking to a hover."""
    if flown is None:
        if ours not in FLYING or predicted is None:
            return None, braking
        flown = at_rest(predicted, act_s)
    if window is not None and reference_window.covers(window, act_s):
        return reference_window.sample(window, shift, act_s), None
    braking = braking or brake(flown, limits)
    return braking.sample(act_s), braking


def _command(
    state: ControlState,
    flown: Reference | None,
    how: Drive,
    newest: EstimatedState | None,
    predicted: EstimatedState | None,
    act_s: float,
    dt_s: float,
    parameters: ControlParameters,
) -> tuple[ControlState, Setpoint | None, ControlRecord | None]:
    if how is Drive.SILENT:
        return state, None, None
    if newest is None or predicted is None:
        return state, controller.blind(state, parameters=parameters), None
    if how is Drive.MATCH:
        return state, controller.match(state, newest, parameters=parameters), None
    if how is Drive.LEVEL and predicted.time_s < act_s - 1e-6:
        # Nothing is known of now: levelling a prediction that stands still would keep turning.
        return state, controller.blind(state, parameters=parameters), None
    if how is Drive.LEVEL or flown is None:
        return state, controller.level(state, predicted, parameters=parameters), None
    return controller.step(state, newest, predicted, flown, dt_s, parameters=parameters)


def at_rest(state: EstimatedState, time_s: float) -> Reference:
    """The reference that a vehicle flies at a moment at which nobody gave it one: as it is, unaccelerated."""
    return Reference(
        time_s=time_s,
        position_ned_m=state.position_ned_m,
        velocity_ned_m_s=state.velocity_ned_m_s,
        yaw_rad=frames.yaw_of(state.attitude_wb),
    )
