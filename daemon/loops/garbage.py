"""Garbage collection at moments of our own choosing: right after a control tick, when there is time until the next."""

import asyncio
import gc
from dataclasses import dataclass
from time import perf_counter, thread_time

from daemon.loops.grid import Grid
from daemon.pipeline import Inputs, Record

PERIODS_S = (1.0, 10.0, 60.0)  # of the three generations
LEAST_SLACK_S = 0.002
PATIENCE = 9.0  # periods that a collection waits for a moment long enough, for memory is bounded too


@dataclass(frozen=True, slots=True)
class GarbageReport:
    """Collections since the start, and the longest pause that one made."""

    collections: int
    longest_s: float


class Garbage:
    """A watcher of the control task, the last of them. Between ``start`` and ``stop`` nothing else collects.

    What is alive at the start is looked at no more. A collection waits while the tick was late, or while the last one
    of its generation took longer than there is time, at most ``PATIENCE`` periods.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._due_s = [0.0, 0.0, 0.0]
        self._took_s = [0.0, 0.0, 0.0]
        self._collections = 0
        self._longest_s = 0.0

    @property
    def report(self) -> GarbageReport:
        """Figures of now."""
        return GarbageReport(self._collections, self._longest_s)

    def start(self) -> None:
        """Collect all, and from now on only from ``on_tick``."""
        gc.collect()
        gc.freeze()
        gc.disable()
        now_s = asyncio.get_running_loop().time()
        self._due_s = [now_s + period_s for period_s in PERIODS_S]

    def stop(self) -> None:
        """Leave it to Python again."""
        gc.enable()
        gc.unfreeze()

    def on_tick(self, _inputs: Inputs, record: Record) -> None:
        """Collect the oldest generation that is due, if there is time."""
        now_s = record.now_s
        if now_s < min(self._due_s):
            return
        slack_s = self._grid.due_s - asyncio.get_running_loop().time()
        for generation in (2, 1, 0):
            overdue_s = now_s - self._due_s[generation]
            fits = slack_s >= max(LEAST_SLACK_S, self._took_s[generation])
            if overdue_s >= (0.0 if fits else PATIENCE * PERIODS_S[generation]):
                self._collect(generation, now_s)
                return

    def _collect(self, oldest: int, now_s: float) -> None:
        begun_s, used_s = perf_counter(), thread_time()
        gc.collect(oldest)
        self._took_s[oldest] = thread_time() - used_s  # not what others took meanwhile: it would not fit again for long
        self._collections += 1
        self._longest_s = max(self._longest_s, perf_counter() - begun_s)
        for generation in range(oldest + 1):
            self._due_s[generation] = now_s + PERIODS_S[generation]
