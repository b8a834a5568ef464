"""The part of an ``Autopilot`` that every transport shares: the session's cells, and waiting for answers."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from daemon.autopilot.param_reads import Answer
from daemon.autopilot.port import Command, CommandTimeoutError, LinkError
from daemon.autopilot.px4 import encode_command
from daemon.autopilot.session import Px4Session

T = TypeVar("T")
_WAIT_MARGIN_S = 1.0  # the session itself times out; this is for a transport that no longer polls it


class SessionLink:
    """The cells, ``command`` and ``read_parameter`` of the port, on a ``Px4Session``."""

    def __init__(self, session: Px4Session, flush: Callable[[], None]) -> None:
        self.session = session
        self.odometry = session.odometry
        self.imu = session.imu
        self.status = session.status
        self.clock = session.clock
        self.slow_streams = session.slow_streams
        self._flush = flush

    async def command(self, command: Command, timeout_s: float) -> None:
        """Send a command and wait for the ack: CommandRefusedError, CommandTimeoutError, NotConnectedError."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[LinkError | None] = loop.create_future()
        done = _settle(future)
        self.session.start_command(encode_command(command), loop.time(), timeout_s, done)
        self._flush()
        try:
            error = await asyncio.wait_for(future, timeout_s + _WAIT_MARGIN_S)
        except TimeoutError:
            raise CommandTimeoutError("the link has stopped") from None
        finally:
            self.session.drop_command(done)
        if error is not None:
            raise error

    def withdraw_commands(self) -> None:
        """No command is sent again; whoever waits for one gets CommandTimeoutError."""
        self.session.withdraw_commands()

    def stood_still(self) -> None:
        """What is known of the autopilot is of before, until TIMESYNC answers a request of now."""
        self.session.stood_still(asyncio.get_running_loop().time())
        self._flush()

    def ask_mode(self) -> None:
        """Ask what the autopilot flies now: ``status.told_s`` of the answer is not before this."""
        self.session.ask_mode(asyncio.get_running_loop().time())
        self._flush()

    async def read_parameter(self, name: str, timeout_s: float) -> float | int | None:
        """One parameter, or None: not known to the autopilot. CommandTimeoutError, NotConnectedError."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Answer] = loop.create_future()
        self.session.read_parameter(name, loop.time(), timeout_s, _settle(future))
        self._flush()
        try:
            answer = await asyncio.wait_for(future, timeout_s + _WAIT_MARGIN_S)
        except TimeoutError:
            raise CommandTimeoutError("the link has stopped") from None
        if isinstance(answer, LinkError):
            raise answer
        return answer


def _settle(future: "asyncio.Future[T]") -> Callable[[T], None]:
    def done(value: T) -> None:
        if not future.done():
            future.set_result(value)

    return done
