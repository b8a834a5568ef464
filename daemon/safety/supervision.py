"""Runs the supervisor's table each tick: requests, time limits, and the mode commands that follow; pure.

Engage: setpoints that match the vehicle for ``match_s``, then OFFBOARD is asked for, again after each refusal, until
``engage_s``; each time only once the autopilot has told its mode since then, and since the last tick that came more
than ``late_s`` after the one before: a pilot may have chosen another one meanwhile. Release: setpoints go on while
Hold (or Land, Return) is asked for, again every ``repeat_s`` for a message may be lost; refused or not confirmed after
``confirm_s`` it is Land; that too: level for ``level_s``, then silence, so that the autopilot's own failsafe starts
from level. While the autopilot is not heard nobody knows who has the vehicle: setpoints go on, but after ``confirm_s``
it is asked again only once its mode is told. Over a slow link a mode has ``shown_s`` and a round trip to show, where
that is longer than ``confirm_s``. A release from an engage starts in Hold, and what was asked of the autopilot within
``settle_s`` may still take effect: until then that Hold confirms nothing. An OFFBOARD that takes effect after the
vehicle is not ours any more is undone.
"""

from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf

from daemon.messages import AutopilotStatus, FlightMode, RequestKind, VehicleRequest
from daemon.safety import undo as undoing
from daemon.safety.conditions import PILOT_MODES, Bounds, Conditions, Facts, Memory, evaluate, in_flight
from daemon.safety.supervisor import AUTOPILOT_FLIES, FLYING, OURS, State, next_row
from daemon.safety.undo import NOTHING, UNDO_ASKS, Undo
from daemon.values import value

