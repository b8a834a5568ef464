"""PX4's vocabulary: its modes as ``custom_mode`` words, and the messages that we send it, as MAVLink field dicts.

Field names are those of the MAVLink definition. Angles and rates in raw messages are radians. A NaN parameter of a
command means "not given" (MAVLink command protocol).
"""

from math import isfinite, nan
from typing import Any

from daemon.autopilot.port import Command, CommandKind
from daemon.messages import FlightMode, Setpoint

Fields = dict[str, Any]
Message = tuple[str, Fields]

MAV_AUTOPILOT_PX4 = 12

CMD_TAKEOFF = 22
CMD_SET_MODE = 176
CMD_ARM = 400
CMD_SET_MESSAGE_INTERVAL = 511
CMD_REQUEST_MESSAGE = 512

CURRENT_MODE_ID = 436  # asked for by REQUEST_MESSAGE it is denied unless it has changed (measured)
HEARTBEAT_ID = 0  # sent whenever it is asked for

_BASE_MODE_ARMED = 128
_BASE_MODE_CUSTOM = 1
_AUTO = 4

# px4_custom_mode.h of PX4 1.18: main mode in bits 16 to 23, sub mode in bits 24 to 31. 8 and 9 are not flown.
_MODE_BY_MAIN_SUB: dict[tuple[int, int], FlightMode] = {
    (1, 0): FlightMode.MANUAL,
    (2, 0): FlightMode.ALTITUDE,
    (3, 0): FlightMode.POSITION,
    (3, 1): FlightMode.ORBIT,
    (3, 2): FlightMode.POSITION_SLOW,
    (_AUTO, 1): FlightMode.READY,
    (_AUTO, 2): FlightMode.TAKEOFF,
    (_AUTO, 3): FlightMode.HOLD,
    (_AUTO, 4): FlightMode.MISSION,
    (_AUTO, 5): FlightMode.RETURN,
    (_AUTO, 6): FlightMode.LAND,
    (_AUTO, 8): FlightMode.FOLLOW,
    (_AUTO, 9): FlightMode.PRECISION_LAND,
    (_AUTO, 10): FlightMode.VTOL_TAKEOFF,
    (_AUTO, 19): FlightMode.GUIDED_COURSE,
    (5, 0): FlightMode.ACRO,
    (6, 0): FlightMode.OFFBOARD,
    (7, 0): FlightMode.STABILIZED,
    (10, 0): FlightMode.TERMINATION,
    (11, 0): FlightMode.ALTITUDE_CRUISE,
}
_MAIN_SUB_BY_MODE = {mode: main_sub for main_sub, mode in _MODE_BY_MAIN_SUB.items()}
_EXTERNAL_SUB_MODES = range(11, 19)


def mode_from_custom(custom_mode: int) -> FlightMode:
    """Mode of PX4's ``custom_mode`` word; UNKNOWN for one that this table does not have."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main == _AUTO and sub in _EXTERNAL_SUB_MODES:
        return FlightMode.EXTERNAL
    return _MODE_BY_MAIN_SUB.get((main, sub), FlightMode.UNKNOWN)


# MAV_TYPE. PX4 takes the thrust of a SET_ATTITUDE_TARGET upwards for a quad-, hexa-, octo- and tricopter and for the
# helicopters, forwards for what drives or glides, and as none for any other (MavlinkReceiver::fill_thrust).
_MULTIROTORS = frozenset((2, 13, 14, 15))
_AIRFRAMES = {
    1: "a fixed-wing aircraft",
    3: "a coaxial helicopter",
    4: "a helicopter",
    7: "an airship",
    10: "a rover",
    11: "a boat",
    12: "a submarine",
    **dict.fromkeys(range(19, 26), "a VTOL aircraft"),
}


def airframe(mav_type: int) -> str:
    """What a MAV_TYPE is in words; empty for a multirotor."""
    if mav_type in _MULTIROTORS:
        return ""
    return f"{_AIRFRAMES.get(mav_type, 'another kind of vehicle')} (MAV_TYPE {mav_type})"


def is_requestable(mode: FlightMode) -> bool:
    """True for a mode that ``set_mode`` can ask for."""
    return mode in _MAIN_SUB_BY_MODE


def is_armed(base_mode: int) -> bool:
    """The armed bit of HEARTBEAT's ``base_mode``."""
    return bool(base_mode & _BASE_MODE_ARMED)


def command_long(command: int, *params: float) -> Message:
    """COMMAND_LONG with up to seven parameters, the rest NaN; the target ids are the link's to fill in."""
    values = (*params, *(nan,) * (7 - len(params)))
    fields: Fields = {"command": command, "confirmation": 0}
    fields.update((f"param{index}", value) for index, value in enumerate(values, start=1))
    return "COMMAND_LONG", fields


def set_mode(mode: FlightMode, *, armed: bool) -> Message:
    """DO_SET_MODE; base mode 129 while armed, 1 while not, for PX4 takes the armed bit seriously."""
    main, sub = _MAIN_SUB_BY_MODE[mode]
    base_mode = _BASE_MODE_CUSTOM | (_BASE_MODE_ARMED if armed else 0)
    return command_long(CMD_SET_MODE, float(base_mode), float(main), float(sub))


def set_message_interval(message_id: int, rate_hz: float) -> Message:
    """SET_MESSAGE_INTERVAL in Hz; the unused parameters are zero (param7 chooses the receiver: the asker)."""
    return command_long(CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)


def request_message(message_id: int) -> Message:
    """REQUEST_MESSAGE: send this message once, now."""
    return command_long(CMD_REQUEST_MESSAGE, float(message_id), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def encode_command(command: Command) -> Message:
    """COMMAND_LONG of an arm, disarm or take-off; take-off without an altitude flies to MIS_TAKEOFF_ALT."""
    if command.kind is CommandKind.ARM:
        return command_long(CMD_ARM, 1.0)
    if command.kind is CommandKind.DISARM:
        return command_long(CMD_ARM, 0.0)
    altitude = nan if command.altitude_amsl_m is None else command.altitude_amsl_m
    return command_long(CMD_TAKEOFF, nan, nan, nan, nan, nan, nan, altitude)


SET_ATTITUDE_TARGET_RATES_MASK = 128  # ATTITUDE_IGNORE: body rates and thrust are what counts


def is_sendable(setpoint: Setpoint) -> bool:
    """False for a setpoint with a number that is not finite: PX4 stops the motors on a NaN thrust."""
    return isfinite(sum(setpoint.rates_frd_rad_s) + setpoint.thrust)


def attitude_target(setpoint: Setpoint) -> Message:
    """SET_ATTITUDE_TARGET of a body-rate setpoint, rad/s; PX4 ignores ``time_boot_ms`` and, masked, ``q``."""
    roll, pitch, yaw = setpoint.rates_frd_rad_s
    return "SET_ATTITUDE_TARGET", {
        "time_boot_ms": 0,
        "type_mask": SET_ATTITUDE_TARGET_RATES_MASK,
        "q": [1.0, 0.0, 0.0, 0.0],
        "body_roll_rate": roll,
        "body_pitch_rate": pitch,
        "body_yaw_rate": yaw,
        "thrust": setpoint.thrust,
        "thrust_body": [0.0, 0.0, 0.0],
    }


def param_request_read(name: str) -> Message:
    """PARAM_REQUEST_READ by name."""
    return "PARAM_REQUEST_READ", {"param_id": name, "param_index": -1}
