"""From ``goal.submit`` on the socket to the first setpoint that flies the goal, the daemon in a process of its own.

The client notes when it wrote the request, the daemon when the tick that first flew the goal had sent its setpoint;
both on CLOCK_MONOTONIC. Goals come as fast as they are answered, so each preempts the one before it.
"""

import asyncio
import json
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from daemon import app
from daemon.bench.loop import free_port, process
from daemon.bench.loop_figures import Figures
from daemon.bench.quantiles import quantile
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record

_START_S = 30.0
_RESULTS_S = 10.0


async def measure(count: int) -> Figures:
    """Submit ``count`` goals and return delays in milliseconds, goals a second, and results by outcome."""
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), free_port()
        path = folder / "flightd.sock"
        metronome = [sys.executable, "-m", "daemon.sim.metronome", str(port), "100", "0"]
        daemon = [sys.executable, "-m", "daemon.bench.goals", str(port), str(path), str(folder / "flown.json")]
        async with process(metronome), process(daemon, folder / "said") as running:
            async with await _connected(path) as flight:
                submitted, outcomes, took_s = await _submit(flight, count)
            running.terminate()
            await running.wait()
        flown: dict[str, float] = json.loads((folder / "flown.json").read_text())
    delays = [1e3 * (flown[goal_id] - at_s) for goal_id, at_s in submitted.items() if goal_id in flown]
    return {
        "goals": count,
        "goals_per_s": count / took_s,
        "flown": len(delays),
        "delay_p50_ms": quantile(delays, 0.5),
        "delay_p99_ms": quantile(delays, 0.99),
        "outcomes": outcomes,
    }


async def _connected(path: Path) -> FlightClient:
    async with asyncio.timeout(_START_S):
        while True:
            with suppress(FlightError, OSError):
                async with FlightClient(path, reconnect_s=0.0) as flight:
                    await flight.engage()
                    return FlightClient(path)
            await asyncio.sleep(0.1)


async def _submit(flight: FlightClient, count: int) -> tuple[dict[str, float], dict[str, int], float]:
    submitted: dict[str, float] = {}
    goals = []
    begun_s = time.monotonic()
    for i in range(count):
        at_s = time.monotonic()
        goal = await flight.goto(3.0 + i % 5, -2.0 + i % 3, -5.0)
        submitted[goal.goal_id] = at_s
        goals.append(goal)
    took_s = time.monotonic() - begun_s
    await goals[-1].cancel()
    outcomes: dict[str, int] = {}
    async with asyncio.timeout(_RESULTS_S):
        for goal in goals:
            outcome = (await goal).outcome
            outcomes[outcome] = outcomes.get(outcome, 0) + 1
    return submitted, outcomes, took_s


class _Meter:
    """Notes when the first setpoint of each goal had been sent."""

    def __init__(self) -> None:
        self.flown: dict[str, float] = {}

    def watch(self, vehicle: Vehicle) -> None:
        vehicle.control.listeners.append(self.on_tick)

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        goal_id = inputs.window.goal_id if inputs.window is not None else None
        if goal_id is not None and record.setpoint is not None and goal_id not in self.flown:
            self.flown[goal_id] = time.monotonic()


def main() -> None:
    """``python -m daemon.bench.goals PORT SOCKET OUT``: the daemon with the meter in it."""
    port, path, out = sys.argv[1:4]
    meter = _Meter()
    code = app.run(
        [],
        f"udpin://127.0.0.1:{port}",
        Path(path),
        watch=meter.watch,
        recording={"enabled": False},
        log={"level": "error"},
    )
    Path(out).write_text(json.dumps(meter.flown))
    sys.exit(code)


if __name__ == "__main__":
    main()
