"""The estimator of the flow: gate, clock, reset tracker, slide and quality in one step per tick."""

from dataclasses import dataclass, field
from math import inf

from daemon.estimation import clock, gate, quality
from daemon.estimation.clock import ClockParameters, ClockState, Verdict
from daemon.estimation.continuity import Outcome, compared
from daemon.estimation.gate import Counts, GateParameters, Refusal, Sample
from daemon.estimation.predictor import PredictorParameters
from daemon.estimation.quality import Quality, QualityParameters
from daemon.estimation.reset_tracker import ResetParameters, accumulated
from daemon.estimation.slide import SETTLED, SlideParameters, SlideState
from daemon.frames import clip_norm, is_finite, subtract
from daemon.messages import ZERO3, EstimatedState, FrameShift, Imu, Odometry, Reset, Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorParameters:
    """Parameters of the parts."""

    gate: GateParameters = field(default_factory=GateParameters)
    clock: ClockParameters = field(default_factory=ClockParameters)
    reset: ResetParameters = field(default_factory=ResetParameters)
    slide: SlideParameters = field(default_factory=SlideParameters)
    quality: QualityParameters = field(default_factory=QualityParameters)
    predictor: PredictorParameters = field(default_factory=PredictorParameters)


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """Something to tell: ``reset``, ``fast_slide``, ``regained``, ``clock_stepped``, ``autopilot_rebooted``.

    ``cause`` says more where a name is not enough: the reset's ambiguity (see ``reset_tracker``).
    ``reset`` has the kinds and deltas, ``counter_steps`` how often the autopilot counted.
    """

    name: str
    time_s: float
    cause: str = ""
    reset: Reset | None = None
    counter_steps: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class EstimatorState:
    """What the estimator remembers: the message seen last, the newest accepted sample, and the parts' memories."""

    seen: Odometry | None = None
    clock: ClockState | None = None
    counts: Counts = field(default_factory=Counts)
    sample: Sample | None = None
    newest: EstimatedState | None = None
    slide: SlideState = SETTLED
    shift: FrameShift = field(default_factory=FrameShift)
    quality: Quality = field(default_factory=Quality)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What a tick knows of the vehicle.

    ``newest``: the accepted sample at the loop-clock time at which it was true; None before the first.
    ``age_s``: now minus that time; inf when there is none. ``reset``, ``refused`` and ``events``: of this tick.
    ``shift``: sum of all resets, this tick's included. ``position_variance_m2``: inf when there is no sample.
    """

    newest: EstimatedState | None
    age_s: float
    reset: Reset | None
    refused: str | None
    shift: FrameShift
    events: tuple[Event, ...]
    position_variance_m2: float
    quality: Quality
    disagreement_rad: float = 0.0


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
) -> tuple[EstimatorState, Estimate]:
    """One tick: take the newest message when it is new, say what is known.

    ``acceleration_ned_m_s2``: what the control law has commanded, for the prediction from sample to sample; zero when
    it is not finite. Raises nothing.
    """
    if odometry is None or odometry is state.seen:
        return state, _estimate(state, now_s)
    sample = gate.read(odometry, parameters=parameters.gate)
    if isinstance(sample, Refusal):
        return _refused(state, odometry, sample, now_s, parameters)
    ticking, verdict = clock.observe(state.clock, sample.stamp_us, sample.arrival_s, parameters=parameters.clock)
    if verdict in _STAMP_REFUSALS:
        return _refused(state, odometry, _STAMP_REFUSALS[verdict], now_s, parameters, ticking=ticking)
    events: tuple[Event, ...] = (Event(_CLOCK_EVENTS[verdict], now_s),) if verdict in _CLOCK_EVENTS else ()
    if state.sample is None:
        return _accepted(state, odometry, sample, ticking, Outcome(SETTLED), events, now_s, parameters)
    outcome = compared(
        state.slide,
        state.sample,
        sample,
        _believed(acceleration_ned_m_s2, parameters.predictor),
        clock_set=verdict is not Verdict.GOOD,
        rebooted=verdict is Verdict.REBOOTED,
        resets=parameters.reset,
        slides=parameters.slide,
    )
    if outcome.refused:
        state = EstimatorState(
            odometry, ticking, state.counts, state.sample, state.newest, outcome.slide, state.shift, state.quality
        )
        return _refused(state, odometry, Refusal.JUMP_WITHOUT_RESET, now_s, parameters)
    if outcome.name:
        events += (Event(outcome.name, now_s, outcome.cause, outcome.reset, outcome.counter_steps),)
    return _accepted(state, odometry, sample, ticking, outcome, events, now_s, parameters)


def refusals(state: EstimatorState, now_s: float, *, parameters: EstimatorParameters) -> dict[str, float]:
    """The gate's decayed counters by reason, for the status."""
    values = gate.decayed(state.counts, now_s, parameters=parameters.gate)
    return {reason.label: values[reason] for reason in Refusal}


