"""Which mode PX4 flies when the intended one will not do: PX4's failsafe framework as a pure decision.

Order and fall-through from PX4 1.17 (``src/modules/commander/failsafe``: ``framework.cpp``, ``failsafe.cpp``) and,
where recorded, from recordings. A mode falls through Position, Altitude, Stabilized (with a pilot), Return, Land
(with a position) to Descend, which needs nothing but an attitude; LAND stands for Descend on the wire.
"""

from dataclasses import dataclass
from enum import IntEnum

from daemon.messages import FlightMode
from daemon.sim.modes import MANUAL_MODES, NEEDS_POSITION


class BatteryWarning(IntEnum):
    """PX4's battery_status.warning."""

    NONE = 0
    LOW = 1
    CRITICAL = 2
    EMERGENCY = 3


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
    """``mode`` None: the intended mode goes on.

    ``delayed``: PX4 first holds for COM_FAIL_ACT_T. ``descend``: Land without a position.
    """

    mode: FlightMode | None = None
    cause: str = ""
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
_FALL_THROUGH = (
    FlightMode.POSITION,
    FlightMode.ALTITUDE,
    FlightMode.STABILIZED,
    FlightMode.HOLD,
    FlightMode.RETURN,
    FlightMode.LAND,
)


def can_run(mode: FlightMode, health: Health) -> bool:
    """Whether PX4's mode requirements are met (``mode_requirements.cpp``)."""
    if mode is FlightMode.OFFBOARD:
        return health.offboard_signal
    if mode in MANUAL_MODES and not health.manual_control:
        return False
    return health.position or mode not in NEEDS_POSITION


def decide(intended: FlightMode, health: Health, *, offboard_loss: int, manual_loss: int, low_battery: int) -> Action:
    """The action now; parameters are COM_OBL_RC_ACT, NAV_RCL_ACT and COM_LOW_BAT_ACT."""
    if low_battery >= 2 and health.battery is BatteryWarning.EMERGENCY:
        return _available(FlightMode.LAND, health, "battery_emergency", delayed=True)
    if low_battery in (1, 3) and health.battery is BatteryWarning.CRITICAL:
        return _available(FlightMode.RETURN, health, "battery_critical", delayed=True)
    if low_battery == 2 and health.battery is BatteryWarning.CRITICAL:
        return _available(FlightMode.LAND, health, "battery_critical", delayed=True)
    if health.manual_control_lost and manual_loss in _MANUAL_LOSS:
        return _available(_MANUAL_LOSS[manual_loss], health, "manual_control", delayed=True)
    if can_run(intended, health):
        return Action()
    if intended is FlightMode.OFFBOARD:
        return _available(_OFFBOARD_LOSS.get(offboard_loss, FlightMode.POSITION), health, "offboard")
    return _available(intended if intended in MANUAL_MODES else FlightMode.RETURN, health, "mode")


def _available(mode: FlightMode, health: Health, cause: str, *, delayed: bool = False) -> Action:
    """The mode, or the next one that can run; Hold is never a substitute."""
    if can_run(mode, health):
        return Action(mode, cause, delayed)
    start = _FALL_THROUGH.index(mode) + 1 if mode in _FALL_THROUGH else 0
    for candidate in _FALL_THROUGH[start:]:
        if candidate is not FlightMode.HOLD and can_run(candidate, health):
            return Action(candidate, cause, delayed)
    return Action(FlightMode.LAND, cause, delayed and health.position, descend=True)
