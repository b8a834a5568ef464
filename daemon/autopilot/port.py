"""The seam to an autopilot: MAVSDK live, the simulated PX4 in-process under virtual time."""

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from daemon.latest import Latest
from daemon.messages import AutopilotStatus, ClockSync, FlightMode, Imu, Odometry, Setpoint


class CommandKind(Enum):
    """Commands that are not a change of mode."""

    ARM = "arm"
    DISARM = "disarm"
    TAKEOFF = "takeoff"


@dataclass(frozen=True, slots=True)
class Command:
    """A command to the autopilot; ``altitude_amsl_m`` for TAKEOFF only (metres above mean sea level)."""

    kind: CommandKind
    altitude_amsl_m: float | None = None


class LinkError(Exception):
    """Base of what a command can raise."""


class CommandRefusedError(LinkError):
    """The autopilot said no; the text is its reason in words."""


class CommandTimeoutError(LinkError):
    """No acknowledgement came in time; the command may still take effect."""


class NotConnectedError(LinkError):
    """No autopilot to send to."""


class Autopilot(Protocol):
    """What the daemon needs of an autopilot. Cells are written by the link and read by the tasks.

    ``send_setpoint`` and ``request_mode`` never block, never raise, and may be called from the dead-man's thread;
    they return False when nothing could be sent. The outcome of ``request_mode`` shows in ``status``:
    ``mode`` (and ``intended_mode``) when it took effect, ``mode_refusal`` when the autopilot said no.
    ``clock`` is None while TIMESYNC says nothing of the autopilot's clock. ``slow_streams``: names of the messages that
    come more seldom than they must.
    """

    odometry: Latest[Odometry | None]
    imu: Latest[Imu | None]
    status: Latest[AutopilotStatus]
    clock: Latest[ClockSync | None]
    slow_streams: Latest[tuple[str, ...]]

    async def run(self) -> None:
        """Connect, ask for the streams on every (re)connect, keep the cells fresh, until cancelled.

        What ends it, a failure too, leaves the way out open: the vehicle can still be handed over.
        """

    async def close(self) -> None:
        """After ``run`` has ended: nothing is sent and nothing comes any more."""

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send one body-rate setpoint (SET_ATTITUDE_TARGET) now."""

    def request_mode(self, mode: FlightMode) -> bool:
        """Ask for a mode (DO_SET_MODE) without waiting."""

    async def command(self, command: Command, timeout_s: float) -> None:
        """Send a command, again while it is not acknowledged, and wait for that; cancelled, it is not sent again.

        Raises ``CommandRefusedError`` with the reason, ``CommandTimeoutError``, ``NotConnectedError``.
        """

    def withdraw_commands(self) -> None:
        """From now on no command is sent again; whoever waits for one gets ``CommandTimeoutError``."""

    def stood_still(self) -> None:
        """We stood still: what is known is of before, until something shows what the autopilot does now."""

    def ask_mode(self) -> None:
        """Ask what the autopilot flies now, without waiting: ``status.told_s`` of the answer is not before this."""

    async def read_parameter(self, name: str, timeout_s: float) -> float | int | None:
        """One autopilot parameter, or None where the autopilot does not know it.

        Raises ``CommandTimeoutError`` when it does not answer, ``NotConnectedError``.
        """
