"""The processes of the demo: the simulated PX4 and the daemon, started with free names and always stopped."""

import asyncio
import socket
import sys
from contextlib import suppress
from pathlib import Path

STOP_S = 5.0


class ChildError(Exception):
    """A process of the demo ended by itself; the text has its last words."""


class Child:
    """One process, its output in a file."""

    def __init__(self, name: str, process: asyncio.subprocess.Process, log: Path) -> None:
        self.name = name
        self._process = process
        self._log = log

    @classmethod
    async def start(cls, name: str, arguments: list[str], log: Path) -> "Child":
        """Run ``flightd`` with arguments."""
        with log.open("wb") as output:
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "daemon.cli.main", *arguments, stdout=output, stderr=output
            )
        return cls(name, process, log)

    async def ended(self) -> None:
        """Wait until the process ends by itself, and raise ``ChildError``."""
        code = await self._process.wait()
        words = self._log.read_text(errors="replace").strip().splitlines()[-3:]
        raise ChildError(f"{self.name} ended with code {code}: {' | '.join(words) or 'no output'} (see {self._log})")

    async def stop(self) -> None:
        """SIGTERM, and SIGKILL when that takes longer than ``STOP_S``."""
        for signal in (self._process.terminate, self._process.kill):
            if self._process.returncode is not None:
                return
            with suppress(ProcessLookupError):
                signal()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), STOP_S)


def free_udp_port() -> int:
    """A UDP port of loopback that nobody has right now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
