"""A simulated PX4 in the air, flown over real MAVSDK, and what is seen of it, of the daemon and by systemd."""

import asyncio
import fcntl
import os
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from math import degrees
from pathlib import Path
from typing import Any

from daemon import frames
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import WrongStateError
from daemon.messages import FlightMode, Setpoint
from daemon.sim.airframe_files import load
from daemon.sim.mavlink_server import MavlinkServer
from daemon.sim.px4 import SimulatedPx4
from support.processes import Child, free_udp_port, until

PATIENCE_S = 120.0
HEIGHT_M = 30.0


class Air:
    """Times are of the autopilot's own clock, so that a busy machine counts for nothing; tilt in degrees."""

    def __init__(self, px4: SimulatedPx4, connection: str) -> None:
        self.px4 = px4
        self.connection = connection
        self.ticks: list[tuple[float, FlightMode, float]] = []
        self.sent: list[tuple[float, Setpoint]] = []
        self._step, self._receive = px4.step, px4.receive
        px4.step, px4.receive = self._stepped, self._received  # type: ignore[method-assign]

    @property
    def now_s(self) -> float:
        return self.px4.simulated_us * 1e-6

    def _stepped(self) -> None:
        self._step()
        self.ticks.append((self.now_s, self.px4.mode, degrees(frames.tilt_of(self.px4.truth.attitude_wb))))

    def _received(self, name: str, fields: dict[str, Any], **sender: int) -> None:
        if name == "SET_ATTITUDE_TARGET":
            rates = (fields["body_roll_rate"], fields["body_pitch_rate"], fields["body_yaw_rate"])
            self.sent.append((self.now_s, Setpoint(rates, fields["thrust"])))
        self._receive(name, fields, **sender)

    async def until(self, done: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not done():  # noqa: ASYNC110 - what is waited for is physics
                await asyncio.sleep(0.005)

    async def passes(self, seconds: float) -> None:
        since_s = self.now_s
        await self.until(lambda: self.now_s - since_s >= seconds)


@asynccontextmanager
async def air() -> AsyncIterator[Air]:
    port = free_udp_port()
    px4 = SimulatedPx4(airframe=load("sih"), seed=5)
    px4.start_in_air(HEIGHT_M)
    seen = Air(px4, f"udpin://127.0.0.1:{port}")
    task = asyncio.ensure_future(MavlinkServer([px4], port=port).run())
    try:
        yield seen
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def take(flight: FlightClient, seen: Air) -> None:
    """Take the vehicle that is found in the air."""
    await until(flight, lambda status: status["state"] == "pilot" and status["vehicle"] is not None)
    await seen.passes(1.0)
    await engaged(flight)


async def engaged(flight: FlightClient) -> None:
    """Engage; again where that is refused, for on a busy machine the estimate may be old at the moment."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(WrongStateError):
                await flight.engage()
                return
            await asyncio.sleep(0.1)


async def state_of(child: Child) -> str:
    assert child.socket is not None
    async with FlightClient(child.socket) as flight:
        return str((await flight.status())["state"])


class Systemd:
    """The far end of sd_notify; ``fed_s`` are the times at which the watchdog was fed."""

    def __init__(self, path: Path, clock: Callable[[], float]) -> None:
        self.path = path
        self.fed_s: list[float] = []
        self.heard: list[str] = []
        self._clock = clock
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(str(path))
        asyncio.get_running_loop().add_reader(self._socket, self._read)

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        with suppress(BlockingIOError):
            while True:
                message = self._socket.recv(4096).decode()
                self.heard.append(message)
                if message == "WATCHDOG=1":
                    self.fed_s.append(self._clock())


class LogPipe:
    """A log's reader that takes nothing until ``reads``; then everything goes into the file."""

    def __init__(self) -> None:
        self._read_end, self.write_end = os.pipe()
        fcntl.fcntl(self.write_end, fcntl.F_SETPIPE_SZ, 4096)
        os.set_blocking(self._read_end, False)

    def fill(self) -> None:
        """Until not one more byte fits; by a description of its own, for the daemon's shall go on to block."""
        own = os.open(f"/proc/self/fd/{self.write_end}", os.O_WRONLY | os.O_NONBLOCK)
        with suppress(BlockingIOError):
            while os.write(own, b"\n"):
                pass
        os.close(own)

    def reads(self, log_file: Path) -> None:
        asyncio.get_running_loop().add_reader(self._read_end, self._read, log_file)

    def _read(self, log_file: Path) -> None:
        with log_file.open("ab") as file:
            file.write(os.read(self._read_end, 65536))

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._read_end)
        os.close(self._read_end)
        os.close(self.write_end)
