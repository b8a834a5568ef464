"""What PX4 says in words: results of commands, and EVENT messages by their ids.

The ids are hashes of the events' names (PX4 events interface); the table holds those seen in recordings of PX4 1.17
that tell an operator something, with PX4's texts.
"""

from dataclasses import dataclass
from typing import Any

from daemon.autopilot.px4 import mode_from_custom
from daemon.messages import FlightMode

RESULT_ACCEPTED = 0
RESULT_IN_PROGRESS = 5

_RESULTS = {
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    6: "cancelled",
    7: "only accepted as COMMAND_LONG",
    8: "only accepted as COMMAND_INT",
    9: "unsupported frame",
}


def result_text(result: int) -> str:
    """MAV_RESULT in words."""
    return _RESULTS.get(result, f"refused with result {result}")


FAILSAFE_ENTER = 26528394
FAILSAFE_ENTER_HOLD = 30481910
FAILSAFE_ENTER_GENERIC = 31382480
MODE_NOT_AVAILABLE = 27280279
_FAILSAFES = frozenset((FAILSAFE_ENTER, FAILSAFE_ENTER_HOLD, FAILSAFE_ENTER_GENERIC))

_CHECKS_BEGIN = 27825120

# Said when a command is refused.
_REFUSALS = {
    16910493: "arming denied: resolve system health failures first",
    19545959: "unsupported main mode",
    MODE_NOT_AVAILABLE: "switching to this mode is currently not possible",
}
# Standing failures, reported anew whenever one changes; the first argument is a bit mask of PX4's navigation states.
_CHECKS = {
    17231145: "no manual control input",
    18648929: "mode not suitable for arming",
    19865031: "no offboard signal",
    23035260: "estimator fault due to compass",
    26788467: "no valid global position estimate",
    30612409: "no valid position estimate",
    33420013: "heading estimate not stable",
}
_NAVIGATION_STATE = {
    FlightMode.MANUAL: 0,
    FlightMode.ALTITUDE: 1,
    FlightMode.POSITION: 2,
    FlightMode.MISSION: 3,
    FlightMode.HOLD: 4,
    FlightMode.RETURN: 5,
    FlightMode.POSITION_SLOW: 6,
    FlightMode.ALTITUDE_CRUISE: 8,
    FlightMode.ACRO: 10,
    FlightMode.OFFBOARD: 14,
    FlightMode.STABILIZED: 15,
    FlightMode.TAKEOFF: 17,
    FlightMode.LAND: 18,
    FlightMode.FOLLOW: 19,
    FlightMode.PRECISION_LAND: 20,
    FlightMode.ORBIT: 21,
    FlightMode.VTOL_TAKEOFF: 22,
}
_DISARMED = 32794487
_NOTICES = {
    16962474: "return: land at destination",
    17738815: "pilot took over using sticks",
    19404811: "critical battery",
    20099806: "landing at current position",
    20380425: "stopping compass use",
    21054825: "take-off detected",
    21826980: "low battery",
    22161044: "return: start",
    22400324: "manual control lost",
    22624381: "dangerously low battery, shutdown failed",
    26266355: "armed",
    26622124: "landing detected",
    28121863: "emergency battery level",
    28993875: "low battery level, return advised",
    31476391: "GNSS data fusion stopped",
    32069699: "GNSS data fusion started",
    _DISARMED: "disarmed",
    FAILSAFE_ENTER: "failsafe activated",
    FAILSAFE_ENTER_HOLD: "failsafe activated, first holding",
    FAILSAFE_ENTER_GENERIC: "failsafe activated",
}

# PX4 failsafe actions that change the mode (failsafe framework, Action).
_MODE_BY_ACTION = {
    2: FlightMode.POSITION,
    3: FlightMode.ALTITUDE,
    4: FlightMode.STABILIZED,
    5: FlightMode.HOLD,
    6: FlightMode.RETURN,
    7: FlightMode.LAND,
    8: FlightMode.LAND,
}


@dataclass(frozen=True, slots=True)
class Event:
    """One EVENT: its text when we know it, and the modes that a failsafe announces.

    ``refusal``: the text explains a refusal. ``check_states``: a standing failure, and the navigation states (bits)
    that it forbids. ``checks_begin``: the list of standing failures follows from the start.
    """

    text: str | None
    refusal: bool = False
    check_states: int = 0
    checks_begin: bool = False
    mode: FlightMode | None = None
    intended_mode: FlightMode | None = None
    disarmed: bool = False


def decode(fields: dict[str, Any]) -> Event:
    """An EVENT message; ``arguments`` as the 40 bytes or as their hexadecimal text."""
    event_id = int(fields["id"])
    if event_id in _REFUSALS:
        return Event(_REFUSALS[event_id], refusal=True)
    if event_id not in _CHECKS and event_id not in _FAILSAFES:
        return Event(_NOTICES.get(event_id), checks_begin=event_id == _CHECKS_BEGIN, disarmed=event_id == _DISARMED)
    raw = fields["arguments"]
    arguments = (bytes.fromhex(raw) if isinstance(raw, str) else bytes(raw)).ljust(5, b"\0")
    # First argument, uint32 little-endian: the states forbidden, or the intended custom_mode; then, uint8, the action.
    word, action = int.from_bytes(arguments[:4], "little"), arguments[4]
    if event_id in _CHECKS:
        return Event(_CHECKS[event_id], check_states=word)
    mode = FlightMode.HOLD if event_id == FAILSAFE_ENTER_HOLD else _MODE_BY_ACTION.get(action)
    return Event(_NOTICES[event_id], mode=mode, intended_mode=mode_from_custom(word))


class Reasons:
    """Remembers what explains a refusal: the texts of the last moment and the checks that stand."""

    MEMORY_S = 0.2

    def __init__(self) -> None:
        self._recent: list[tuple[float, str]] = []
        self._checks: dict[str, int] = {}

    def note(self, event: Event, now_s: float) -> None:
        """Take an event in."""
        if event.checks_begin:
            self._checks.clear()
        if event.text is None:
            return
        if event.refusal:
            self._recent = [old for old in self._recent if now_s - old[0] <= self.MEMORY_S] + [(now_s, event.text)]
        elif event.check_states:
            self._checks[event.text] = event.check_states

    def why(self, result: int, mode: FlightMode, now_s: float) -> str:
        """The reason in words of a refusal with this MAV_RESULT that concerns this mode."""
        state = _NAVIGATION_STATE.get(mode)
        recent = [text for time_s, text in self._recent if now_s - time_s <= self.MEMORY_S]
        standing = [text for text, states in self._checks.items() if state is not None and states >> state & 1]
        return "; ".join(dict.fromkeys([result_text(result), *recent, *standing]))
