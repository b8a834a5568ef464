"""The loop in real time: the daemon, whole, and plain clients beside it, over UDP against an autopilot that keeps time.

Each flight has an autopilot's end of its own (``daemon.sim.metronome``) and runs in a process of its own; rounds go
through all of them in turn. Medians over the rounds are reported, but sums of counts, and the largest of maxima.
"""

import asyncio
import contextlib
import importlib.util
import json
import os
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from daemon.bench.loop_figures import Figures, figures_of, over_rounds
from daemon.bench.stillness import Stillness
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import NoDaemonError
from daemon.sim import metronome

WARM_UP_S = 5.0  # the grid's phase is slewed to the stream meanwhile
RATES_HZ = (50.0, 200.0, 250.0)
_TOPICS = ("state", "loops")
_PATIENCE_S = 45.0
_AGAIN_S = 0.3  # between tries to connect
_ROOT = Path(__file__).resolve().parent.parent.parent
_LOAD = "while True: pass"
_LAST_CORE = max(os.sched_getaffinity(0))
_REAL_TIME = {"realtime_priority": 40, "cpu_affinity": [_LAST_CORE]}  # as docs/installation.md has it for a vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """Who flies, how: ``loaded`` keeps one core busy, ``uneven`` has PX4's gaps of 8 and 16 ms between ODOMETRY.

    ``loops``: settings of the daemon's that differ from its own. ``one_core``: a client that is held on the last core.
    """

    name: str
    client: str = ""  # module of daemon.bench.contestants; empty: the daemon
    loaded: bool = False
    uneven: bool = False
    recorded: bool = False
    one_core: bool = False
    loops: Mapping[str, Any] = field(default_factory=dict)
    subscribers: int = 0
    rate_hz: float = 100.0
    python: str = sys.executable

    @property
    def cores(self) -> set[int]:
        """Those that the client may run on."""
        return {_LAST_CORE} if self.one_core or "cpu_affinity" in self.loops else os.sched_getaffinity(0)


def programme(rate_hz: float, grpc_python: str | None) -> list[Flight]:
    """The daemon in its conditions and at other rates, and the clients, idle and loaded.

    mavsdk-grpc flies where it is installed. ``rate_hz`` is the daemon's where the name of the flight says none.
    """
    daemon = [
        Flight(name="flightd", rate_hz=rate_hz),
        Flight(name="flightd, uneven", uneven=True, rate_hz=rate_hz),
        Flight(name="flightd, recording", recorded=True, rate_hz=rate_hz),
        Flight(name="flightd, recording, real time", recorded=True, loops=_REAL_TIME, rate_hz=rate_hz),
        Flight(name="flightd, recording, 5 subscribers", recorded=True, subscribers=5, rate_hz=rate_hz),
        Flight(name="flightd, loaded", loaded=True, rate_hz=rate_hz),
    ]
    rates = [Flight(name=f"flightd, {rate:g} Hz", rate_hz=rate) for rate in RATES_HZ]
    clients = [
        ("C, SCHED_FIFO", "c_api", sys.executable),
        ("synchronous plugin", "sync_plugin", sys.executable),
        ("asyncio API", "asyncio_api", sys.executable),
        ("pymavlink", "pymavlink_alone", sys.executable),
    ]
    if grpc_python or importlib.util.find_spec("mavsdk_grpc"):
        clients.append(("mavsdk-grpc", "grpc_api", grpc_python or sys.executable))
    idle = [Flight(name=name, client=module, python=python) for name, module, python in clients]
    loaded = [Flight(name=f"{f.name}, loaded", client=f.client, python=f.python, loaded=True) for f in idle]
    held = Flight(name="asyncio API, one core", client="asyncio_api", one_core=True)
    return [*daemon, *rates, *idle, held, *loaded]


async def measure(
    flights: Iterable[Flight], seconds: float, rounds: int, tell: Callable[[str], None]
) -> dict[str, Figures]:
    """Figures over the rounds, by flight; a flight that failed or cannot be flown here says why in ``error``."""
    found: dict[str, list[Figures]] = {flight.name: [] for flight in flights}
    for number in range(rounds):
        for flight in flights:
            figures = await _fly(flight, seconds)
            tell(f"round {number + 1}, {flight.name}: {figures.get('error', 'done')}")
            found[flight.name].append(figures)
    return {name: over_rounds(of_rounds) for name, of_rounds in found.items()}


async def _fly(flight: Flight, seconds: float) -> Figures:
    with tempfile.TemporaryDirectory() as folder:
        stillness = Stillness(flight.cores)
        try:
            async with stillness.watched(process), contextlib.AsyncExitStack() as stack:
                said, log = await _flown(flight, seconds, Path(folder), stack)
        except (OSError, ValueError) as error:
            return {"error": f"{type(error).__name__} {error}".strip()}
        return said if "error" in said else figures_of(said, log, 1.0 / flight.rate_hz, stillness.spans)


async def _flown(
    flight: Flight, seconds: float, folder: Path, stack: contextlib.AsyncExitStack
) -> tuple[Figures, Figures]:
    """What the flight's process said at its end, and the autopilot's log."""
    port, path = free_port(), folder / "flightd.sock"
    notes, received = folder / "autopilot.json", [0] * flight.subscribers
    if flight.loaded:
        await stack.enter_async_context(process([sys.executable, "-c", _LOAD]))
    times = [str(port), str(seconds), str(WARM_UP_S)]
    if flight.client:
        arguments = ["-m", f"daemon.bench.contestants.{flight.client}", *times]
    else:
        record = str(folder / "record") if flight.recorded else ""
        how = [str(path), str(flight.rate_hz), record, json.dumps(dict(flight.loops))]
        arguments = ["-m", "daemon.bench.loop_daemon", *times, *how]
    held = ["taskset", "--cpu-list", str(_LAST_CORE)] if flight.one_core else []
    autopilot = ["-m", metronome.__name__, str(port), "100", str(int(flight.uneven))]
    async with (
        process([sys.executable, *autopilot], notes),
        process([*held, flight.python, *arguments], folder / "said") as running,
    ):
        if flight.subscribers:
            subscribers = asyncio.create_task(_subscribe(path, received))
            stack.callback(subscribers.cancel)
        await asyncio.wait_for(running.wait(), WARM_UP_S + seconds + _PATIENCE_S)
    lines = [line for line in (folder / "said").read_text().splitlines() if line.startswith("{")]
    if not lines:
        raise ValueError(f"nothing said: {(folder / 'said.err').read_text()[-200:]}")
    said = json.loads(lines[-1])
    if "error" not in said and min(received, default=1) == 0:
        raise ValueError(f"not sent to all subscribers: {received}")
    if "error" not in said and flight.recorded and not any((folder / "record").glob("*")):
        raise ValueError("not recorded")
    return said, json.loads(notes.read_text())


async def _subscribe(path: Path, received: list[int]) -> None:
    """As many subscribers as ``received`` has counters, each on a connection of its own."""

    async def one(index: int) -> None:
        while True:
            with contextlib.suppress(NoDaemonError):  # it is not up yet
                async with FlightClient(path) as client:
                    async for _ in client.telemetry(*_TOPICS, rate_hz=20.0):
                        received[index] += 1
            await asyncio.sleep(_AGAIN_S)

    await asyncio.gather(*(one(index) for index in range(len(received))))


@contextlib.asynccontextmanager
async def process(command: list[str], out: Path | None = None) -> AsyncIterator[asyncio.subprocess.Process]:
    """A process that is told to end at the end; what it says goes to a file, its complaints beside it."""
    environment = {**os.environ, "MAVLINK20": "1", "PYTHONPATH": str(_ROOT)}
    with contextlib.ExitStack() as stack:
        to = stack.enter_context((out or Path(os.devnull)).open("wb"))
        complaints = stack.enter_context((out.with_suffix(".err") if out else Path(os.devnull)).open("wb"))
        process = await asyncio.create_subprocess_exec(*command, stdout=to, stderr=complaints, env=environment)
        try:
            yield process
        finally:
            if process.returncode is None:
                process.terminate()
                await process.wait()


def free_port() -> int:
    """A UDP port of loopback that nobody has right now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
