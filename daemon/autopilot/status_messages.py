"""The messages of which each says one thing of the autopilot: the status after it; pure.

KeyError, TypeError or ValueError for a malformed message.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from daemon.autopilot import decode
from daemon.autopilot.px4 import MAV_AUTOPILOT_PX4, Fields, airframe, is_armed, mode_from_custom
from daemon.messages import AutopilotStatus, BatteryCharge, FlightMode, LandedState, SystemStatus

After = Callable[[AutopilotStatus, Fields, float], AutopilotStatus]


def _heartbeat(status: AutopilotStatus, fields: Fields, now_s: float) -> AutopilotStatus:
    if int(fields["autopilot"]) != MAV_AUTOPILOT_PX4:
        return status
    mode = mode_from_custom(int(fields["custom_mode"]))
    system_status = SystemStatus(int(fields["system_status"]))
    # A new mode shows here before CURRENT_MODE does: without a failsafe it is also the intended one.
    follows = system_status < SystemStatus.CRITICAL and (mode is not status.mode or not status.connected)
    return replace(
        status,
        connected=True,
        heartbeat_s=now_s,
        mode=mode,
        heard=True,
        intended_mode=mode if follows else status.intended_mode,
        armed=is_armed(int(fields["base_mode"])),
        system_status=system_status,
        airframe=airframe(int(fields["type"])),
    )


def _current_mode(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    mode = mode_from_custom(int(fields["custom_mode"]))
    intended = mode_from_custom(int(fields["intended_custom_mode"]))
    intended = mode if intended is FlightMode.UNKNOWN else intended
    return replace(status, mode=mode, heard=True, intended_mode=intended)


def _extended_sys_state(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    return replace(status, landed=LandedState(int(fields["landed_state"])))


def _sys_status(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    return replace(status, battery_fraction=decode.battery_fraction(fields))


def _battery_status(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    """Each battery has its message: the worst one's counts, until it is better or another one is worse."""
    charge, battery_id = BatteryCharge(int(fields["charge_state"])), int(fields["id"])
    if battery_id != status.battery_id and charge <= status.battery_charge:
        return status
    return replace(status, battery_charge=charge, battery_id=battery_id)


def _global_position(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    return replace(status, global_position=decode.global_position(fields, "lat", "lon", "alt"))


def _home_position(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    home = decode.global_position(fields, "latitude", "longitude", "altitude")
    return replace(status, home=home, home_ned_m=decode.home_ned(fields))


def _global_origin(status: AutopilotStatus, fields: Fields, _now_s: float) -> AutopilotStatus:
    return replace(status, global_origin=decode.global_position(fields, "latitude", "longitude", "altitude"))


MODE_AFTER: Mapping[str, After] = {"HEARTBEAT": _heartbeat, "CURRENT_MODE": _current_mode}
AFTER: Mapping[str, After] = {
    "EXTENDED_SYS_STATE": _extended_sys_state,
    "SYS_STATUS": _sys_status,
    "BATTERY_STATUS": _battery_status,
    "GLOBAL_POSITION_INT": _global_position,
    "HOME_POSITION": _home_position,
    "GPS_GLOBAL_ORIGIN": _global_origin,
}
