"""PX4's flight modes on the wire: custom_mode, base_mode, navigation state."""

from daemon.messages import FlightMode

# (main mode, sub mode), base_mode without the armed bit, bit of the navigation state in health events
_MODES: dict[FlightMode, tuple[int, int, int, int]] = {
    FlightMode.MANUAL: (1, 0, 65, 0),
    FlightMode.ALTITUDE: (2, 0, 81, 1),
    FlightMode.POSITION: (3, 0, 81, 2),
    FlightMode.POSITION_SLOW: (3, 2, 81, 6),
    FlightMode.TAKEOFF: (4, 2, 29, 17),
    FlightMode.HOLD: (4, 3, 29, 4),
    FlightMode.MISSION: (4, 4, 29, 3),
    FlightMode.RETURN: (4, 5, 29, 5),
    FlightMode.LAND: (4, 6, 29, 18),
    FlightMode.ACRO: (5, 0, 65, 10),
    FlightMode.OFFBOARD: (6, 0, 1, 14),
    FlightMode.STABILIZED: (7, 0, 81, 15),
    FlightMode.ALTITUDE_CRUISE: (11, 0, 81, 8),
}
_BY_NUMBERS = {numbers[:2]: mode for mode, numbers in _MODES.items()}
ARMED_BIT = 128
ALL_MODES = tuple(_MODES)

STICK_VELOCITY_MODES = frozenset(
    (FlightMode.ALTITUDE, FlightMode.ALTITUDE_CRUISE, FlightMode.POSITION, FlightMode.POSITION_SLOW)
)
MANUAL_MODES = STICK_VELOCITY_MODES | {FlightMode.MANUAL, FlightMode.ACRO, FlightMode.STABILIZED}
NEEDS_POSITION = frozenset(
    (
        FlightMode.POSITION,
        FlightMode.POSITION_SLOW,
        FlightMode.TAKEOFF,
        FlightMode.HOLD,
        FlightMode.MISSION,
        FlightMode.RETURN,
        FlightMode.LAND,
    )
)
STANDARD_MODE = {FlightMode.TAKEOFF: 8, FlightMode.LAND: 7}


def custom_mode(mode: FlightMode) -> int:
    """HEARTBEAT.custom_mode of a mode."""
    main, sub, _, _ = _MODES[mode]
    return sub << 24 | main << 16


def base_mode(mode: FlightMode, armed: bool) -> int:
    """HEARTBEAT.base_mode of a mode."""
    return _MODES[mode][2] | (ARMED_BIT if armed else 0)


def navigation_bit(mode: FlightMode) -> int:
    """The mode's bit in the masks of PX4's health events."""
    return 1 << _MODES[mode][3]


def from_numbers(main: int, sub: int) -> FlightMode | None:
    """The mode of DO_SET_MODE's param2 and param3; None where PX4 (or this simulation) has no such mode.

    A sub mode that does not exist is refused in Auto only.
    """
    return _BY_NUMBERS.get((main, sub), None if main == 4 else _BY_NUMBERS.get((main, 0)))
