"""The estimator of the flow: each tick the newest telemetry in, what is known of the vehicle out."""

from dataclasses import dataclass, field
from math import inf

from daemon.estimation import cross_check, fusion, gate
from daemon.estimation.cross_check import CrossCheckParameters, CrossCheckState
from daemon.estimation.filter_base import Correction
from daemon.estimation.fusion import Fused, FusionParameters, FusionState
from daemon.estimation.gate import Refusal
from daemon.estimation.intake import Event, IntakeParameters, IntakeState, take
from daemon.estimation.quality import Quality
from daemon.frames import clip_norm, is_finite
from daemon.messages import ZERO3, ClockSync, EstimatedState, ExternalPose, FrameShift, Imu, Odometry, Reset, Vec3
from daemon.values import value

_NOT_FUSED = Fused(None)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorParameters(IntakeParameters):
    """Parameters of the intake's parts, of the cross-check, and of the filter.

    ``fusion`` None: the autopilot's own estimate is flown. Else an EKF or UKF fuses it with poses from outside.
    """

    cross_check: CrossCheckParameters = field(default_factory=CrossCheckParameters)
    fusion: FusionParameters | None = None


@value
class EstimatorState:
    """Memory of the parts."""

    intake: IntakeState = field(default_factory=IntakeState)
    cross_check: CrossCheckState = field(default_factory=CrossCheckState)
    fusion: FusionState | None = None


@value
class Estimate:
    """What a tick knows of the vehicle.

    ``newest``: the accepted sample, or what the filter makes of it, at the loop-clock time at which it was true; None
    before the first.
    ``age_s``: now minus that time; inf when there is none. ``reset``, ``refused`` and ``events``: of this tick.
    ``reset`` is by how much ``newest`` jumped: that of a velocity fades in, its whole size is in the event.
    ``shift``: sum of these resets, this tick's included. ``position_variance_m2``: inf when there is no sample.
    ``disagreement_rad``: between the autopilot's tilt and that of the cross-check, low-passed.
    ``corrections``: what the filter took or refused in this tick, by source.
    """

    newest: EstimatedState | None
    age_s: float
    reset: Reset | None
    refused: str | None
    shift: FrameShift
    events: tuple[Event, ...]
    position_variance_m2: float
    quality: Quality
    disagreement_rad: float
    corrections: tuple[Correction, ...]


def initial(parameters: EstimatorParameters) -> EstimatorState:
    """Nothing seen yet."""
    return EstimatorState()


def step(
    state: EstimatorState,
    odometry: Odometry | None,
    imu: Imu | None,
    acceleration_ned_m_s2: Vec3,
    now_s: float,
    *,
    parameters: EstimatorParameters,
    pose: ExternalPose | None = None,
    sync: ClockSync | None = None,
) -> tuple[EstimatorState, Estimate]:
    """One tick: take the newest messages when they are new, say what is known.

    ``acceleration_ned_m_s2``: what the control law has commanded, for the prediction from sample to sample; zero when
    it is not finite. ``pose``: the newest from outside, for the filter. ``sync``: what TIMESYNC says of the clock.
    Raises nothing.
    """
    acceleration = acceleration_ned_m_s2 if is_finite(acceleration_ned_m_s2) else ZERO3
    acceleration = clip_norm(acceleration, parameters.reset.acceleration_max_m_s2)
    intake, taken = take(state.intake, odometry, acceleration, now_s, parameters=parameters, sync=sync)
    attitude = None if intake.newest is None else intake.newest.attitude_wb
    attitude_age_s = 0.0 if intake.newest is None else now_s - intake.newest.time_s
    checked = cross_check.step(state.cross_check, imu, attitude, attitude_age_s, parameters=parameters.cross_check)
    newest, memory, events, fused = intake.newest, None, taken.events, _NOT_FUSED
    if parameters.fusion is not None:
        memory, fused = _fused(state.fusion, newest, taken.reset, pose, acceleration, now_s, parameters.fusion)
        newest = fused.estimate
        events = (*events, Event("filter_restarted", now_s)) if fused.restarted else events
    estimate = Estimate(
        newest=newest,
        age_s=inf if newest is None else max(0.0, now_s - newest.time_s),
        reset=taken.reset,
        refused=None if taken.refused is None else taken.refused.label,
        shift=intake.shift,
        events=events,
        position_variance_m2=inf if newest is None else newest.position_variance_m2,
        quality=intake.quality,
        disagreement_rad=checked.disagreement_rad,
        corrections=fused.corrections,
    )
    return EstimatorState(intake, checked, memory), estimate


def _fused(
    memory: FusionState | None,
    sample: EstimatedState | None,
    reset: Reset | None,
    pose: ExternalPose | None,
    acceleration_ned_m_s2: Vec3,
    now_s: float,
    parameters: FusionParameters,
) -> tuple[FusionState, Fused]:
    """The filter's turn: first into the numbers after a reset, then the sample that brought it."""
    memory = fusion.initial(parameters) if memory is None else memory
    if reset is not None:
        memory = fusion.shifted(memory, reset)
    return fusion.step(memory, sample, pose, acceleration_ned_m_s2, now_s, parameters=parameters)


def refusals(state: EstimatorState, now_s: float, *, parameters: EstimatorParameters) -> dict[str, float]:
    """The gate's decayed counters by reason, for the status."""
    values = gate.decayed(state.intake.counts, now_s, parameters=parameters.gate)
    return {reason.label: values[reason] for reason in Refusal}
