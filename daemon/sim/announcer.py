"""PX4 speaking to people: EVENT messages, and their STATUSTEXT twins on links where a ground station is heard.

Ids (FNV-1a hashes of the events' names: libevents), log levels and arguments are those in recordings of PX4 1.17, or,
for Descend and the kill switch, those of ``FailsafeBase::notifyUser`` and ``Commander::executeActionRequest``.
"""

from collections.abc import Callable
from math import nan
from typing import Any

from daemon.messages import FlightMode
from daemon.sim.modes import custom_mode, navigation_bit

Send = Callable[[str, dict[str, Any]], None]

# name: (id, log levels, text, severity); an empty text has no STATUSTEXT twin
EVENTS: dict[str, tuple[int, int, str, int]] = {
    "armed_by": (26266355, 102, "Armed by external command", 6),
    "disarmed_by": (32794487, 102, "Disarmed by landing", 6),
    "arm_denied": (16910493, 98, "Arming denied: Resolve system health failures first", 2),
    "takeoff_default_altitude": (20656071, 102, "", 6),
    "takeoff_detected": (21054825, 102, "Takeoff detected", 6),
    "landing_here": (20099806, 102, "Landing at current position", 6),
    "landing_detected": (26622124, 102, "Landing detected", 6),
    "unsupported_main_mode": (19545959, 51, "Unsupported main mode", 2),
    "mode_not_available": (27280279, 98, "Switching to {} is currently not available", 2),
    "manual_control_lost": (22400324, 102, "", 6),
    "failsafe": (31382480, 66, "Failsafe activated", 2),
    "failsafe_hold": (30481910, 66, "Failsafe activated: entering Hold for 5 seconds", 2),
    "failsafe_disengaged": (29547634, 66, "Failsafe activated", 2),
    "failsafe_because": (26528394, 66, "Failsafe activated", 2),
    "kill_engaged": (28067779, 98, "Kill engaged", 2),
    "kill_disengaged": (33459871, 102, "Kill disengaged", 6),
    "pilot_took_over": (17738815, 102, "", 6),
    "return_start": (22161044, 102, "RTL: start return", 6),
    "return_land": (16962474, 102, "RTL: land at destination", 6),
    "battery_low": (21826980, 34, "", 4),
    "battery_low_advice": (28993875, 100, "Low battery level, return advised", 4),
    "battery_critical": (19404811, 34, "", 4),
    "battery_shutdown_failed": (22624381, 48, "Dangerously low battery! System shut down failed", 0),
    "battery_emergency": (28121863, 0, "", 0),
    "gnss_fusion_stopped": (31476391, 102, "", 6),
    "gnss_fusion_started": (32069699, 102, "", 6),
    "compass_stopped": (20380425, 34, "", 2),
    "checks_begin": (27825120, 136, "", 6),
    "checks_end": (18691879, 136, "", 6),
}
# Standing failures: (id, log levels, navigation states that they forbid, health component)
CHECKS: dict[str, tuple[int, int, int, int]] = {
    "heading_not_stable": (33420013, 51, 0x007ED17E, 17),
    "local_position": (30612409, 51, 0x007E007C, 17),
    "global_position": (26788467, 51, 0x00000038, 24),
    "mission": (17154777, 102, 0x00000008, 20),
    "offboard_signal": (19865031, 51, navigation_bit(FlightMode.OFFBOARD), 20),
    "manual_control": (17231145, 51, 0x00008547, 7),
    "ground_station": (23579003, 102, 0xFFFFFFFF, 12),
    "compass_fault": (23035260, 51, 0xFFFFFFFF, 27),
    "mode_cannot_arm": (18648929, 102, 0x003C3020, 20),
}
# The numbers by which failsafe events name modes (PX4's failsafe framework, Action)
ACTION = {
    FlightMode.POSITION: 2,
    FlightMode.ALTITUDE: 3,
    FlightMode.STABILIZED: 4,
    FlightMode.HOLD: 5,
    FlightMode.RETURN: 6,
    FlightMode.LAND: 7,
}
DESCEND_ACTION = 8


def mode_argument(mode: FlightMode) -> bytes:
    """A mode as the first argument of an event."""
    return custom_mode(mode).to_bytes(4, "little")


class Announcer:
    """Numbers the events and sends them."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self.sequence = 0
        self.ground_station_heard = False
        self.time_boot_ms = 0

    def say(self, name: str, arguments: bytes = b"", *about: str) -> None:
        """Send an event, and its text to a ground station."""
        identifier, levels, text, severity = EVENTS[name]
        self._event(identifier, levels, arguments)
        if text and self.ground_station_heard:
            fields = {"severity": severity, "text": text.format(*about) + "\t", "id": 0, "chunk_seq": 0}
            self._send("STATUSTEXT", fields)

    def report_checks(self, failing: tuple[str, ...]) -> None:
        """The whole list of standing failures, as PX4 sends it whenever one changes."""
        self.say("checks_begin", bytes(15))
        for name in failing:
            identifier, levels, states, component = CHECKS[name]
            self._event(identifier, levels, states.to_bytes(4, "little") + bytes([component]))
        self.say("checks_end", bytes(5))

    def stow_gimbal(self, system_id: int) -> None:
        """PX4 sends gimbal commands to the link at a landing; a companion must not take them as its own."""
        nothing = [nan] * 4
        for number, values in ((1001, [system_id, 1, -1, -1, 0, 0, 0]), (1000, [*nothing, 2, 0, 0])):
            fields = {"target_system": system_id, "target_component": 0, "command": number}
            parameters = {f"param{index + 1}": float(value) for index, value in enumerate(values)}
            self._send("COMMAND_LONG", {**fields, "confirmation": 0, **parameters})

    def _event(self, identifier: int, levels: int, arguments: bytes) -> None:
        self.sequence = (self.sequence + 1) & 0xFFFF
        self._send(
            "EVENT",
            {
                "id": identifier,
                "event_time_boot_ms": self.time_boot_ms,
                "sequence": self.sequence,
                "destination_component": 0,
                "destination_system": 0,
                "log_levels": levels,
                "arguments": list(arguments.ljust(40, b"\0")),
            },
        )
