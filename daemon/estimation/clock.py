"""The autopilot's clock in seconds of ours: lower envelope of arrival minus stamp.

The sample that was quickest on its way defines the offset; all others are late by their excess over it, their lag.
The envelope falls to a quicker sample at once and rises by the estimated drift and a little more, so that it follows a
clock that runs slow (a simulated autopilot: 1-2 %). A lag that appears from one sample to the next and then stays is a
step of the clock (a simulation that stood still, a reboot); a lag that comes gradually or drains is the link. So is one
that comes at once with stamps in order while TIMESYNC holds to its clock: the samples are as old as that.

The envelope does not see what even the quickest sample took. TIMESYNC does, and is followed where it is there and fits
to the stamps; the change between the two is spread over time, for a jump of the clock would be one of the vehicle.
"""

from dataclasses import dataclass, replace
from enum import Enum

from daemon.frames import clamp
from daemon.messages import ClockSync
from daemon.values import value


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockParameters:
    """How the clocks are compared.

    ``telemetry_latency_s``: age of the quickest sample, which no envelope sees; it counts while TIMESYNC says nothing.
    By TIMESYNC the quickest ODOMETRY of PX4 over UDP is 0.5 ms old; a serial line, other loads and the simulated PX4,
    whose samples are 12 ms old, make it more: 8 ms is between them.
    ``drift_margin``: rise of the envelope beyond the drift, in seconds a second; ``drift_max`` bounds the drift,
    and is the rise until a first drift is known.
    ``drift_window_s``: the drift is the slope between the lowest offsets of such windows, averaged over the last
    ``drift_windows``.
    ``step_s``: a lag that comes at once and is larger may be a step; it is one after ``step_samples`` samples within
    ``agreement_s`` of the first (a burst drains faster: 8 ms a sample). Stamps that go back, or are early by more than
    ``ahead_s``, wait for that too.
    ``sync_uncertainty_max_s``, ``sync_age_max_s``: a less certain or older TIMESYNC is not followed; neither is one
    that puts a sample more than ``sync_margin_s`` beyond its arrival, or the quickest one's way beyond
    ``sync_way_max_s``. Half of a slow link's way there and back is a better guess of a sample's than none.
    ``slew``: rate of the change from one clock to the other, in seconds a second.
    """

    telemetry_latency_s: float = 0.008
    drift_margin: float = 0.005
    drift_max: float = 0.03
    drift_window_s: float = 1.0
    drift_windows: int = 4
    step_s: float = 0.02
    step_samples: int = 3
    agreement_s: float = 0.01
    ahead_s: float = 0.3
    sync_uncertainty_max_s: float = 0.1
    sync_age_max_s: float = 1.0
    sync_margin_s: float = 0.005
    sync_way_max_s: float = 0.6
    slew: float = 0.02


class Verdict(Enum):
    """What the clock says of a stamp."""

    GOOD = "good"
    BACKWARDS = "backwards"
    REPEATED = "repeated"
    AHEAD = "ahead"
    STEPPED = "stepped"
    SET_BACK = "set_back"


@value
class ClockState:
    """``offset_s``: loop time minus autopilot time at ``stamp_us``; the rest is the memory of drift and step.

    ``window_*``: where the running window began, its lowest offset, that of the window before it; ``slopes`` counts
    what the drift has been averaged over. ``lag_s``: of the newest sample. ``candidate_s``: the offset that began a
    run of ``candidate_count`` samples off the envelope. ``correction_s``: what the clock that is used has more than the
    envelope less the latency.
    """

    stamp_us: int
    offset_s: float
    drift: float
    window_stamp_us: int
    window_low_s: float
    window_before_s: float | None
    slopes: int
    lag_s: float
    candidate_s: float
    candidate_count: int
    correction_s: float = 0.0


def started(stamp_us: int, offset_s: float, drift: float, slopes: int) -> ClockState:
    """A clock that knows one sample, and the drift of before."""
    return ClockState(stamp_us, offset_s, drift, stamp_us, offset_s, None, slopes, 0.0, 0.0, 0)


def observe(
    state: ClockState | None,
    stamp_us: int,
    arrival_s: float,
    *,
    parameters: ClockParameters,
    sync: ClockSync | None = None,
) -> tuple[ClockState, Verdict]:
    """The clock after a message stamped ``stamp_us`` came at ``arrival_s``, and what to think of the stamp.

    STEPPED and SET_BACK: the stamp is good by a clock that has just been set anew, by a reboot perhaps.
    ``sync``: the newest of TIMESYNC.
    """
    vouched = state is not None and sync is not None and _fits(state, sync, parameters)
    after, verdict = _enveloped(state, stamp_us, arrival_s, vouched, parameters)
    if state is None:
        correction = _start(after, sync, parameters)
    elif verdict is Verdict.GOOD or (after.offset_s < state.offset_s and sync and _fits(after, sync, parameters)):
        correction = _moved(state, after, sync, parameters)
    else:  # a clock that was set anew keeps it: what TIMESYNC said may still be of the clock before
        correction = state.correction_s
    correction = min(correction, after.lag_s + parameters.telemetry_latency_s)  # nothing is true after it arrived
    return (after if correction == after.correction_s else _corrected(after, correction)), verdict


def _corrected(state: ClockState, correction_s: float) -> ClockState:
    """The clock with another correction."""
    return ClockState(
        state.stamp_us,
        state.offset_s,
        state.drift,
        state.window_stamp_us,
        state.window_low_s,
        state.window_before_s,
        state.slopes,
        state.lag_s,
        state.candidate_s,
        state.candidate_count,
        correction_s,
    )


