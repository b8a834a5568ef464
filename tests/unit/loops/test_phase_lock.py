"""The grid's phase against telemetry: ticks settle just after regular arrivals, and ignore irregular ones."""

import asyncio
from collections.abc import Callable
from random import Random
from unittest.mock import Mock

import pytest

from daemon.latest import Latest
from daemon.loops.grid import MAX_SLEW, Grid, LoopAlarm
from daemon.loops.phase_lock import MARGIN_S, PhaseLock
from daemon.messages import Odometry
from daemon.sim.virtual_time import run_virtual


class Silent:
    """An alarm that never rings."""

    def set(self, when_s: float, callback: Callable[[], None]) -> None:
        pass

    def close(self) -> None:
        pass


def ages_s(period_s: float, arrival_s: Callable[[int], float], ticks: int = 3000) -> list[float]:
    """Ages of the new samples at the ticks of a grid that obeys the lock, as the grid bounds it."""
    lock, now_s, sample, found = PhaseLock(Grid(period_s, Silent()), Latest(None)), 1.0, 0, []
    for _ in range(ticks):
        newest = sample
        while arrival_s(newest + 1) <= now_s:
            newest += 1
        slew_s = 0.0
        if newest != sample:
            sample = newest
            found.append(now_s - arrival_s(sample))
            slew_s = lock.slew_s(found[-1])
        limit_s = MAX_SLEW * period_s
        now_s += period_s + min(limit_s, max(-limit_s, slew_s))
    return found


@pytest.mark.parametrize("offset_s", [0.0, 0.0013, 0.0049, 0.0051, 0.0098])
def test_ticks_settle_just_after_the_arrivals_of_a_regular_stream(offset_s: float) -> None:
    late = ages_s(0.01, lambda n: offset_s + 0.01 * n)[-500:]
    assert late == pytest.approx([MARGIN_S] * 500, abs=2e-5)


def test_a_clock_that_drifts_by_five_in_a_thousand_is_followed() -> None:
    late = ages_s(0.01, lambda n: 0.01005 * n)[-500:]
    assert late == pytest.approx([MARGIN_S] * 500, abs=1e-4)


def test_an_uneven_stream_is_left_alone() -> None:
    lock = PhaseLock(Grid(0.01, Silent()), Latest(None))
    slews = [lock.slew_s((0.003, 0.007, 0.001, 0.009, 0.005)[n % 5]) for n in range(500)]
    assert slews[20:] == [0.0] * 480


def test_half_the_rate_of_the_stream_locks_as_well() -> None:
    late = ages_s(0.02, lambda n: 0.0042 + 0.01 * n)[-300:]
    assert late == pytest.approx([MARGIN_S] * 300, abs=5e-5)


def test_a_sample_counts_once_at_the_tick_that_saw_it_first() -> None:
    grid = Grid(0.01, Silent())
    lock = PhaseLock(grid, Latest(None))
    inputs, record = Mock(), Mock(now_s=1.004)
    for _ in range(100):
        inputs.odometry = Mock(arrival_s=1.0)
        lock.on_tick(inputs, record)
    assert grid.slew_s < 0.0  # 4 ms old: the ticks come earlier
    grid.slew_s = 0.0
    lock.on_tick(inputs, record)
    assert grid.slew_s == 0.0


async def ticks_with(late_s: Callable[[int], float | None], samples: int = 2000) -> list[tuple[float, float]]:
    """Flies a grid with its lock on samples that are late by ``late_s`` (None: lost); (age, dt) of each tick."""
    loop = asyncio.get_running_loop()
    cell: Latest[Odometry | None] = Latest(None)
    grid = Grid(0.01, LoopAlarm(loop))
    lock = PhaseLock(grid, cell)
    found: list[tuple[float, float]] = []

    def arrive() -> None:
        cell.set(Mock(arrival_s=loop.time()))

    def tick(now_s: float, dt_s: float) -> None:
        if cell.value is not None:
            found.append((now_s - cell.value.arrival_s, dt_s))
        lock.on_tick(Mock(odometry=cell.value), Mock(now_s=now_s))

    for n in range(samples):
        late = late_s(n)
        if late is not None:
            loop.call_at(0.0042 + 0.01 * n + late, arrive)
    running = loop.create_task(grid.run(tick))
    await asyncio.sleep(0.01 * samples)
    running.cancel()
    return found


def test_a_tick_waits_for_a_sample_that_is_a_little_late() -> None:
    found = run_virtual(ticks_with(lambda n: 0.0007 if n % 40 == 0 else 0.0))[1500:]
    assert max(age for age, _ in found) < 0.002
    assert max(dt for _, dt in found) < 0.011


def test_a_tick_does_not_wait_for_a_sample_that_is_lost() -> None:
    found = run_virtual(ticks_with(lambda n: None if n >= 1800 else 0.0))
    assert max(dt for _, dt in found[1790:]) < 0.011
    assert [dt for _, dt in found[1810:]] == pytest.approx([0.01] * len(found[1810:]), abs=1e-6)


def test_jitter_is_waited_for() -> None:
    random = Random(1)
    jitter = [max(-0.001, random.gauss(0.0, 0.0004)) for _ in range(4000)]
    ages = [age for age, _ in run_virtual(ticks_with(lambda n: jitter[n], 4000))[3000:]]
    assert len([age for age in ages if age > 0.008]) <= 3  # samples that came after their tick wait for the next one
    assert sorted(ages)[len(ages) // 2] == pytest.approx(MARGIN_S + 0.0004, abs=0.0002)


@pytest.mark.parametrize("every", [2, 3])
def test_a_stream_slower_than_the_grid_is_not_waited_for(every: int) -> None:
    found = run_virtual(ticks_with(lambda n: 0.0 if n % every == 0 else None, 2000))[1500:]
    assert [dt for _, dt in found] == pytest.approx([0.01] * len(found), abs=0.00015)
