"""A flood of requests while flying, beside the same flight without: short here, 30 s of each with FLIGHTD_SOAK=100.

The figures are printed as a table (`pytest -s`); what depends on the machine's speed is not asserted.
"""

import asyncio
import json
import os
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from math import sqrt
from pathlib import Path

from support.processes import Child, answers, free_udp_port, running, start, until
from support.standstill import StoodStillError, where_it_runs

from daemon.bench.quantiles import quantile
from daemon.goals.client import FlightClient

SUPPORT = Path(__file__).parents[1] / "support"
RATE_HZ = 5000
LONG = int(os.environ.get("FLIGHTD_SOAK", "1")) >= 100
PHASE_S = 15.0 if LONG else 1.5
ASK_S = 0.05
FLOWN = {"kind": "lemniscate", "center": [0, 0, -5], "size_m": [6, 3], "speed_m_s": 3, "turns": 50}


@dataclass
class Side:
    """What was seen of the flight with the flood, or of the flight without."""

    spans: list[tuple[float, float]] = field(default_factory=list)
    waits_s: list[float] = field(default_factory=list)
    offered: int = 0
    answered: int = 0
    cpu_s: float = 0.0
    memory_kb: int = 0
    descriptors: int = 0

    @property
    def seconds(self) -> float:
        return sum(end_s - begin_s for begin_s, end_s in self.spans)


@asynccontextmanager
async def metered_daemon(tmp_path: Path, port: int) -> AsyncIterator[Child]:
    path, log_file = tmp_path / "s", tmp_path / "flightd.log"
    command = [str(SUPPORT / "metered_daemon.py"), f"udpin://127.0.0.1:{port}", str(path), str(tmp_path / "ticks")]
    with log_file.open("wb") as log:
        process = await asyncio.create_subprocess_exec(sys.executable, *command, stdout=log, stderr=log)
    child = Child(process, log_file, path)
    async with running(child):
        await answers(child)
        yield child


async def phase(daemon: Child, flight: FlightClient, side: Side, *, flood: bool) -> None:
    """Fly on for a while; a modest client asks now and then how things are."""
    assert daemon.socket is not None
    pid = daemon.process.pid
    cpu_s, begin_s, descriptors = cpu_of(pid), time.monotonic(), descriptors_of(pid)
    flooding = None
    if flood:
        command = [str(SUPPORT / "request_flood.py"), str(daemon.socket), str(RATE_HZ), str(PHASE_S)]
        flooding = await asyncio.create_subprocess_exec(sys.executable, *command, stdout=asyncio.subprocess.PIPE)
    try:
        while (asked_s := time.monotonic()) < begin_s + PHASE_S:
            still_flying((await flight.status())["state"], daemon)
            side.waits_s.append(time.monotonic() - asked_s)
            await asyncio.sleep(ASK_S)
    except BaseException:
        if flooding is not None:
            flooding.kill()
        raise
    side.spans.append((begin_s, time.monotonic()))
    side.cpu_s += cpu_of(pid) - cpu_s
    side.memory_kb = memory_kb_of(pid)
    if flooding is not None:
        offered, taken, answered = json.loads((await flooding.communicate())[0])
        assert 0 < answered <= taken <= offered
        side.offered, side.answered = side.offered + offered, side.answered + answered
        await given_back(pid, descriptors)
    side.descriptors = descriptors_of(pid)


async def given_back(pid: int, descriptors: int) -> None:
    """What the flood has sent is still done for a while after it was ended."""
    for _ in range(100):
        if descriptors_of(pid) <= descriptors:
            return
        await asyncio.sleep(0.1)


def still_flying(state: str, daemon: Child) -> None:
    """A machine that stands still for a second in a short run is no fault of the flood's."""
    if state != "tracking":
        said = daemon.log_file.read_text()
        if "dead_man" in said and not LONG:
            raise StoodStillError
        raise AssertionError(said)


def cpu_of(pid: int) -> float:
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def memory_kb_of(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def descriptors_of(pid: int) -> int:
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def figures(side: Side, ticks: list[tuple[float, float | None, int, int]]) -> dict[str, float]:
    """The rows of the table, of one side."""
    errors, periods, late, missed = [], [], 0, 0
    for begin_s, end_s in side.spans:
        of_span = [tick for tick in ticks if begin_s <= tick[0] <= end_s]
        errors += [tick[1] for tick in of_span if tick[1] is not None]
        periods += [1e3 * (after[0] - tick[0]) for tick, after in pairwise(of_span)]
        late += of_span[-1][2] - of_span[0][2]
        missed += of_span[-1][3] - of_span[0][3]
    deviations = [abs(period - 10.0) for period in periods]
    return {
        "tracking error, rms, mm": 1e3 * sqrt(sum(error * error for error in errors) / len(errors)),
        "tracking error, largest, mm": 1e3 * max(errors),
        "ticks": len(periods),
        "late by more than 1 ms, %": 100.0 * late / len(periods),
        "missed": missed,
        "period p50, ms": quantile(periods, 0.5),
        "period p99, ms": quantile(periods, 0.99),
        "period, largest, ms": max(periods),
        "deviation of the period p50, ms": quantile(deviations, 0.5),
        "deviation of the period p99, ms": quantile(deviations, 0.99),
        "requests offered, 1/s": side.offered / side.seconds,
        "requests answered, 1/s": side.answered / side.seconds,
        "another client's wait p50, ms": 1e3 * quantile(side.waits_s, 0.5),
        "another client's wait p99, ms": 1e3 * quantile(side.waits_s, 0.99),
        "CPU, % of a core": 100.0 * side.cpu_s / side.seconds,
        "memory at the end, MB": side.memory_kb / 1024,
        "descriptors at the end": side.descriptors,
    }


async def fly_flooded(tmp_path: Path) -> None:
    port = free_udp_port()
    quiet, flooded = Side(), Side()
    sim = await start(tmp_path, "sim", "sim", "--port", str(port))
    async with running(sim), metered_daemon(tmp_path, port) as daemon, FlightClient(daemon.socket) as flight:
        await until(flight, lambda status: status["state"] == "standby" and status["vehicle"] is not None)
        await asyncio.sleep(1.0)  # its global position comes in a message of its own
        await flight.takeoff(5.0)
        goal = await flight.fly(FLOWN)
        await asyncio.sleep(2.0)
        for side, flood in ((quiet, False), (flooded, True)) * 2:
            await phase(daemon, flight, side, flood=flood)
        assert not goal.done
        assert flooded.descriptors == quiet.descriptors, "each of the flood's was given back"
        await flight.hold()
        await daemon.stop()
    ticks = json.loads((tmp_path / "ticks").read_text())
    sides = [figures(side, ticks) for side in (quiet, flooded)]
    print(f"\n| {PHASE_S:g} s of each, twice, in turn | quiet | flooded |\n| --- | --- | --- |")
    for name in sides[0]:
        print(f"| {name} | {sides[0][name]:.2f} | {sides[1][name]:.2f} |")


async def test_flood_of_requests_leaves_the_flight_as_it_was(tmp_path: Path) -> None:
    await where_it_runs(fly_flooded, tmp_path)