_STAMP_REFUSALS = {
    Verdict.BACKWARDS: Refusal.STAMP_BACKWARDS,
    Verdict.REPEATED: Refusal.STAMP_REPEATED,
    Verdict.AHEAD: Refusal.STAMP_AHEAD,
}
_CLOCK_EVENTS = {Verdict.STEPPED: "clock_stepped", Verdict.REBOOTED: "autopilot_rebooted"}


def _believed(acceleration_ned_m_s2: Vec3, parameters: PredictorParameters) -> Vec3:
    """The commanded acceleration within its bound; zero when it is not finite."""
    if not is_finite(acceleration_ned_m_s2):
        return ZERO3
    return clip_norm(acceleration_ned_m_s2, parameters.acceleration_max_m_s2)


def _accepted(
    state: EstimatorState,
    odometry: Odometry,
    sample: Sample,
    ticking: ClockState,
    outcome: Outcome,
    events: tuple[Event, ...],
    now_s: float,
    parameters: EstimatorParameters,
) -> tuple[EstimatorState, Estimate]:
    """The sample becomes the newest state, less the excess of a slide."""
    reset, found, variance = outcome.reset, outcome.innovation, sample.position_variance_m2
    newest = EstimatedState(
        clock.loop_time_s(ticking, sample.stamp_us, parameters=parameters.clock),
        subtract(sample.position_ned_m, outcome.slide.excess_ned_m),
        sample.velocity_ned_m_s,
        sample.attitude_wb,
        sample.rates_frd_rad_s,
        variance,
    )
    judged = (
        quality.restarted(variance, parameters=parameters.quality)
        if found is None
        else quality.judged(state.quality, variance, found, parameters=parameters.quality)
    )
    shift = state.shift if reset is None else accumulated(state.shift, reset)
    state = EstimatorState(odometry, ticking, state.counts, sample, newest, outcome.slide, shift, judged)
    return state, _estimate(state, now_s, reset=reset, events=events)


def _refused(
    state: EstimatorState,
    odometry: Odometry,
    reason: Refusal,
    now_s: float,
    parameters: EstimatorParameters,
    ticking: ClockState | None = None,
) -> tuple[EstimatorState, Estimate]:
    """The message is counted and forgotten; what was known stays, and ages."""
    state = EstimatorState(
        odometry,
        ticking or state.clock,
        gate.counted(state.counts, reason, now_s, parameters=parameters.gate),
        state.sample,
        state.newest,
        state.slide,
        state.shift,
        state.quality,
    )
    return state, _estimate(state, now_s, refused=reason.label)


def _estimate(
    state: EstimatorState,
    now_s: float,
    *,
    reset: Reset | None = None,
    refused: str | None = None,
    events: tuple[Event, ...] = (),
) -> Estimate:
    """What the state says at ``now_s``."""
    newest = state.newest
    if newest is None:
        return Estimate(None, inf, reset, refused, state.shift, events, inf, state.quality)
    age = max(0.0, now_s - newest.time_s)
    return Estimate(newest, age, reset, refused, state.shift, events, newest.position_variance_m2, state.quality)
