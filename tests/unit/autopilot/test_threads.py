"""A call beside the loop gives its result or its error, and holds up nothing when nobody waits for it any more."""

import asyncio
import threading

import pytest

from daemon.autopilot.threads import aside


def test_a_call_beside_the_loop_gives_its_result_or_its_error() -> None:
    assert asyncio.run(aside(lambda: 7)) == 7
    with pytest.raises(ZeroDivisionError):
        asyncio.run(aside(lambda: 1 // 0))
    with pytest.raises(RuntimeError, match="StopIteration"):
        asyncio.run(asyncio.wait_for(aside(lambda: next(iter(()))), 10.0))


def test_a_call_that_hangs_holds_up_neither_the_loop_nor_its_end() -> None:
    release, ended = threading.Event(), threading.Event()

    def hang() -> None:
        release.wait(10.0)
        ended.set()

    async def give_up() -> None:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(aside(hang), 0.05)

    asyncio.run(give_up())  # asyncio.to_thread's would be waited for here
    assert not ended.is_set()
    release.set()
    assert ended.wait(10.0)  # and what comes after the loop's end is nobody's error
