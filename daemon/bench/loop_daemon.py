"""The daemon, whole, as `flightd run` starts it, with a meter in it: engages, is measured, says what it saw, stops."""

import asyncio
import gc
import json
import os
import resource
import signal
import sys
import time
from pathlib import Path
from typing import Any

from daemon import app
from daemon.bench.quantiles import quantile
from daemon.bench.stages import stage_costs_us
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record
from daemon.safety.supervisor import State

WARM_UP_S = 2.0
_CONNECT_S = 20.0
_REPLAYED = 500


class Meter:
    """Listens to the control task from engaged and warm on, for ``seconds``."""

    def __init__(self, vehicle: Vehicle, seconds: float) -> None:
        self._vehicle = vehicle
        self._seconds = seconds
        self._used: list[tuple[float, int]] = []
        self._steps_s: list[float] = []
        self._ticks: list[tuple[Inputs, float, float]] = []
        self._collections_s: list[tuple[int, float]] = []
        self._collecting_s = 0.0
        self._rss_mb: list[float] = []
        self.task = asyncio.get_running_loop().create_task(self._run())

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """Note which sample was used when; the last ticks are kept for the stages."""
        if inputs.odometry is not None:
            self._used.append((record.now_s, round(inputs.odometry.position_m[0] * 1e6)))
        self._steps_s.append(self._vehicle.control.step_s)

    def on_collection(self, phase: str, info: dict[str, int]) -> None:
        """Note a collection of garbage."""
        if phase == "start":
            self._collecting_s = time.monotonic()
        else:
            self._collections_s.append((info["generation"], time.monotonic() - self._collecting_s))

    async def _run(self) -> None:
        try:
            await self._flight()
        except Exception as error:  # noqa: BLE001 - whatever it is, the daemon stops and the parent reads why
            self._say({"error": f"{type(error).__name__}: {error}"})
        os.kill(os.getpid(), signal.SIGTERM)

    async def _flight(self) -> None:
        vehicle = self._vehicle
        commander = vehicle.commander
        await commander.wait_for(lambda: _ready(vehicle), _CONNECT_S, "connected")
        await commander.engage()
        await asyncio.sleep(WARM_UP_S)
        gc.callbacks.append(self.on_collection)
        before = vehicle.control.grid.statistics.report()
        used, begun_s = resource.getrusage(resource.RUSAGE_SELF), time.monotonic()
        vehicle.control.listeners.append(self.on_tick)
        while (left_s := begun_s + self._seconds - time.monotonic()) > 0.0:
            self._rss_mb.append(_rss_mb())
            await asyncio.sleep(min(1.0, left_s))
        vehicle.control.listeners.remove(self.on_tick)
        ended_s, usage = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
        after = vehicle.control.grid.statistics.report()
        gc.callbacks.remove(self.on_collection)
        state = vehicle.control.state
        vehicle.control.listeners.append(self._keep)
        await asyncio.sleep(_REPLAYED * vehicle.control.grid.period_s)
        vehicle.control.listeners.remove(self._keep)
        self._say(
            {
                "from_s": begun_s,
                "to_s": ended_s,
                "cpu_s": usage.ru_utime + usage.ru_stime - used.ru_utime - used.ru_stime,
                "rss_mb": usage.ru_maxrss / 1024.0,
                "rss_first_mb": self._rss_mb[0],
                "rss_last_mb": self._rss_mb[-1],
                "late": after.late - before.late,
                "missed": after.missed - before.missed,
                "step_p50_us": 1e6 * quantile(self._steps_s, 0.5),
                "step_p99_us": 1e6 * quantile(self._steps_s, 0.99),
                "collections": len(self._collections_s),
                "collection_max_ms": 1e3 * max((s for _, s in self._collections_s), default=0.0),
                "used": self._used,
                "stages_us": stage_costs_us(state, self._ticks),
            }
        )

    def _keep(self, inputs: Inputs, record: Record) -> None:
        self._ticks.append((inputs, record.now_s, record.dt_s))

    def _say(self, figures: dict[str, Any]) -> None:
        sys.stdout.write("\n" + json.dumps(figures) + "\n")
        sys.stdout.flush()


def _ready(vehicle: Vehicle) -> bool:
    record = vehicle.record.value
    return vehicle.commander.state is State.PILOT and record is not None and record.estimate.newest is not None


def _rss_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """``python -m daemon.bench.loop_daemon PORT SECONDS SOCKET RATE_HZ RECORD``; RECORD: a folder, empty for none."""
    port, seconds, path, rate_hz, folder = sys.argv[1:6]
    meters: list[Meter] = []
    recording = {"enabled": bool(folder), "when": "always", **({"directory": folder} if folder else {})}
    code = app.run(
        [],
        f"udpin://127.0.0.1:{port}",
        Path(path),
        watch=lambda vehicle: meters.append(Meter(vehicle, float(seconds))),
        loops={"control_rate_hz": float(rate_hz)},
        recording=recording,
        log={"level": "error"},
    )
    sys.exit(code)


if __name__ == "__main__":
    main()
