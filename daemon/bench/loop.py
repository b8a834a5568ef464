"""The loop in real time: the daemon, whole, over real MAVSDK and UDP against the simulated PX4."""

import asyncio
import contextlib
import socket
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.config import load
from daemon.guidance.goals import ShapeGoal
from daemon.guidance.shapes import Lemniscate
from daemon.loops.goal_order import GoalOrder
from daemon.loops.grid import live_alarm
from daemon.loops.vehicle import Vehicle
from daemon.parameters import dead_man_timing
from daemon.pipeline import Inputs, Record
from daemon.safety.dead_man import DeadMan
from daemon.safety.supervisor import State
from daemon.settings import Config

START_S = 30.0
SETTLE_S = 3.0


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """Milliseconds unless the name says otherwise. ``age`` is that of the state at the moment of sending."""

    seconds: float
    ticks: int
    late: int
    missed: int
    period_p50_ms: float
    period_p99_ms: float
    period_max_ms: float
    step_p50_us: float
    step_p99_us: float
    age_p50_ms: float
    age_p99_ms: float
    cpu_percent: float


class _Meter:
    """A listener of the control task while the vehicle is flown."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.periods_s: list[float] = []
        self.steps_s: list[float] = []
        self.ages_s: list[float] = []
        self._vehicle = vehicle
        self._loop = asyncio.get_running_loop()

    def on_tick(self, _inputs: Inputs, record: Record) -> None:
        self.periods_s.append(record.dt_s)
        self.steps_s.append(self._vehicle.control.step_s)
        if record.estimate.newest is not None:
            self.ages_s.append(self._loop.time() - record.estimate.newest.time_s)


async def measure(seconds: float, config: Config | None = None) -> LoopFigures:
    """Fly a lemniscate for ``seconds`` and return the loop's figures."""
    async with _simulator() as port:
        loop = asyncio.get_running_loop()
        config = config or load([])
        link = MavsdkLink(f"udpin://127.0.0.1:{port}", link_timeout_s=config.link.lost_s)
        vehicle = Vehicle(config, link, lambda: live_alarm(loop))
        dead_man = DeadMan(vehicle.gate, dead_man_timing(config))
        tasks = asyncio.ensure_future(vehicle.run())
        dead_man.start()
        try:
            return await _flown(vehicle, seconds)
        finally:
            dead_man.stop()
            tasks.cancel()
            await asyncio.gather(tasks, return_exceptions=True)


async def _flown(vehicle: Vehicle, seconds: float) -> LoopFigures:
    commander = vehicle.commander
    await commander.wait_for(lambda: commander.state is State.STANDBY and _estimated(vehicle), START_S, "connected")
    await commander.takeoff(5.0)
    await commander.engage()
    shape = ShapeGoal(
        shape=Lemniscate(center_ned_m=(0.0, 0.0, -5.0), size_m=(8.0, 4.0)), speed_m_s=3.0, turns=1 + seconds / 10.0
    )
    order = GoalOrder(goal_id="bench", kind="trajectory", goal=shape, limits=vehicle.parameters.value.limits)
    vehicle.trajectory.submit(order)
    await asyncio.sleep(SETTLE_S)
    meter = _Meter(vehicle)
    before = vehicle.control.grid.statistics.report()
    cpu_s, wall_s = time.process_time(), time.monotonic()
    vehicle.control.listeners.append(meter.on_tick)
    await asyncio.sleep(seconds)
    vehicle.control.listeners.remove(meter.on_tick)
    cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
    after = vehicle.control.grid.statistics.report()
    await commander.hold()
    return LoopFigures(
        seconds=round(wall_s, 2),
        ticks=after.ticks - before.ticks,
        late=after.late - before.late,
        missed=after.missed - before.missed,
        period_p50_ms=1e3 * quantile(meter.periods_s, 0.5),
        period_p99_ms=1e3 * quantile(meter.periods_s, 0.99),
        period_max_ms=1e3 * max(meter.periods_s),
        step_p50_us=1e6 * quantile(meter.steps_s, 0.5),
        step_p99_us=1e6 * quantile(meter.steps_s, 0.99),
        age_p50_ms=1e3 * quantile(meter.ages_s, 0.5),
        age_p99_ms=1e3 * quantile(meter.ages_s, 0.99),
        cpu_percent=100.0 * cpu_s / wall_s,
    )


def _estimated(vehicle: Vehicle) -> bool:
    record = vehicle.record.value
    return record is not None and record.estimate.newest is not None


def quantile(values: list[float], share: float) -> float:
    """The value below which a share of the values lies (nearest rank)."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, round(share * (len(ordered) - 1)))]


def as_dict(figures: LoopFigures) -> dict[str, Any]:
    """The figures as JSON has them."""
    return {name: round(value, 3) for name, value in asdict(figures).items()}


@contextlib.asynccontextmanager
async def _simulator() -> AsyncIterator[int]:
    """``flightd sim`` in a process of its own; its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "sim.log").open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "daemon.cli.main", "sim", "--port", str(port), stdout=log, stderr=log
        )
        try:
            yield port
        finally:
            process.terminate()
            await process.wait()
