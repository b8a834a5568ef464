"""Threads beside the loop: those that call into Python from outside, and calls that may hang."""

import asyncio
import contextlib
import ctypes
import threading
from collections.abc import Callable
from typing import TypeVar, cast

T = TypeVar("T")


class ThreadStates:
    """Keeps the interpreter's state of a foreign thread from its first callback on.

    Without it each callback makes one, and unmakes it at its end: two system calls for its stack and a third of the
    callback's time. It goes with the interpreter.
    """

    def __init__(self) -> None:
        self._kept: set[int] = set()

    def keep(self) -> None:
        """Called from a callback of the thread."""
        thread = threading.get_ident()
        if thread not in self._kept:
            self._kept.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()  # never released: the callback's own release then keeps the state


async def aside(work: Callable[[], T]) -> T:
    """Run ``work`` in a thread of its own; cancelled, it is left behind and holds up nothing, not even the exit."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def settle(result: T | None, error: Exception | None) -> None:
        if done.cancelled():
            return
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(cast(T, result))

    def run() -> None:
        result: T | None = None
        error: Exception | None = None
        try:
            result = work()
        except StopIteration as caught:  # no future takes it
            error = RuntimeError(repr(caught))
        except Exception as caught:  # noqa: BLE001 - it comes out where it is awaited
            error = caught
        with contextlib.suppress(RuntimeError):  # the loop did not wait for it
            loop.call_soon_threadsafe(settle, result, error)

    threading.Thread(target=run, name="aside", daemon=True).start()
    return await done
