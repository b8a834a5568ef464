"""The loop in real time: the daemon, whole, and plain clients beside it, over UDP against an autopilot that keeps time.

Each flight has an autopilot's end of its own (``daemon.sim.metronome``) and runs in a process of its own; rounds go
through all of them in turn, and what is reported is the median over the rounds.
"""

import asyncio
import contextlib
import importlib.util
import json
import os
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from daemon.bench.quantiles import quantile
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import NoDaemonError
from daemon.sim.metronome import NUMBERS

SUBSCRIBERS = 5
_TOPICS = ("state", "loops")
_PATIENCE_S = 45.0
_AGAIN_S = 0.3  # between tries to connect
_ROOT = Path(__file__).resolve().parent.parent.parent
_LOAD = "while True: pass"
Figures = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """Who flies, how: ``loaded`` keeps one core busy, ``recorded`` records and serves five subscribers."""

    name: str
    client: str = ""  # module of daemon.bench.contestants; empty: the daemon
    loaded: bool = False
    recorded: bool = False
    uneven: bool = False
    rate_hz: float = 100.0
    python: str = sys.executable


def programme(rate_hz: float, grpc_python: str | None) -> list[Flight]:
    """The daemon in its conditions, and the clients idle and loaded; mavsdk-grpc where it is installed."""
    daemon = [
        Flight(name="flightd", rate_hz=rate_hz),
        Flight(name="flightd, uneven", uneven=True, rate_hz=rate_hz),
        Flight(name="flightd, recording and subscribers", recorded=True, rate_hz=rate_hz),
        Flight(name="flightd, loaded", loaded=True, rate_hz=rate_hz),
    ]
    clients = [
        ("synchronous plugin", "sync_plugin", sys.executable),
        ("asyncio API", "asyncio_api", sys.executable),
        ("pymavlink", "pymavlink_alone", sys.executable),
    ]
    if grpc_python or importlib.util.find_spec("mavsdk_grpc"):
        clients.append(("mavsdk-grpc", "grpc_api", grpc_python or sys.executable))
    idle = [Flight(name=name, client=module, python=python) for name, module, python in clients]
    loaded = [Flight(name=f"{f.name}, loaded", client=f.client, python=f.python, loaded=True) for f in idle]
    return [*daemon, *idle, *loaded]


async def measure(
    flights: Iterable[Flight], seconds: float, rounds: int, tell: Callable[[str], None]
) -> dict[str, Figures]:
    """Medians over the rounds, by flight; a flight that failed says why in ``error``."""
    found: dict[str, list[Figures]] = {flight.name: [] for flight in flights}
    for number in range(rounds):
        for flight in flights:
            figures = await _fly(flight, seconds)
            tell(f"round {number + 1}, {flight.name}: {figures.get('error', 'done')}")
            found[flight.name].append(figures)
    return {name: _median(of_rounds) for name, of_rounds in found.items()}


def _median(rounds: list[Figures]) -> Figures:
    good = [figures for figures in rounds if "error" not in figures]
    if not good:
        return rounds[0]
    return {
        key: {k: median(f[key][k] for f in good) for k in value} if isinstance(value, dict) else
        median(f[key] for f in good)
        for key, value in good[0].items()
    }  # fmt: skip


async def _fly(flight: Flight, seconds: float) -> Figures:
    with tempfile.TemporaryDirectory() as folder:
        try:
            async with contextlib.AsyncExitStack() as stack:
                said, log = await _flown(flight, seconds, Path(folder), stack)
        except (TimeoutError, ValueError) as error:
            return {"error": f"{type(error).__name__} {error}".strip()}
        return said if "error" in said else figures_of(said, log, 1.0 / flight.rate_hz)


