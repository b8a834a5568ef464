"""The meter in the daemon: missed ticks beside collections of garbage, in room that does not grow."""

from types import SimpleNamespace
from typing import Any

import pytest

from daemon.bench.meter import Meter
from daemon.loops.grid import Grid, LoopAlarm


class Rig:
    """A meter whose grid is advanced by hand, 10 ms a tick."""

    def __init__(self, seconds: float = 1.0) -> None:
        self.grid = Grid(0.01, LoopAlarm(None))  # type: ignore[arg-type]
        self.grid.statistics.missed = 7  # of before
        self.step_s = 0.0
        self.meter = Meter(self.grid, lambda: self.step_s, seconds)
        self.now_s = 0.0

    def tick(self, number: int = 0, *, missed: int = 0, step_s: float = 1e-4) -> None:
        self.now_s += 0.01 * (1 + missed)
        self.grid.statistics.missed += missed
        self.grid.statistics.late += missed > 0
        self.step_s = step_s
        odometry: Any = SimpleNamespace(
            odometry=SimpleNamespace(position_m=(number * 1e-6, 0.0, 0.0), arrival_s=self.now_s - 1e-3)
        )
        record: Any = SimpleNamespace(now_s=self.now_s)
        self.meter.on_tick(odometry, record)

    def collect(self, generation: int = 0) -> None:
        for phase in ("start", "stop"):
            self.meter.on_collection(phase, {"generation": generation})


def test_a_tick_that_was_missed_after_a_collection_is_told_from_one_that_was_not() -> None:
    rig = Rig()
    rig.tick()
    rig.tick(missed=2)
    rig.collect()
    rig.tick()
    rig.tick(missed=1)  # the collection was over by the tick before
    rig.collect(2)
    rig.tick(missed=3)
    report = rig.meter.report()
    assert (report["late"], report["missed"], report["missed_collecting"]) == (3, 6, 3)
    assert report["collections"] == {"generation 0": 1, "generation 1": 0, "generation 2": 1}
    assert 0.0 < report["collection_max_ms"] < 1e3


def test_it_tells_which_sample_was_used_when_and_what_the_steps_cost() -> None:
    rig = Rig()
    for number in (4095, 0, 1):
        rig.tick(number, step_s=(number + 1) * 1e-6)
    report = rig.meter.report()
    expected = [(0.01, 4095, 0.009), (0.02, 0, 0.019), (0.03, 1, 0.029)]
    assert [pytest.approx(entry) for entry in expected] == report["used"]
    assert (report["step_p50_us"], report["step_p99_us"]) == pytest.approx((2.0, 4096.0))


def test_more_ticks_than_there_is_room_for_are_left_out() -> None:
    rig = Rig(seconds=0.01)
    for number in range(500):
        rig.tick(number)
    used = rig.meter.report()["used"]
    assert 1 < len(used) < 500
    assert used[-1][1] == len(used) - 1


def test_memory_is_what_the_system_says() -> None:
    rig = Rig()
    rig.meter.look_at_memory()
    ballast = bytearray(b"x" * 50_000_000)
    rig.meter.look_at_memory()
    (before_s, before_mb), (after_s, after_mb) = rig.meter.report()["memory"]
    assert after_s >= before_s
    assert after_mb - before_mb == pytest.approx(len(ballast) / 2**20, abs=5.0)
