"""The supervisor: a table of (state, conditions) -> state, pure; it decides whether a setpoint may leave at all.

The table is data: each row names the states it starts from, the conditions that must all hold (``!`` negates),
the state it leads to and the reason that people are told. The first row that fits is taken, one row a tick.
Take-off, landing and return are the autopilot's own modes; what the daemon flies itself are the states of ``OURS``.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from daemon.safety.conditions import Conditions


class State(Enum):
    """Who has the vehicle, and what it is doing."""

    DISCONNECTED = "disconnected"
    STANDBY = "standby"
    TAKING_OFF = "taking_off"
    READY = "ready"
    ENGAGING = "engaging"
    HOLDING = "holding"
    TRACKING = "tracking"
    RELEASING = "releasing"
    LANDING = "landing"
    PILOT = "pilot"
    FAULT = "fault"

    __hash__ = object.__hash__  # Enum's own hashes the name, in Python, at each of a tick's look-ups


_S = State
OURS = frozenset({_S.ENGAGING, _S.HOLDING, _S.TRACKING, _S.RELEASING})
FLYING = frozenset({_S.HOLDING, _S.TRACKING})
_CONNECTED = frozenset(State) - {_S.DISCONNECTED}
_WATCHING = frozenset({_S.STANDBY, _S.TAKING_OFF, _S.READY, _S.LANDING, _S.PILOT, _S.FAULT})
AUTOPILOT_FLIES = frozenset({_S.TAKING_OFF, _S.READY, _S.LANDING})


@dataclass(frozen=True, slots=True)
class Row:
    """From any of ``states``, when all of ``when`` hold, to ``to`` for ``reason``."""

    states: frozenset[State]
    when: tuple[str, ...]
    to: State
    reason: str


TABLE: tuple[Row, ...] = (
    # The dead-man and the link come first: nothing may be sent after a gap.
    Row(OURS, ("latched",), _S.FAULT, "control_stalled"),
    Row(_CONNECTED, ("!link",), _S.DISCONNECTED, "link_lost"),
    Row(_CONNECTED, ("rebooted",), _S.STANDBY, "autopilot_rebooted"),
    Row(frozenset({_S.DISCONNECTED}), ("link", "in_flight", "lost_while_ours"), _S.PILOT, "link_returned"),
    Row(frozenset({_S.DISCONNECTED}), ("link", "in_flight"), _S.PILOT, "found_flying"),
    Row(frozenset({_S.DISCONNECTED}), ("link",), _S.STANDBY, "connected"),
    # The vehicle is no longer ours, whatever we are doing: silent at once.
    Row(OURS, ("!armed",), _S.STANDBY, "disarmed"),
    Row(OURS, ("terminated",), _S.FAULT, "terminated"),
    Row(OURS, ("failsafe",), _S.FAULT, "autopilot_failsafe"),
    Row(FLYING, ("!offboard",), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.ENGAGING}), ("!offboard", "!hold"), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.RELEASING}), ("release_confirmed", "hold"), _S.READY, "released"),
    Row(frozenset({_S.RELEASING}), ("release_confirmed",), _S.LANDING, "released_to_land"),
    Row(frozenset({_S.RELEASING}), ("!offboard", "hold", "!hold_stale"), _S.READY, "released"),
    Row(frozenset({_S.RELEASING}), ("!offboard", "!hold"), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.RELEASING}), ("release_over",), _S.FAULT, "release_failed"),
    # Engaging is bounded, and ends where it came from; a request of that tick is not lost.
    Row(frozenset({_S.ENGAGING}), ("release_asked",), _S.RELEASING, "requested"),
    Row(frozenset({_S.ENGAGING}), ("offboard", "state_usable"), _S.HOLDING, "engaged"),
    Row(frozenset({_S.ENGAGING}), ("offboard", "!state_usable"), _S.RELEASING, "estimate_lost"),
    Row(frozenset({_S.ENGAGING}), ("engage_over",), _S.READY, "engage_refused"),
    Row(frozenset({_S.ENGAGING}), ("!state_usable",), _S.READY, "estimate_lost"),
    # What makes us give the vehicle back.
    Row(FLYING, ("release_asked",), _S.RELEASING, "requested"),
    Row(FLYING, ("estimate_lost",), _S.RELEASING, "estimate_lost"),
    Row(FLYING, ("estimate_poor",), _S.RELEASING, "estimate_poor"),
    Row(FLYING, ("truth_returned",), _S.RELEASING, "position_reset"),
    Row(FLYING, ("attitude_disagrees",), _S.RELEASING, "attitude_disagreement"),
    Row(FLYING, ("tilt_excess",), _S.RELEASING, "tilt_excess"),
    Row(FLYING, ("speed_excess",), _S.RELEASING, "speed_excess"),
    Row(FLYING, ("fence_breached",), _S.RELEASING, "geofence"),
    Row(FLYING, ("left_behind",), _S.RELEASING, "not_followed"),
    Row(FLYING, ("link_slow",), _S.RELEASING, "link_slow"),
    Row(FLYING, ("landed",), _S.RELEASING, "landed"),
    Row(FLYING, ("battery_low",), _S.RELEASING, "battery_low"),
    Row(frozenset({_S.HOLDING}), ("goal_active",), _S.TRACKING, "goal"),
    Row(frozenset({_S.TRACKING}), ("!goal_active",), _S.HOLDING, "no_goal"),
    # Requests while the autopilot flies or waits.
    Row(frozenset({_S.READY, _S.PILOT, _S.FAULT}), ("engage_asked", "engageable"), _S.ENGAGING, "requested"),
    Row(_WATCHING - {_S.READY}, ("hold_confirmed", "!failsafe"), _S.READY, "requested"),
    Row(frozenset({_S.READY}), ("landing_late",), _S.LANDING, "land_overtook_hold"),
    Row(frozenset({_S.READY}), ("landing_confirmed", "fence_drifts"), _S.LANDING, "geofence"),
    Row(_WATCHING - {_S.LANDING}, ("landing_confirmed", "!overruled"), _S.LANDING, "requested"),
    Row(_WATCHING - {_S.TAKING_OFF}, ("takeoff_confirmed",), _S.TAKING_OFF, "requested"),
    # What the autopilot does by itself.
    Row(AUTOPILOT_FLIES | {_S.PILOT, _S.FAULT}, ("!armed",), _S.STANDBY, "disarmed"),
    Row(frozenset({_S.TAKING_OFF, _S.READY, _S.PILOT}), ("failsafe", "in_flight"), _S.FAULT, "autopilot_failsafe"),
    Row(frozenset({_S.LANDING}), ("overruled", "in_flight"), _S.FAULT, "autopilot_failsafe"),
    Row(frozenset({_S.TAKING_OFF}), ("hold", "in_air"), _S.READY, "taken_off"),
    Row(frozenset({_S.TAKING_OFF}), ("!takeoff", "!hold"), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.READY}), ("!hold",), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.LANDING}), ("!landing", "!landed"), _S.PILOT, "pilot_override"),
    Row(frozenset({_S.STANDBY}), ("in_flight",), _S.PILOT, "pilot_takeoff"),
)


def _first_of(rows: Iterable[Row]) -> Callable[[Conditions], Row | None]:
    """Makes the function that gives the first of the rows that fits.

    It is compiled from source, as ``dataclass`` makes ``__init__``: in each tick nearly all rows of a state are tried
    and none fits, and a walk over them took six times as long.
    """
    names: dict[str, Any] = {}
    lines = ["def first(c):"]
    for i, row in enumerate(rows):
        names[f"row{i}"] = row
        lines.append(f"    if {' and '.join(_test(condition) for condition in row.when)}: return row{i}")
    exec("\n".join(lines), names)
    made: Callable[[Conditions], Row | None] = names["first"]
    return made


def _test(condition: str) -> str:
    return f"not c.{condition[1:]}" if condition.startswith("!") else f"c.{condition}"


_FIRST = {state: _first_of(row for row in TABLE if state in row.states) for state in State}


def next_row(state: State, conditions: Conditions) -> Row | None:
    """The first row of the table that fits, or None when the state stays."""
    return _FIRST[state](conditions)
