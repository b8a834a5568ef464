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
from daemon.bench.memory import peak_mb
from daemon.bench.meter import Meter
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record
from daemon.safety.supervisor import State

_CONNECT_S = 20.0
_REPLAYED = 500


class Flight:
    """Engages, lets a meter listen for ``seconds`` when it has flown ``warm_up_s``, then ends the daemon."""

    def __init__(self, vehicle: Vehicle, warm_up_s: float, seconds: float) -> None:
        self._vehicle = vehicle
        self._warm_up_s = warm_up_s
        self._seconds = seconds
        self._ticks: list[tuple[Inputs, float, float]] = []
        self.task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        try:
            self._say(await self._flown())
        except Exception as error:  # noqa: BLE001 - whatever it is, the daemon stops and the parent reads why
            self._say({"error": f"{type(error).__name__}: {error}"})
        os.kill(os.getpid(), signal.SIGTERM)

    async def _flown(self) -> dict[str, Any]:
        control, commander = self._vehicle.control, self._vehicle.commander
        await commander.wait_for(lambda: _ready(self._vehicle), _CONNECT_S, "connected")
        await commander.engage()
        await asyncio.sleep(self._warm_up_s)
        meter = Meter(control.grid, lambda: control.step_s, self._seconds)
        gc.callbacks.append(meter.on_collection)
        control.listeners.append(meter.on_tick)
        before, begun_s = resource.getrusage(resource.RUSAGE_SELF), time.monotonic()
        meter.look_at_memory()
        while (left_s := begun_s + self._seconds - time.monotonic()) > 0.0:
            await asyncio.sleep(min(1.0, left_s))
            meter.look_at_memory()
        ended_s, after = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
        control.listeners.remove(meter.on_tick)
        gc.callbacks.remove(meter.on_collection)
        peak, stages_us = peak_mb(), await self._stages_us()
        return meter.report() | {
            "from_s": begun_s,
            "to_s": ended_s,
            "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            "rss_mb": peak,
            "stages_us": stages_us,
        }

    async def _stages_us(self) -> dict[str, float]:
        """What the stages cost on the inputs of a while of flight, in one go after it."""
        from daemon.bench.stages import stage_costs_us

        control = self._vehicle.control
        state = control.state
        control.listeners.append(self._keep)
        await asyncio.sleep(_REPLAYED * control.grid.period_s)
        control.listeners.remove(self._keep)
        return stage_costs_us(state, self._ticks)

    def _keep(self, inputs: Inputs, record: Record) -> None:
        self._ticks.append((inputs, record.now_s, record.dt_s))

    def _say(self, figures: dict[str, Any]) -> None:
        sys.stdout.write("\n" + json.dumps(figures) + "\n")
        sys.stdout.flush()


def _ready(vehicle: Vehicle) -> bool:
    record = vehicle.record.value
    return vehicle.commander.state is State.PILOT and record is not None and record.estimate.newest is not None


def main() -> None:
    """``python -m daemon.bench.loop_daemon PORT SECONDS WARM_UP SOCKET RATE_HZ RECORD LOOPS``.

    RECORD: a folder, or empty. LOOPS: settings of that section, as JSON.
    """
    port, seconds, warm_up_s, path, rate_hz, folder, more = sys.argv[1:8]
    flights: list[Flight] = []
    recording = {"enabled": bool(folder), "when": "always", **({"directory": folder} if folder else {})}
    code = app.run(
        [],
        f"udpin://127.0.0.1:{port}",
        Path(path),
        watch=lambda vehicle: flights.append(Flight(vehicle, float(warm_up_s), float(seconds))),
        loops={"control_rate_hz": float(rate_hz), **json.loads(more)},
        recording=recording,
        log={"level": "error"},
    )
    sys.exit(code)


if __name__ == "__main__":
    main()
