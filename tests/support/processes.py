"""flightd's commands as child processes, on ports, sockets and folders of their own; always stopped."""

import asyncio
import contextlib
import itertools
import json
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError

START_S = 90.0
STOP_S = 30.0
TROUBLED = Path(__file__).parent / "troubled_daemon.py"
FLIGHTD = (sys.executable, "-m", "daemon.cli.main")


_taken: list[socket.socket] = []
_numbers = itertools.count(97 * os.getpid())


def free_udp_port() -> int:
    """A port of loopback that nobody has, gets from the kernel (those begin at 32768), or from here in another process.

    A simulator sends to it before anybody listens: who gets it meanwhile would hear a strange vehicle. The next three
    are for further vehicles. A name in the kernel keeps it for the life of this process.
    """
    while True:
        port = 20000 + 4 * (next(_numbers) % 3000)
        name, probe = socket.socket(socket.AF_UNIX), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with probe, contextlib.suppress(OSError):
            name.bind(f"\0flightd/tests/{port}")
            probe.bind(("127.0.0.1", port))
            _taken.append(name)
            return port
        name.close()


def events_of(log_file: Path) -> list[dict[str, Any]]:
    """Its lines that are whole: the daemon may be writing the last one."""
    whole = log_file.read_text().rpartition("\n")[0]
    return [json.loads(line) for line in whole.splitlines() if line.startswith("{")]


@dataclass
class Child:
    """A running command; its log lines are parsed JSON."""

    process: asyncio.subprocess.Process
    log_file: Path
    socket: Path | None = None

    def events(self) -> list[dict[str, Any]]:
        return events_of(self.log_file)

    def states(self) -> list[str]:
        return [event["state"] for event in self.events() if event.get("event") == "state"]

    async def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """Signal it and wait for its end; killed when it does not come to an end."""
        if self.process.returncode is None:
            self.process.send_signal(number)
        try:
            return await asyncio.wait_for(self.process.wait(), STOP_S)
        except TimeoutError:
            self.process.kill()
            await self.process.wait()
            raise


async def start(tmp_path: Path, name: str, *args: str, environ: dict[str, str] | None = None) -> Child:
    log_file = tmp_path / f"{name}.log"
    with log_file.open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            *FLIGHTD,
            *args,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env={**os.environ, "STATE_DIRECTORY": str(tmp_path), **(environ or {})},
        )
    return Child(process, log_file)


@asynccontextmanager
async def running(child: Child) -> AsyncIterator[Child]:
    try:
        yield child
    finally:
        with contextlib.suppress(ProcessLookupError):
            await child.stop()


@asynccontextmanager
async def daemon_on(tmp_path: Path, connection: str, *args: str) -> AsyncIterator[Child]:
    """``flightd run`` with a socket of its own; waits until it answers."""
    path = tmp_path / "flightd.sock"
    child = await start(tmp_path, "flightd", "run", "--connection", connection, "--socket", str(path), *args)
    child.socket = path
    async with running(child):
        await answers(child)
        yield child


@asynccontextmanager
async def troubled_daemon(
    tmp_path: Path,
    connection: str,
    trouble: str = "",
    *,
    block_s: float = 0.0,
    config: Path | None = None,
    environ: dict[str, str] | None = None,
    stderr: int | None = None,
) -> AsyncIterator[Child]:
    """A daemon that gets into a trouble of ``troubled_daemon.py`` at SIGUSR1; it logs to a file, or to ``stderr``."""
    path, log_file = tmp_path / "flightd.sock", tmp_path / "flightd.log"
    with log_file.open("ab") as log:
        process = await asyncio.create_subprocess_exec(
            sys.executable, str(TROUBLED), connection, str(path), *([] if config is None else [str(config)]),
            stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log if stderr is None else stderr,
            env={**os.environ, "STATE_DIRECTORY": str(tmp_path), "TROUBLE": trouble, "BLOCK_S": str(block_s),
                 **(environ or {})},
        )  # fmt: skip
    child = Child(process, log_file, path)
    async with running(child):
        await answers(child)
        yield child


async def answers(child: Child) -> None:
    assert child.socket is not None
    async with asyncio.timeout(START_S):
        while True:
            assert child.process.returncode is None, child.log_file.read_text()
            try:
                async with FlightClient(child.socket, reconnect_s=0.0) as flight:
                    await flight.info()
                    return
            except (FlightError, OSError):
                await asyncio.sleep(0.05)


async def until(flight: FlightClient, done: Any, limit_s: float = START_S) -> dict[str, Any]:
    """The first status for which ``done`` holds."""
    async with asyncio.timeout(limit_s):
        while True:
            status: dict[str, Any] = dict(await flight.status())
            if done(status):
                return status
            await asyncio.sleep(0.05)