def _enveloped(
    state: ClockState | None, stamp_us: int, arrival_s: float, vouched: bool, parameters: ClockParameters
) -> tuple[ClockState, Verdict]:
    """The envelope. Once it is known, a sample far below it is a step too: forwards, or a delay that ended.

    ``vouched``: TIMESYNC tells the clock; a lag that comes at once with a stamp in order is the link's while it does.
    """
    observed = arrival_s - stamp_us * 1e-6
    if state is None:
        return started(stamp_us, observed, 0.0, 0), Verdict.GOOD
    if stamp_us == state.stamp_us:
        return state, Verdict.REPEATED
    dt = (stamp_us - state.stamp_us) * 1e-6
    rise = state.drift + parameters.drift_margin if state.slopes else parameters.drift_max
    offset = state.offset_s + rise * max(0.0, dt)
    lag = observed - offset
    orderly = dt > 0.0 and lag >= -parameters.ahead_s
    onset = lag - state.lag_s > 0.75 * parameters.step_s and lag > parameters.step_s
    if not orderly or state.candidate_count > 0 or onset:
        linked = vouched and orderly and lag > 0.0
        state, verdict = _candidate(state, stamp_us, observed, lag, linked, parameters)
        if verdict is not Verdict.GOOD or not orderly:
            return state, verdict
    if lag < -parameters.step_s and state.slopes:
        return started(stamp_us, observed, state.drift, state.slopes), Verdict.STEPPED
    return _followed(state, stamp_us, observed, min(offset, observed), parameters), Verdict.GOOD


def _candidate(
    state: ClockState, stamp_us: int, observed: float, lag: float, linked: bool, parameters: ClockParameters
) -> tuple[ClockState, Verdict]:
    """Count the samples that agree on another offset; enough of them set the clock, unless it is the link's lag."""
    apart = abs(lag) > parameters.step_s
    agrees = state.candidate_count > 0 and abs(observed - state.candidate_s) <= parameters.agreement_s
    count = state.candidate_count + 1 if agrees else 1
    first = state.candidate_s if agrees else observed
    if not apart:
        count = 0
    if count >= parameters.step_samples and not linked:
        verdict = Verdict.SET_BACK if stamp_us < state.stamp_us and lag > parameters.ahead_s else Verdict.STEPPED
        return started(stamp_us, min(first, observed), state.drift, state.slopes), verdict
    waiting = replace(state, candidate_s=first, candidate_count=count)
    if stamp_us < state.stamp_us:
        return waiting, Verdict.BACKWARDS
    return waiting, Verdict.AHEAD if lag < -parameters.ahead_s else Verdict.GOOD


def _followed(
    state: ClockState, stamp_us: int, observed: float, offset: float, parameters: ClockParameters
) -> ClockState:
    """The envelope after a good sample, with the drift brought up to date when a window is full."""
    drift, slopes = state.drift, state.slopes
    start, low, before = state.window_stamp_us, min(state.window_low_s, observed), state.window_before_s
    span = (stamp_us - start) * 1e-6
    if span >= parameters.drift_window_s:
        if before is not None:
            slope = max(-parameters.drift_max, min(parameters.drift_max, (low - before) / span))
            slopes = min(slopes + 1, parameters.drift_windows)
            drift += (slope - drift) / slopes
        start, low, before = stamp_us, observed, low
    lag = observed - offset
    return ClockState(
        stamp_us, offset, drift, start, low, before, slopes, lag, state.candidate_s, state.candidate_count
    )


def _start(state: ClockState, sync: ClockSync | None, parameters: ClockParameters) -> float:
    """The correction of a first sample."""
    if sync is None or not _fits(state, sync, parameters):
        return 0.0
    return sync.offset_at(state.stamp_us) - state.offset_s + parameters.telemetry_latency_s


def _moved(before: ClockState, after: ClockState, sync: ClockSync | None, parameters: ClockParameters) -> float:
    """The correction a sample later: towards TIMESYNC, whatever the envelope does, or back to the envelope."""
    dt = (after.stamp_us - before.stamp_us) * 1e-6
    step = parameters.slew * min(dt, 0.5)
    if sync is None or not _fits(after, sync, parameters):
        return before.correction_s - clamp(before.correction_s, -step, step)
    carried = before.offset_s + before.correction_s + sync.drift * dt - after.offset_s
    wanted = sync.offset_at(after.stamp_us) - after.offset_s + parameters.telemetry_latency_s
    return carried + clamp(wanted - carried, -step, step)


def _fits(state: ClockState, sync: ClockSync, parameters: ClockParameters) -> bool:
    """True for what TIMESYNC can say of the newest sample."""
    way = state.offset_s - sync.offset_at(state.stamp_us)
    return (
        sync.uncertainty_s <= parameters.sync_uncertainty_max_s
        and abs(state.stamp_us - sync.stamp_us) * 1e-6 <= parameters.sync_age_max_s
        and -parameters.sync_margin_s - state.lag_s <= way <= parameters.sync_way_max_s
    )


def loop_time_s(state: ClockState, stamp_us: int, *, parameters: ClockParameters) -> float:
    """The loop-clock time at which what ``stamp_us`` stamps was true, seconds."""
    return stamp_us * 1e-6 + state.offset_s - parameters.telemetry_latency_s + state.correction_s
