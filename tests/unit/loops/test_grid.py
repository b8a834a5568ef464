"""The grid: fixed phase, late ticks once, missed ticks counted, never a burst; in virtual time."""

import asyncio
from itertools import pairwise
from pathlib import Path

import pytest

from daemon.loops.grid import Grid, LoopAlarm, Statistics, TimerfdAlarm
from daemon.sim.virtual_time import VirtualTimeLoop, run_virtual


async def ticked(period_s: float, count: int, work: dict[int, float], slew_s: float = 0.0) -> tuple[list[float], Grid]:
    """Times of the first ``count`` ticks; tick ``n`` takes ``work[n]`` seconds of the loop's time."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    times: list[float] = []
    grid = Grid(period_s, LoopAlarm(loop))
    done = asyncio.Event()

    def tick(now_s: float, dt_s: float) -> None:
        times.append(now_s)
        loop._clock.now_ns += int(1e9 * work.get(len(times), 0.0))
        grid.slew_s = slew_s
        if len(times) >= count:
            done.set()

    task = asyncio.create_task(grid.run(tick))
    await done.wait()
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return times, grid


def test_ticks_stay_on_the_grid() -> None:
    times, grid = run_virtual(ticked(0.01, 500, {}))
    assert times == pytest.approx([0.01 * (i + 1) for i in range(500)], abs=1e-6)
    assert (grid.statistics.late, grid.statistics.missed) == (0, 0)


def test_work_within_the_period_does_not_move_the_grid() -> None:
    times, _ = run_virtual(ticked(0.01, 50, dict.fromkeys(range(1, 50), 0.004)))
    assert times[-1] == pytest.approx(0.5, abs=1e-6)


def test_a_stall_is_followed_by_one_late_tick_and_the_old_grid() -> None:
    times, grid = run_virtual(ticked(0.01, 10, {3: 0.043}))
    assert times == pytest.approx([0.01, 0.02, 0.03, 0.073, 0.08, 0.09, 0.10, 0.11, 0.12, 0.13], abs=1e-6)
    assert (grid.statistics.late, grid.statistics.missed) == (1, 3)


def test_the_phase_slews_by_at_most_a_hundredth_of_the_period_a_tick() -> None:
    times, _ = run_virtual(ticked(0.01, 101, {}, slew_s=0.5))
    periods = [b - a for a, b in pairwise(times)]
    assert max(periods) <= 0.0101 + 1e-8
    assert times[-1] - times[0] == pytest.approx(0.01 + 99 * 0.0101, abs=1e-5)


def test_a_slew_counts_for_one_tick_in_either_direction() -> None:
    async def main() -> None:
        times: list[float] = []
        grid = Grid(0.01, LoopAlarm(asyncio.get_running_loop()))

        def tick(now_s: float, _dt_s: float) -> None:
            times.append(now_s)
            if len(times) in (2, 4):
                grid.slew_s = 0.5 if len(times) == 2 else -0.5

        task = asyncio.create_task(grid.run(tick))
        await asyncio.sleep(0.1)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        periods = [round(1e4 * (b - a)) for a, b in pairwise(times)]
        assert periods[:7] == [100, 100, 101, 100, 99, 100, 100]

    run_virtual(main())


def test_a_tick_is_late_beyond_a_tenth_of_the_period_and_missed_from_a_whole_one_on() -> None:
    for work_s, late, missed in ((0.0108, 0, 0), (0.0113, 1, 0), (0.0195, 1, 0), (0.0205, 1, 1)):
        _, grid = run_virtual(ticked(0.01, 10, {3: work_s}))
        assert (grid.statistics.late, grid.statistics.missed) == (late, missed), work_s


def test_a_grid_that_ends_closes_its_alarm() -> None:
    async def main() -> None:
        closed: list[bool] = []
        alarm = LoopAlarm(asyncio.get_running_loop())
        close = alarm.close
        alarm.close = lambda: (closed.append(True), close())[1]  # type: ignore[method-assign]
        task = asyncio.create_task(Grid(0.01, alarm).run(lambda _now_s, _dt_s: None))
        await asyncio.sleep(0.05)
        closed.clear()  # it also closes what it sets anew
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert closed == [True]

    run_virtual(main())


@pytest.mark.parametrize("error", [ZeroDivisionError(), StopIteration()])
@pytest.mark.parametrize("where", ["tick", "pause_s"])
def test_whatever_fails_at_a_tick_ends_the_grid(where: str, error: Exception) -> None:
    async def main() -> None:
        grid = Grid(0.01, LoopAlarm(asyncio.get_running_loop()))

        def fail(*_times_s: float) -> float:
            raise error

        if where == "pause_s":
            grid.pause_s = fail
        with pytest.raises((ZeroDivisionError, RuntimeError)):
            await asyncio.wait_for(grid.run(fail if where == "tick" else lambda _now_s, _dt_s: None), 1.0)

    run_virtual(main())


def test_the_report_holds_the_99th_percentile_of_the_periods() -> None:
    statistics = Statistics()
    for i in range(100):
        statistics.add(0.01 if i < 98 else 0.03, late=i >= 98, missed=i >= 98)
    report = statistics.report()
    assert report.period_p99_s == 0.03
    assert (report.late, report.missed, report.ticks) == (2, 2, 100)
    assert report.rate_hz == pytest.approx(100 / (98 * 0.01 + 2 * 0.03))


async def test_the_timerfd_calls_back_after_its_time_and_not_before() -> None:
    loop = asyncio.get_running_loop()
    rung: asyncio.Future[float] = loop.create_future()
    alarm = TimerfdAlarm(loop)
    due_s = loop.time() + 0.02
    alarm.set(due_s, lambda: rung.set_result(loop.time()))
    assert await asyncio.wait_for(rung, 10.0) >= due_s
    alarm.close()


async def test_a_timerfd_set_again_after_its_expiry_keeps_the_new_time() -> None:
    loop = asyncio.get_running_loop()
    rung: asyncio.Future[float] = loop.create_future()
    alarm = TimerfdAlarm(loop)
    alarm.set(loop.time() - 1.0, lambda: rung.set_result(-1.0))
    loop.call_soon(lambda: alarm.set(due_s, lambda: rung.set_result(loop.time())))  # in the turn that sees the expiry
    due_s = loop.time() + 0.02
    assert await asyncio.wait_for(rung, 10.0) >= due_s
    alarm.close()


async def test_a_timerfd_that_nobody_sets_again_rings_once_and_leaves_the_loop_asleep() -> None:
    loop = asyncio.get_running_loop()
    rung: list[float] = []
    alarm = TimerfdAlarm(loop)
    ring, turns = alarm._ring, list[float]()
    loop.remove_reader(alarm._fd)
    loop.add_reader(alarm._fd, lambda: (turns.append(loop.time()), ring()))
    alarm.set(loop.time(), lambda: rung.append(loop.time()))
    await asyncio.sleep(0.1)
    assert len(rung) == 1
    assert len(turns) <= 3
    alarm.close()


def test_a_closed_timerfd_leaves_no_descriptor() -> None:
    loop = asyncio.new_event_loop()
    before = len(list(Path("/proc/self/fd").iterdir()))
    alarm = TimerfdAlarm(loop)
    alarm.close()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    loop.close()
