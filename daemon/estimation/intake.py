"""One new ODOMETRY message: through the gate, the clock and the comparison with the one before; accepted or refused."""

from dataclasses import dataclass, field

from daemon.estimation import clock, gate, quality
from daemon.estimation.clock import ClockParameters, ClockState, Verdict
from daemon.estimation.continuity import Outcome, compared
from daemon.estimation.gate import Counts, GateParameters, Refusal, Sample
from daemon.estimation.quality import Quality, QualityParameters
from daemon.estimation.reset_tracker import ResetParameters, accumulated
from daemon.estimation.slide import SETTLED, SlideParameters, SlideState
from daemon.frames import subtract
from daemon.messages import ClockSync, EstimatedState, FrameShift, Odometry, Reset, Vec3
from daemon.values import value


@dataclass(frozen=True, slots=True, kw_only=True)
class IntakeParameters:
    """Parameters of the parts that a message passes."""

    gate: GateParameters = field(default_factory=GateParameters)
    clock: ClockParameters = field(default_factory=ClockParameters)
    reset: ResetParameters = field(default_factory=ResetParameters)
    slide: SlideParameters = field(default_factory=SlideParameters)
    quality: QualityParameters = field(default_factory=QualityParameters)


@value
class Event:
    """Something to tell: ``reset``, ``fast_slide``, ``regained``, ``clock_stepped``.

    ``cause`` says more where a name is not enough: the reset's ambiguity (see ``reset_tracker``).
    ``reset`` has the kinds and deltas of the autopilot's numbers, ``counter_steps`` how often the autopilot counted.
    """

    name: str
    time_s: float
    cause: str = ""
    reset: Reset | None = None
    counter_steps: int = 0


@value
class IntakeState:
    """``seen``: the newest message, taken or not. ``sample``: the newest accepted one; ``newest``: the state of it."""

    seen: Odometry | None = None
    clock: ClockState | None = None
    counts: Counts = field(default_factory=Counts)
    sample: Sample | None = None
    newest: EstimatedState | None = None
    slide: SlideState = SETTLED
    shift: FrameShift = field(default_factory=FrameShift)
    quality: Quality = field(default_factory=Quality)


@value
class Taken:
    """What became of a message: a reset as it came through, the reason why it was refused, events."""

    reset: Reset | None = None
    refused: Refusal | None = None
    events: tuple[Event, ...] = ()


NOTHING = Taken()

_FIRST = Outcome(SETTLED)
_STAMP_REFUSALS = {
    Verdict.BACKWARDS: Refusal.STAMP_BACKWARDS,
    Verdict.REPEATED: Refusal.STAMP_REPEATED,
    Verdict.AHEAD: Refusal.STAMP_AHEAD,
}


def take(
    state: IntakeState,
    odometry: Odometry | None,
    acceleration_ned_m_s2: Vec3,
    now_s: float,
    *,
    parameters: IntakeParameters,
    sync: ClockSync | None = None,
) -> tuple[IntakeState, Taken]:
    """Take a message when it is another one than the last. ``acceleration_ned_m_s2`` is commanded, and finite."""
    if odometry is None or odometry is state.seen:
        return state, NOTHING
    sample = gate.read(odometry, parameters=parameters.gate)
    if isinstance(sample, Refusal):
        return _refused(state, odometry, sample, state.clock, state.slide, now_s, parameters)
    if state.seen is not None and gate.frozen(state.seen, odometry):
        return _refused(state, odometry, Refusal.FROZEN, state.clock, state.slide, now_s, parameters)
    ticking, verdict = clock.observe(
        state.clock, sample.stamp_us, sample.arrival_s, parameters=parameters.clock, sync=sync
    )
    if verdict in _STAMP_REFUSALS:
        return _refused(state, odometry, _STAMP_REFUSALS[verdict], ticking, state.slide, now_s, parameters)
    outcome = _FIRST
    if state.sample is not None:
        outcome = compared(
            state.slide,
            state.sample,
            sample,
            acceleration_ned_m_s2,
            clock_set=verdict is not Verdict.GOOD,
            set_back=verdict is Verdict.SET_BACK,
            resets=parameters.reset,
            slides=parameters.slide,
        )
    if outcome.refused:
        return _refused(state, odometry, Refusal.JUMP_WITHOUT_RESET, ticking, outcome.slide, now_s, parameters)
    events: tuple[Event, ...] = () if verdict is Verdict.GOOD else (Event("clock_stepped", now_s),)
    if outcome.name:
        events += (Event(outcome.name, now_s, outcome.cause, outcome.reset, outcome.counter_steps),)
    return _accepted(state, odometry, sample, ticking, outcome, parameters), Taken(outcome.through, None, events)


def _accepted(
    state: IntakeState,
    odometry: Odometry,
    sample: Sample,
    ticking: ClockState,
    outcome: Outcome,
    parameters: IntakeParameters,
) -> IntakeState:
    """The sample becomes the newest state, less what is not yet let through."""
    reset, found, variance = outcome.through, outcome.innovation, sample.position_variance_m2
    newest = EstimatedState(
        clock.loop_time_s(ticking, sample.stamp_us, parameters=parameters.clock),
        subtract(sample.position_ned_m, outcome.slide.excess_ned_m),
        subtract(sample.velocity_ned_m_s, outcome.slide.excess_ned_m_s),
        sample.attitude_wb,
        sample.rates_frd_rad_s,
        variance,
    )
    judged = (
        quality.restarted(variance)
        if found is None
        else quality.judged(state.quality, variance, found, parameters=parameters.quality)
    )
    shift = state.shift if reset is None else accumulated(state.shift, reset)
    return IntakeState(odometry, ticking, state.counts, sample, newest, outcome.slide, shift, judged)


def _refused(
    state: IntakeState,
    odometry: Odometry,
    reason: Refusal,
    ticking: ClockState | None,
    sliding: SlideState,
    now_s: float,
    parameters: IntakeParameters,
) -> tuple[IntakeState, Taken]:
    """The message is counted and forgotten; what was known stays, and ages."""
    counts = gate.counted(state.counts, reason, now_s, parameters=parameters.gate)
    state = IntakeState(odometry, ticking, counts, state.sample, state.newest, sliding, state.shift, state.quality)
    return state, Taken(refused=reason)