FENCE_ASKS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Time limits of engage and release, seconds."""

    match_s: float = 0.2
    late_s: float = 0.03
    engage_s: float = 2.0
    retry_s: float = 0.2
    settle_s: float = 0.2
    confirm_s: float = 0.3
    shown_s: float = 0.2
    repeat_s: float = 0.05
    level_s: float = 0.2
    request_s: float = 3.0
    undo_s: float = 1.0


class Drive(Enum):
    """What leaves this tick: nothing, the vehicle as it is, the control law, or levelling."""

    SILENT = "silent"
    MATCH = "match"
    LAW = "law"
    LEVEL = "level"


@value(eq=True)
class Supervision:
    """State of the supervisor. ``asked_mode`` is the mode that we asked the autopilot for and have not seen yet;

    ``left`` is the reason for which the vehicle was last given back, whatever came after it. From ``settled_s`` on a
    Hold is an answer to the release; at ``unheard_s`` the autopilot was last not heard in it. ``due_s``: since when
    OFFBOARD is to be asked for, inf: not now. ``undo``: what of ours may still come after we let go.
    """

    state: State = State.DISCONNECTED
    since_s: float = -inf
    reason: str = "start"
    serial: int = 0
    asked_mode: FlightMode | None = None
    asked_s: float = -inf
    asks: int = 0
    left: str = ""
    lost_while_ours: bool = False
    landing_asked: bool = False
    settled_s: float = -inf
    unheard_s: float = -inf
    due_s: float = inf
    undo: Undo = NOTHING
    memory: Memory = field(default_factory=Memory)


def step(
    supervision: Supervision,
    facts: Facts,
    request: VehicleRequest | None,
    now_s: float,
    *,
    bounds: Bounds,
    timing: Timing,
) -> tuple[Supervision, Conditions, tuple[FlightMode, ...]]:
    """One tick: the new supervision, the conditions it saw, and the modes to ask the autopilot for, in order."""
    facts = _in_order(supervision.state, facts)
    rebooted = supervision.memory.boot_count not in (None, facts.status.boot_count)
    fresh = request if request is not None and request.serial != supervision.serial else None
    confirm_s = max(timing.confirm_s, facts.round_trip_s + timing.shown_s)
    asked = _requests(supervision, facts.status, fresh, now_s, confirm_s, timing)
    memory, conditions = evaluate(supervision.memory, facts, now_s, bounds, rebooted=rebooted, **asked)
    if memory is not supervision.memory:
        supervision = replace(supervision, memory=memory)
    was_ours = supervision.state in OURS
    late = facts.tick_s > timing.late_s
    row = next_row(supervision.state, conditions)
    if row is not None:
        supervision, modes = _enter(supervision, row.to, row.reason, fresh, facts.status, late, now_s, timing)
    else:
        supervision, modes = _continue(supervision, facts.status, late, now_s, confirm_s, timing)
        if facts.status.heard and _drifts_on(supervision, conditions, bounds, now_s, timing):
            supervision, modes = _ask(replace(supervision, landing_asked=False), bounds.fence_beyond, now_s)
    if supervision.state not in OURS and _awaited(supervision, facts.status, now_s, timing) is None:
        undo, answer = undoing.step(supervision.undo, facts.status, now_s, undo_s=timing.undo_s, retry_s=timing.retry_s)
        if undo is not supervision.undo:
            supervision, modes = replace(supervision, undo=undo), modes + answer
    if fresh is not None:
        supervision = replace(supervision, serial=fresh.serial)
        if not was_ours:
            supervision, more = _ask_without_flying(supervision, fresh, facts.status, now_s)
            modes += more
    return supervision, conditions, modes


def _in_order(state: State, facts: Facts) -> Facts:
    """A mode that came and went between two ticks of an engage is seen before the OFFBOARD that came over it."""
    status = facts.status
    over = status.mode_before
    if state is not State.ENGAGING or status.mode is not FlightMode.OFFBOARD or over in (None, FlightMode.HOLD):
        return facts
    return replace(facts, status=replace(status, mode=over, intended_mode=over))


def drive(supervision: Supervision, conditions: Conditions) -> Drive:
    """What may leave in this state under these conditions."""
    if supervision.state not in OURS:
        return Drive.SILENT
    if supervision.state is State.ENGAGING:
        return Drive.MATCH
    if supervision.state is State.RELEASING and (conditions.release_levels or supervision.reason == "estimate_lost"):
        return Drive.LEVEL
    trusted = conditions.state_usable and not conditions.estimate_poor and not conditions.attitude_disagrees
    if trusted or (supervision.state in FLYING and conditions.state_usable):
        return Drive.LAW
    return Drive.LEVEL


def _requests(
    supervision: Supervision,
    status: AutopilotStatus,
    fresh: VehicleRequest | None,
    now_s: float,
    confirm_s: float,
    timing: Timing,
) -> dict[str, bool]:
    """The conditions about requests, by name."""
    kind = fresh.kind if fresh else None
    elapsed = now_s - supervision.since_s
    asked = _awaited(supervision, status, now_s, timing)
    confirmed = asked is not None and status.mode is asked
    flying = confirmed and in_flight(status)
    fallback = supervision.state is not State.RELEASING and supervision.landing_asked
    asking_s = 2.0 * confirm_s
    stale = supervision.state is State.RELEASING and status.mode is FlightMode.HOLD and now_s < supervision.settled_s
    return {
        "engage_asked": kind is RequestKind.ENGAGE,
        "release_asked": kind in (RequestKind.HOLD, RequestKind.LAND, RequestKind.RETURN),
        "hold_confirmed": flying and asked is FlightMode.HOLD,
        "landing_confirmed": flying and asked in (FlightMode.LAND, FlightMode.RETURN) and not fallback,
        "landing_late": flying and fallback and now_s - supervision.asked_s <= timing.undo_s,
        "takeoff_confirmed": confirmed and asked is FlightMode.TAKEOFF and status.armed,
        "release_confirmed": supervision.state is State.RELEASING and confirmed and not stale,
        "hold_stale": stale,
        "lost_while_ours": supervision.lost_while_ours,
        "engage_over": elapsed > timing.engage_s,
        "release_levels": elapsed > asking_s,
        "release_over": elapsed > asking_s + timing.level_s,
    }


def _refused(supervision: Supervision, status: AutopilotStatus) -> bool:
    """The autopilot refused the mode that it was asked for."""
    refusal = status.mode_refusal
    return refusal is not None and refusal.mode is supervision.asked_mode and refusal.time_s >= supervision.asked_s


def _awaited(supervision: Supervision, status: AutopilotStatus, now_s: float, timing: Timing) -> FlightMode | None:
    """The mode that we asked for and that may still come."""
    over = now_s - supervision.asked_s > timing.request_s or _refused(supervision, status)
    return None if over else supervision.asked_mode


_MODE_OF = {
    RequestKind.HOLD: FlightMode.HOLD,
    RequestKind.LAND: FlightMode.LAND,
    RequestKind.RETURN: FlightMode.RETURN,
    RequestKind.TAKEOFF: FlightMode.TAKEOFF,
}


def _ask_without_flying(
    supervision: Supervision, request: VehicleRequest, status: AutopilotStatus, now_s: float
) -> tuple[Supervision, tuple[FlightMode, ...]]:
    """A mode asked for while the vehicle is not ours. Take-off is commanded by whoever asks: it carries a height."""
    mode = _MODE_OF.get(request.kind)
    if mode is None or supervision.state in OURS or supervision.state is State.DISCONNECTED or not status.heard:
        return supervision, ()
    if in_flight(status) and status.mode in PILOT_MODES:
        return supervision, ()
    supervision = replace(supervision, asked_mode=mode, asked_s=now_s, landing_asked=False)
    return supervision, () if mode is FlightMode.TAKEOFF else (mode,)


def _enter(
    supervision: Supervision,
    state: State,
    reason: str,
    fresh: VehicleRequest | None,
    status: AutopilotStatus,
    late: bool,
    now_s: float,
    timing: Timing,
) -> tuple[Supervision, tuple[FlightMode, ...]]:
    """The tick in which a state begins; ``late``: we did not run for a while, so ``status`` may be of the past."""
    before = supervision
    was_ours = before.state in OURS
    if (before.state in FLYING or before.state is State.ENGAGING) and state not in FLYING:
        supervision = replace(supervision, left=reason)
    supervision = replace(supervision, state=state, since_s=now_s, reason=reason, asked_mode=None, asked_s=-inf, asks=0)
    supervision = replace(supervision, landing_asked=False, settled_s=-inf, unheard_s=-inf, due_s=inf)
    supervision = replace(supervision, undo=_left_to_undo(before, state, reason, status, now_s, timing))
    if state is State.RELEASING:
        mode = _MODE_OF[fresh.kind] if fresh is not None and fresh.kind in _MODE_OF else FlightMode.HOLD
        offboard_s = before.asked_s if before.asked_mode is FlightMode.OFFBOARD else -inf
        asked_s = offboard_s if mode is FlightMode.HOLD else now_s
        settled_s = asked_s + timing.settle_s if before.state is State.ENGAGING else -inf
        return replace(supervision, asked_mode=mode, asked_s=now_s, asks=1, settled_s=settled_s), (mode,)
    let_go = before.state is State.RELEASING and state is State.READY
    crossed = before.state in AUTOPILOT_FLIES and state is State.PILOT
    if (let_go or crossed) and before.asked_mode in (FlightMode.LAND, FlightMode.RETURN):
        # It may still take effect, over a pilot's mode too that it crossed on its way.
        supervision = replace(supervision, landing_asked=before.landing_asked)
        return replace(supervision, asked_mode=before.asked_mode, asked_s=before.asked_s), ()
    if reason == "land_overtook_hold":
        return _ask(supervision, FlightMode.HOLD, now_s)
    if state is State.READY and before.asked_mode is FlightMode.OFFBOARD and not late:
        # It may still take effect.
        return replace(supervision, asked_mode=FlightMode.HOLD, asked_s=now_s), (FlightMode.HOLD,)
    if state is State.DISCONNECTED:
        # Nothing is heard, but the autopilot may still hear us.
        lost = was_ours or before.undo.waits(now_s)
        return replace(supervision, lost_while_ours=lost), (FlightMode.HOLD,) if was_ours else ()
    if supervision.lost_while_ours:
        supervision = replace(supervision, lost_while_ours=False)
        if state is State.PILOT and status.mode is FlightMode.OFFBOARD:
            # The autopilot still waits for us; what it, or a pilot, does meanwhile stays as it is.
            return replace(supervision, asked_mode=FlightMode.HOLD, asked_s=now_s), (FlightMode.HOLD,)
    return supervision, ()


def _left_to_undo(
    before: Supervision, state: State, reason: str, status: AutopilotStatus, now_s: float, timing: Timing
) -> Undo:
    """What may still come of ours in the new state."""
    if state in OURS or state in (State.STANDBY, State.DISCONNECTED):
        return NOTHING
    if before.lost_while_ours and status.mode is not FlightMode.OFFBOARD:
        return undoing.over(status.mode, now_s)
    if reason == "control_stalled":
        # We fly no more: the autopilot that still waits for us gets Hold as soon as it is heard.
        return undoing.over(status.mode, now_s + timing.undo_s)
    if before.state in OURS:
        return undoing.let_go(status, now_s, undo_s=timing.undo_s)
    return before.undo


def _continue(
    supervision: Supervision, status: AutopilotStatus, late: bool, now_s: float, confirm_s: float, timing: Timing
) -> tuple[Supervision, tuple[FlightMode, ...]]:
    refused = _refused(supervision, status)
    if supervision.state is State.ENGAGING:
        return _take(supervision, status, refused, late, now_s, timing)
    overtaken = supervision.reason == "land_overtook_hold" and supervision.asked_mode is FlightMode.HOLD
    due = status.heard and not refused and now_s - supervision.asked_s >= timing.retry_s
    if overtaken and due and supervision.asks < UNDO_ASKS:
        return _ask(supervision, FlightMode.HOLD, now_s)
    if supervision.state is State.RELEASING:
        return _hand_over(supervision, refused, status.heard, now_s, confirm_s, timing.repeat_s)
    return supervision, ()


def _take(
    supervision: Supervision, status: AutopilotStatus, refused: bool, late: bool, now_s: float, timing: Timing
) -> tuple[Supervision, tuple[FlightMode, ...]]:
    """A tick of an engage; ``late``: we did not run for a while."""
    due = supervision.asks == 0 or (refused and now_s - supervision.asked_s >= timing.retry_s)
    if now_s - supervision.since_s < timing.match_s or not due:
        return supervision, ()
    if late or supervision.due_s == inf:
        return replace(supervision, due_s=now_s), ()
    if status.told_s < supervision.due_s:
        return supervision, ()
    return _ask(replace(supervision, due_s=inf), FlightMode.OFFBOARD, now_s)


def _hand_over(
    supervision: Supervision, refused: bool, heard: bool, now_s: float, confirm_s: float, repeat_s: float
) -> tuple[Supervision, tuple[FlightMode, ...]]:
    """A tick of a release: who is asked for what; not to be heard is no answer, so there is no Land for it."""
    if not heard:
        supervision = replace(supervision, unheard_s=now_s)
        if now_s - supervision.since_s > confirm_s:
            return supervision, ()
    waited_s = now_s - max(supervision.since_s, supervision.unheard_s)
    if not supervision.landing_asked and (refused or waited_s > confirm_s):
        return _ask(replace(supervision, landing_asked=True), FlightMode.LAND, now_s)
    if supervision.asked_mode is not None and not refused and now_s - supervision.asked_s >= repeat_s:
        return _ask(supervision, supervision.asked_mode, now_s)
    return supervision, ()


def _drifts_on(supervision: Supervision, conditions: Conditions, bounds: Bounds, now_s: float, timing: Timing) -> bool:
    """In the Hold that it was given at the hard fence the vehicle goes on outwards."""
    return (
        supervision.state is State.READY
        and (supervision.reason, supervision.left) == ("released", "geofence")
        and conditions.fence_drifts
        and bounds.fence_beyond is not FlightMode.HOLD
        and supervision.asks < FENCE_ASKS
        and now_s - supervision.asked_s >= timing.request_s
    )


def _ask(supervision: Supervision, mode: FlightMode, now_s: float) -> tuple[Supervision, tuple[FlightMode, ...]]:
    return replace(supervision, asked_mode=mode, asked_s=now_s, asks=supervision.asks + 1), (mode,)
