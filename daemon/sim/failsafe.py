"""Which mode PX4 flies when the intended one will not do: PX4's failsafe framework as a pure decision.

After ``src/modules/commander``: ``ModeUtil/mode_requirements.cpp`` (what a mode needs), ``Failsafe::checkStateAndMode``
and ``checkModeFallback`` (who asks for what), ``FailsafeBase::getSelectedAction`` (the worst wins, and falls through
Position, Altitude, Stabilized, Hold, Return, Land to Descend, which needs nothing but an attitude). LAND stands for
Descend, as on the wire. PX4 tells a strict and a relaxed validity of the position; both end with EKF2_NOAID_TOUT, 5 s
after the last aiding, so one flag serves here.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

from daemon.messages import FlightMode
from daemon.sim.modes import MANUAL_MODES, NEEDS_POSITION


class BatteryWarning(IntEnum):
    """PX4's battery_status.warning."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


class Cause(IntEnum):
    """Who asks for a failsafe, as PX4's events number it; GENERIC: the mode itself cannot run."""

    GENERIC = 0
    MANUAL_CONTROL = 1
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """What the decision depends on."""

    offboard_signal: bool = False
    position: bool = True
    manual_control: bool = False
    manual_control_lost: bool = False
    battery: BatteryWarning = BatteryWarning.NONE


@dataclass(frozen=True, slots=True)
class Action:
    """``mode`` None: the intended mode goes on, whatever the cause.

    ``delayed``: PX4 first holds for COM_FAIL_ACT_T. ``descend``: the mode is shown, and Descend flown.
    """

    mode: FlightMode | None = None
    cause: Cause = Cause.GENERIC
    delayed: bool = False
    descend: bool = False


_OFFBOARD_LOSS = {
    0: FlightMode.POSITION,
    1: FlightMode.ALTITUDE,
    2: FlightMode.STABILIZED,
    3: FlightMode.RETURN,
    4: FlightMode.LAND,
    5: FlightMode.HOLD,
}
_MANUAL_LOSS = {1: FlightMode.HOLD, 2: FlightMode.RETURN, 3: FlightMode.LAND}
_CRITICAL_BATTERY = {1: FlightMode.RETURN, 2: FlightMode.LAND, 3: FlightMode.RETURN}
_EMPTY_BATTERY = {1: FlightMode.RETURN, 2: FlightMode.LAND, 3: FlightMode.LAND}
_BY_SEVERITY = (
    FlightMode.POSITION,
    FlightMode.ALTITUDE,
    FlightMode.STABILIZED,
    FlightMode.HOLD,
    FlightMode.RETURN,
    FlightMode.LAND,
)
_STICKS_NEEDED = frozenset((FlightMode.POSITION, FlightMode.ALTITUDE))


def can_run(mode: FlightMode, health: Health) -> bool:
    """Whether a user may switch to the mode; the failsafes do not ask for a pilot, see ``sustains``."""
    return sustains(mode, health) and (mode not in MANUAL_MODES or health.manual_control)


def sustains(mode: FlightMode, health: Health) -> bool:
    """PX4's ``modeCanRun``: whether the estimate and the setpoints suffice for the mode."""
    if mode is FlightMode.OFFBOARD:
        return health.offboard_signal
    return health.position or mode not in NEEDS_POSITION


def decide(intended: FlightMode, health: Health, *, offboard_loss: int, manual_loss: int, low_battery: int) -> Action:
    """The action now; parameters are COM_OBL_RC_ACT, NAV_RCL_ACT and COM_LOW_BAT_ACT."""
    asked: list[tuple[FlightMode | None, Cause]] = [
        _battery_action(health.battery, low_battery),
        (_MANUAL_LOSS.get(manual_loss) if health.manual_control_lost else None, Cause.MANUAL_CONTROL),
        (_mode_fallback(intended, health, offboard_loss, manual_loss), Cause.GENERIC),
    ]
    wanted, cause = max(asked, key=lambda entry: _severity(entry[0]))
    if wanted is None:
        return Action()
    action = _available(wanted, health, cause)
    is_bringing_down = intended in (FlightMode.LAND, FlightMode.RETURN) and sustains(intended, health)
    if action.mode is FlightMode.RETURN and is_bringing_down:  # only a warning then
        return Action(cause=cause)
    return action


def without_causes(health: Health) -> Health:
    """The health as it counts after a user has taken over from a failsafe: only what the mode itself needs."""
    return replace(health, battery=BatteryWarning.NONE, manual_control_lost=False)


def _severity(mode: FlightMode | None) -> int:
    return -1 if mode is None else _BY_SEVERITY.index(mode)


def _battery_action(warning: BatteryWarning, parameter: int) -> tuple[FlightMode | None, Cause]:
    if warning is BatteryWarning.EMERGENCY:
        return _EMPTY_BATTERY.get(parameter), Cause.BATTERY_EMERGENCY
    if warning is BatteryWarning.CRITICAL:
        return _CRITICAL_BATTERY.get(parameter), Cause.BATTERY_CRITICAL
    return None, Cause.GENERIC


def _mode_fallback(intended: FlightMode, health: Health, offboard_loss: int, manual_loss: int) -> FlightMode | None:
    """What replaces an intended mode that cannot run. Without setpoints and without sticks NAV_RCL_ACT decides."""
    wanted: FlightMode | None = None
    mode = intended
    if intended is FlightMode.OFFBOARD and not health.offboard_signal:
        wanted = mode = _OFFBOARD_LOSS.get(offboard_loss, FlightMode.POSITION)
        if wanted in MANUAL_MODES and not health.manual_control:
            wanted = _MANUAL_LOSS.get(manual_loss)
    if mode in (FlightMode.POSITION, FlightMode.POSITION_SLOW) and not sustains(mode, health):
        wanted = mode = FlightMode.ALTITUDE
    return wanted if sustains(mode, health) else FlightMode.RETURN


def _available(mode: FlightMode, health: Health, cause: Cause) -> Action:
    """The mode, or the next one that can run. Position and Altitude without sticks descend (FlightModeManager)."""
    candidates = _BY_SEVERITY[_BY_SEVERITY.index(mode) :]
    flown = next((candidate for candidate in candidates if sustains(candidate, health)), None)
    if flown is None:
        return Action(FlightMode.LAND, cause, descend=True)
    delayed = cause is not Cause.GENERIC and flown is not FlightMode.HOLD and sustains(FlightMode.HOLD, health)
    return Action(flown, cause, delayed, descend=flown in _STICKS_NEEDED and not health.manual_control)
