"""Commands that the commander carries out, and their results (MAV_RESULT) as in recordings of PX4 1.17."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from daemon.messages import FlightMode
from daemon.sim.announcer import ACTION, mode_argument
from daemon.sim.modes import from_numbers

if TYPE_CHECKING:
    from daemon.sim.commander import Commander

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
_GROUND_STATION = 190  # component id: only to it is a refused mode explained (``Commander::handle_command``)
_FORCE = 21196  # MAV_CMD_COMPONENT_ARM_DISARM: disarm in the air


@dataclass(slots=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT that waits for the commander."""

    number: int
    parameters: tuple[float, ...]
    sender: tuple[int, int]


def integer(value: float) -> int:
    """A command's parameter as a number of something; 0 where it is not one."""
    return int(value) if isfinite(value) else 0


def execute(commander: "Commander", command: Command) -> int:
    """Carry a command out; its MAV_RESULT."""
    handler = _HANDLERS.get(command.number)
    return handler(commander, command) if handler is not None else UNSUPPORTED


def _do_set_mode(commander: "Commander", command: Command) -> int:
    p = command.parameters
    mode = from_numbers(integer(p[1]), integer(p[2]))
    if mode is None:
        commander.announcer.say("unsupported_main_mode")
        return TEMPORARILY_REJECTED
    if commander.request_mode(mode):
        return ACCEPTED
    if command.sender[1] == _GROUND_STATION:
        arguments = mode_argument(mode) + bytes([ACTION.get(mode, 0)])
        commander.announcer.say("mode_not_available", arguments, mode.value.capitalize())
    return TEMPORARILY_REJECTED


def _do_arm(commander: "Commander", command: Command) -> int:
    p = command.parameters
    if p[0] == 1.0:
        return ACCEPTED if commander.arm() else TEMPORARILY_REJECTED
    if commander.armed and not commander.detector.landed and integer(p[1]) != _FORCE:
        return TEMPORARILY_REJECTED
    commander.disarm()
    return ACCEPTED


def _do_takeoff(commander: "Commander", command: Command) -> int:
    altitude_m = command.parameters[6]
    if not commander.request_mode(FlightMode.TAKEOFF):
        return TEMPORARILY_REJECTED
    commander.takeoff_altitude_amsl_m = altitude_m if isfinite(altitude_m) else None
    return ACCEPTED


def _do_land(commander: "Commander", _: Command) -> int:
    if not commander.request_mode(FlightMode.LAND):
        return TEMPORARILY_REJECTED
    commander.announcer.say("landing_here")
    return ACCEPTED


def _do_return(commander: "Commander", _: Command) -> int:
    if not commander.request_mode(FlightMode.RETURN):
        return TEMPORARILY_REJECTED
    commander.announcer.say("return_start")
    return ACCEPTED


def _do_checks(commander: "Commander", _: Command) -> int:
    commander.announcer.report_checks(commander.monitor.failing)
    return ACCEPTED


_HANDLERS: dict[int, Callable[["Commander", Command], int]] = {
    20: _do_return,
    21: _do_land,
    22: _do_takeoff,
    176: _do_set_mode,
    400: _do_arm,
    401: _do_checks,
}
