import asyncio

import pytest

from daemon.sim.virtual_time import VirtualTimeLoop, run_virtual


def test_an_hour_passes_in_a_moment_and_to_the_nanosecond() -> None:
    async def hour() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        start_s = loop.time()
        await asyncio.sleep(3600.0)
        return start_s, loop.time()

    assert run_virtual(hour()) == (0.0, 3600.0)


def test_a_grid_of_milliseconds_stays_exact() -> None:
    async def grid() -> list[float]:
        loop, seen = asyncio.get_running_loop(), []
        for tick in range(1, 101):
            woken = asyncio.Event()
            loop.call_at(tick * 0.004, woken.set)
            await woken.wait()
            seen.append(loop.time())
        return seen

    assert run_virtual(grid()) == pytest.approx([tick * 0.004 for tick in range(1, 101)], abs=2e-9)


def test_tasks_interleave_by_their_timers_and_alike_each_time() -> None:
    async def both() -> list[tuple[str, float]]:
        loop, order = asyncio.get_running_loop(), []

        async def ticker(name: str, period_s: float) -> None:
            for _ in range(5):
                await asyncio.sleep(period_s)
                order.append((name, round(loop.time(), 6)))

        await asyncio.gather(ticker("a", 0.01), ticker("b", 0.015))
        return order

    first = run_virtual(both())
    assert sorted(name for name, _ in first) == ["a"] * 5 + ["b"] * 5
    assert [time_s for _, time_s in first] == sorted(time_s for _, time_s in first)
    assert run_virtual(both()) == first


def test_computation_takes_no_virtual_time_even_in_an_executor() -> None:
    async def compute() -> tuple[int, float]:
        result = await asyncio.to_thread(sum, range(100_000))
        return result, asyncio.get_running_loop().time()

    assert run_virtual(compute()) == (4999950000, 0.0)


def test_an_error_in_an_executor_reaches_who_awaits_it() -> None:
    async def fail() -> None:
        await asyncio.get_running_loop().run_in_executor(None, int, "x")

    with pytest.raises(ValueError, match="invalid literal"):
        run_virtual(fail())


def test_timeouts_act_in_virtual_time() -> None:
    async def wait() -> float:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 30.0)
        return asyncio.get_running_loop().time()

    assert run_virtual(wait()) == pytest.approx(30.0, abs=1e-6)


def test_a_deadlock_is_an_error_and_not_a_hang() -> None:
    async def wait() -> None:
        await asyncio.Event().wait()

    loop = VirtualTimeLoop()
    task = loop.create_task(wait())
    try:
        with pytest.raises(RuntimeError, match="every task waits"):
            loop.run_until_complete(task)
    finally:
        task.cancel()
        loop.call_soon(loop.stop)
        loop.run_forever()
        loop.close()
