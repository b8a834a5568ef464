"""Garbage is collected right after control ticks only: in time, when there is time, and in the end in any case."""

import gc
import weakref
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.loops.garbage import LEAST_SLACK_S, PATIENCE, PERIODS_S, Garbage
from daemon.sim.virtual_time import run_virtual


class Cycle:
    """Something that only the collector can free."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    yield
    gc.enable()
    gc.unfreeze()


def started(scenario: Callable[[Garbage, Callable[[float, float], None]], None]) -> None:
    """Run a scenario with a collector that has started at 0 s, and a ``tick(now_s, slack_s)``."""

    async def main() -> None:
        grid: Any = SimpleNamespace(due_s=0.0)
        garbage = Garbage(grid)
        garbage.start()

        def tick(now_s: float, slack_s: float) -> None:
            grid.due_s = slack_s  # the loop's clock stands at 0
            garbage.on_tick(None, SimpleNamespace(now_s=now_s))  # type: ignore[arg-type]

        scenario(garbage, tick)
        garbage.stop()

    run_virtual(main())


def forgotten_cycle() -> weakref.ref[Cycle]:
    return weakref.ref(Cycle())


def test_nothing_else_collects_until_it_is_stopped() -> None:
    def scenario(_garbage: Garbage, _tick: Callable[[float, float], None]) -> None:
        cycle = forgotten_cycle()
        kept = [[] for _ in range(20_000)]
        assert len(kept) == 20_000
        assert cycle() is not None
        assert gc.get_freeze_count() > 10_000

    started(scenario)
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_cycle_goes_with_the_first_tick_after_a_period() -> None:
    def scenario(garbage: Garbage, tick: Callable[[float, float], None]) -> None:
        cycle = forgotten_cycle()
        tick(PERIODS_S[0] - 0.01, 0.009)
        assert cycle() is not None
        assert garbage.report.collections == 0
        tick(PERIODS_S[0], 0.009)
        assert cycle() is None
        assert garbage.report.collections == 1
        assert garbage.report.longest_s > 0.0
        tick(PERIODS_S[0] + 0.01, 0.009)
        assert garbage.report.collections == 1

    started(scenario)


def test_a_cycle_that_lived_long_goes_with_its_generation() -> None:
    def scenario(_garbage: Garbage, tick: Callable[[float, float], None]) -> None:
        cycle = Cycle()
        watched = weakref.ref(cycle)
        tick(PERIODS_S[0], 0.009)
        tick(PERIODS_S[1], 0.009)  # now it is of the oldest generation
        del cycle
        tick(PERIODS_S[1] + PERIODS_S[0], 0.009)
        assert watched() is not None
        tick(PERIODS_S[2], 0.009)
        assert watched() is None

    started(scenario)


def test_a_late_tick_is_not_made_later_unless_that_goes_on_for_too_long() -> None:
    def scenario(garbage: Garbage, tick: Callable[[float, float], None]) -> None:
        cycle = forgotten_cycle()
        tick(PERIODS_S[0] + 0.5, 0.9 * LEAST_SLACK_S)
        assert cycle() is not None
        tick(PERIODS_S[0] * (1.0 + PATIENCE) - 0.01, 0.9 * LEAST_SLACK_S)
        assert cycle() is not None
        tick(PERIODS_S[0] * (1.0 + PATIENCE), 0.9 * LEAST_SLACK_S)
        assert cycle() is None
        assert garbage.report.collections == 1

    started(scenario)


def test_a_collection_that_took_long_waits_for_a_moment_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    used, clock = iter([0.0, 0.006, 1.0, 1.001]), iter([0.0, 0.02, 1.0, 1.001])  # 14 ms of it were others'
    monkeypatch.setattr("daemon.loops.garbage.thread_time", lambda: next(used))
    monkeypatch.setattr("daemon.loops.garbage.perf_counter", lambda: next(clock))

    def scenario(garbage: Garbage, tick: Callable[[float, float], None]) -> None:
        tick(1.0, 0.009)
        assert garbage.report.longest_s == pytest.approx(0.02)
        tick(2.0, 0.005)
        assert garbage.report.collections == 1
        tick(2.01, 0.007)
        assert garbage.report.collections == 2

    started(scenario)
