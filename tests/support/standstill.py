"""A machine that stands still takes the vehicle from any daemon: what goes wrong then, no flight was asked about."""

import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TypeVar

import pytest

from daemon.goals.client_errors import FlightError

STILL_S = 0.2  # as long as the daemon flies on its prediction alone
LOOK_S = 0.01
ATTEMPTS = 4

T = TypeVar("T")


class StoodStillError(Exception):
    """The daemon tells that it stood still, and nobody had asked it to."""


class Witness:
    """Notes for how long this process, which runs the simulated autopilot, did not run at the longest."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._look, name="witness", daemon=True)

    def __enter__(self) -> "Witness":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _look(self) -> None:
        looked_s, ended = time.monotonic(), False
        while not ended:
            ended = self._end.wait(LOOK_S)
            now_s = time.monotonic()
            self.longest_s = max(self.longest_s, now_s - looked_s)
            looked_s = now_s


async def where_it_runs(
    fly: Callable[[Path], Awaitable[T]], folder: Path, wrong: Callable[[T], object] = lambda _result: None
) -> T:
    """What ``fly`` returns, given a folder of its own.

    Tried again where it fails, or what it returns is ``wrong``, on a machine that stood still meanwhile; skipped in the
    end. What must hold whatever the machine does is for ``pytest.fail``, at once.
    """
    for attempt in range(ATTEMPTS):
        own = folder / str(attempt)
        own.mkdir()
        with Witness() as witness:
            try:
                result = await fly(own)
            except StoodStillError:
                continue
            except (AssertionError, FlightError, TimeoutError):
                if witness.longest_s < STILL_S:
                    raise
                continue
        if witness.longest_s < STILL_S or not wrong(result):
            return result
    pytest.skip(f"this machine stood still in each of {ATTEMPTS} flights")
