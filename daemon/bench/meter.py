"""A meter in the daemon: ticks, collections of garbage and memory of a flight. What it imports weighs on the daemon."""

import time
from array import array
from collections.abc import Callable
from typing import Any

from daemon.bench.memory import now_mb
from daemon.bench.quantiles import quantile
from daemon.loops.grid import Grid
from daemon.pipeline import Inputs, Record

_SPARE = 1.02  # a grid may slew by 1 % of a period a tick


class Meter:
    """A listener of the control task and of the collector.

    All room is taken at the beginning, in arrays: what it measures must neither grow by it nor be collected more often.
    ``step_s`` tells what the step of this tick cost.
    """

    def __init__(self, grid: Grid, step_s: Callable[[], float], seconds: float) -> None:
        room = int(_SPARE * seconds / grid.period_s) + 100
        self._grid = grid
        self._step_s = step_s
        self._ticks = 0
        self._at_s = array("d", bytes(8 * room))
        self._arrivals_s = array("d", bytes(8 * room))
        self._steps_s = array("d", bytes(8 * room))
        self._numbers = array("H", bytes(2 * room))
        self._late_before = self._late = grid.statistics.late
        self._missed_before = self._missed = grid.statistics.missed
        self._missed_collecting = 0
        self._collected = False
        self._collections = [0, 0, 0]
        self._collecting_s = 0.0
        self._pause_max_s = 0.0
        self._memory: list[tuple[float, float]] = []

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """Note which sample was used when, and whether a collection fell between the last tick and a late one."""
        tick, missed = self._ticks, self._grid.statistics.missed
        self._late = self._grid.statistics.late
        if inputs.odometry is not None and tick < len(self._at_s):
            self._at_s[tick] = record.now_s
            self._numbers[tick] = round(inputs.odometry.position_m[0] * 1e6)
            self._arrivals_s[tick] = inputs.odometry.arrival_s
            self._steps_s[tick] = self._step_s()
            self._ticks = tick + 1
        if self._collected:
            self._missed_collecting += missed - self._missed
            self._collected = False
        self._missed = missed

    def on_collection(self, phase: str, info: dict[str, int]) -> None:
        """Note a collection of garbage, as ``gc.callbacks`` tells it."""
        if phase == "start":
            self._collecting_s = time.monotonic()
            return
        self._collected = True
        self._collections[info["generation"]] += 1
        self._pause_max_s = max(self._pause_max_s, time.monotonic() - self._collecting_s)

    def look_at_memory(self) -> None:
        """Note how much there is now."""
        self._memory.append((time.monotonic(), now_mb()))

    def report(self) -> dict[str, Any]:
        """The figures up to the newest tick; it takes a while after a long flight.

        ``used``: when each tick was, number and arrival of its sample; ``memory``: when there was how much;
        ``missed_collecting``: missed ticks before which there was a collection.
        """
        steps_s = self._steps_s[: self._ticks]
        columns = (column[: self._ticks] for column in (self._at_s, self._numbers, self._arrivals_s))
        return {
            "used": list(zip(*columns, strict=True)),
            "memory": self._memory,
            "late": self._late - self._late_before,
            "missed": self._missed - self._missed_before,
            "missed_collecting": self._missed_collecting,
            "step_p50_us": 1e6 * quantile(steps_s, 0.5),
            "step_p99_us": 1e6 * quantile(steps_s, 0.99),
            "collections": {f"generation {i}": count for i, count in enumerate(self._collections)},
            "collection_max_ms": 1e3 * self._pause_max_s,
        }