async def _flown(
    flight: Flight, seconds: float, folder: Path, stack: contextlib.AsyncExitStack
) -> tuple[Figures, Figures]:
    """What the flight's process said at its end, and the autopilot's log."""
    port, path = free_port(), folder / "flightd.sock"
    notes, received = folder / "autopilot.json", [0] * SUBSCRIBERS
    if flight.loaded:
        await stack.enter_async_context(process([sys.executable, "-c", _LOAD]))
    if flight.client:
        arguments = ["-m", f"daemon.bench.contestants.{flight.client}", str(port), str(seconds)]
    else:
        record = str(folder / "record") if flight.recorded else ""
        arguments = ["-m", "daemon.bench.loop_daemon", str(port), str(seconds), str(path), str(flight.rate_hz), record]
    metronome = ["-m", "daemon.sim.metronome", str(port), "100", str(int(flight.uneven))]
    async with (
        process([sys.executable, *metronome], notes),
        process([flight.python, *arguments], folder / "said") as running,
    ):
        if flight.recorded:
            subscribers = asyncio.create_task(_subscribe(path, received))
            stack.callback(subscribers.cancel)
        await asyncio.wait_for(running.wait(), seconds + _PATIENCE_S)
    if flight.recorded and (min(received) == 0 or not any((folder / "record").iterdir())):
        raise ValueError(f"not recorded, or not sent to all subscribers: {received}")
    lines = [line for line in (folder / "said").read_text().splitlines() if line.startswith("{")]
    if not lines:
        raise ValueError(f"nothing said: {(folder / 'said.err').read_text()[-200:]}")
    return json.loads(lines[-1]), json.loads(notes.read_text())


def figures_of(said: Figures, log: Figures, period_s: float) -> Figures:
    """Milliseconds, per cent of a core and megabytes, over the time that the client counted."""
    from_s, to_s = said["from_s"], said["to_s"]
    setpoints = [(at_s, thrust) for at_s, thrust in log["setpoints"] if from_s <= at_s <= to_s]
    gaps = [after - before for (before, _), (after, _) in pairwise(setpoints)]
    delays, overtaken = _delays(setpoints, said.get("used"), log["odometry"])
    figures = {
        "setpoints": len(setpoints),
        "period_p50_ms": 1e3 * quantile(gaps, 0.5),
        "period_p99_ms": 1e3 * quantile(gaps, 0.99),
        "period_max_ms": 1e3 * max(gaps, default=0.0),
        "deviation_p50_ms": 1e3 * quantile([abs(gap - period_s) for gap in gaps], 0.5),
        "deviation_p99_ms": 1e3 * quantile([abs(gap - period_s) for gap in gaps], 0.99),
        "delay_p50_ms": 1e3 * quantile(delays, 0.5),
        "delay_p99_ms": 1e3 * quantile(delays, 0.99),
        "overtaken_pct": 100.0 * overtaken / max(1, len(delays)),
        "cpu_pct": 100.0 * said["cpu_s"] / (to_s - from_s),
        "cpu_s_per_minute": 60.0 * said["cpu_s"] / (to_s - from_s),
        "rss_mb": said["rss_mb"],
    }
    return figures | {key: value for key, value in said.items() if key not in _OWN}


_OWN = frozenset({"from_s", "to_s", "cpu_s", "rss_mb", "used"})


def _delays(
    setpoints: list[tuple[float, float]], used: list[tuple[float, int]] | None, odometry: list[tuple[int, float]]
) -> tuple[list[float], int]:
    """From ODOMETRY on the wire to the setpoint that used it; how many left 1 ms or more after a newer one came.

    The daemon says which number it used at which tick; the others send it in the thrust.
    """
    delays, overtaken, tick, newest = [], 0, 0, 0
    for at_s, thrust in setpoints:
        number = round((thrust - 0.3) * 1e4) % NUMBERS
        if used is not None:
            while tick + 1 < len(used) and used[tick + 1][0] <= at_s:
                tick += 1
            number = used[tick][1] % NUMBERS
        while newest + 1 < len(odometry) and odometry[newest + 1][1] <= at_s:
            newest += 1
        own = newest
        while own > 0 and odometry[own][0] != number and newest - own < NUMBERS:
            own -= 1
        if odometry[own][0] == number:
            delays.append(at_s - odometry[own][1])
            overtaken += own < newest and odometry[own + 1][1] <= at_s - 1e-3
    return delays, overtaken


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
