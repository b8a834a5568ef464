"""An asyncio event loop whose clock stands still while there is work and jumps to the next timer when there is none.

A minute of flight runs as fast as its computation, always in the same order. ``loop.time()`` starts at 0 and counts
whole nanoseconds, so that a grid of milliseconds stays exact. Work for an executor runs at once, in the loop's own
thread. Sockets that are ready are served first, but waiting for them takes no time: they have no place in a test
that shall be deterministic.
"""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from math import ceil
from typing import Any, TypeVar

T = TypeVar("T")

_NS_PER_S = 1e9
_RESOLUTION_S = 1e-9


class _JumpingSelector(selectors.DefaultSelector):
    """Polls, and moves the clock on by the time that a real one would have slept."""

    now_ns = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready: list[tuple[selectors.SelectorKey, int]] = super().select(0)
        if not ready:
            if timeout is None:
                raise RuntimeError("virtual time: every task waits, and no timer is set")
            self.now_ns += ceil(max(timeout, 0.0) * _NS_PER_S)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """The event loop; RuntimeError out of it when every task waits and no timer is set (a deadlock)."""

    def __init__(self) -> None:
        self._clock = _JumpingSelector()
        super().__init__(self._clock)
        self._clock_resolution = _RESOLUTION_S

    def time(self) -> float:
        """Virtual seconds since the loop was made."""
        return self._clock.now_ns / _NS_PER_S

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> "asyncio.Future[T]":
        """Run it now: virtual time does not pass while something is computed."""
        future: asyncio.Future[T] = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # noqa: BLE001  # whatever it is belongs to who awaits it
            future.set_exception(error)
        return future


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time, as ``asyncio.run`` would; tasks left over are cancelled."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
