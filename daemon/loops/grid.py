"""A fixed time grid: a late tick runs once, missed ticks are counted and never replayed in a burst."""

import asyncio
import ctypes
import os
import struct
from bisect import insort
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import floor
from typing import Protocol

MAX_SLEW = 0.01  # of a period a tick
_TFD_NONBLOCK_CLOEXEC = os.O_NONBLOCK | os.O_CLOEXEC
_TFD_TIMER_ABSTIME = 1
_CLOCK_MONOTONIC = 1


class Alarm(Protocol):
    """Calls back once at a time of the loop's clock; setting it again replaces the time."""

    def set(self, when_s: float, callback: Callable[[], None]) -> None:
        """Call back at ``when_s``, or at once when that is past."""

    def close(self) -> None:
        """Never call back again."""


class LoopAlarm:
    """The event loop's own timer: for virtual time, and where there is no timerfd."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._handle: asyncio.TimerHandle | None = None

    def set(self, when_s: float, callback: Callable[[], None]) -> None:
        """See ``Alarm``."""
        self.close()
        self._handle = self._loop.call_at(when_s, callback)

    def close(self) -> None:
        """See ``Alarm``."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None


class TimerfdAlarm:
    """A Linux timerfd in the loop: asyncio's timers round up to whole milliseconds, this one does not."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        # Not CDLL, which would give the interpreter lock to another thread just when a tick is due.
        self._libc = ctypes.PyDLL(None, use_errno=True)
        self._fd = self._libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_NONBLOCK_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        self._when_s = 0.0
        self._callback: Callable[[], None] | None = None
        loop.add_reader(self._fd, self._ring)

    def set(self, when_s: float, callback: Callable[[], None]) -> None:
        """See ``Alarm``."""
        self._when_s, self._callback = when_s, callback
        seconds = floor(when_s)
        self._arm(seconds, max(1, int((when_s - seconds) * 1e9)))  # all zero would disarm it

    def close(self) -> None:
        """See ``Alarm``."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1

    def _arm(self, seconds: int, nanoseconds: int) -> None:
        """Set the time, which also forgets an expiry: nothing has to be read."""
        spec = struct.pack("qqqq", 0, 0, seconds, nanoseconds)
        if self._libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, spec, None) != 0:
            raise OSError(ctypes.get_errno(), "timerfd_settime")

    def _ring(self) -> None:
        if self._loop.time() < self._when_s:  # set again between the expiry and this call
            return
        callback, self._callback = self._callback, None
        if callback is None:  # nobody has set it again
            self._arm(0, 0)
        else:
            callback()


def live_alarm(loop: asyncio.AbstractEventLoop) -> Alarm:
    """The best alarm that this machine has: a timerfd, else the loop's own timer."""
    try:
        return TimerfdAlarm(loop)
    except (OSError, AttributeError):
        return LoopAlarm(loop)


@dataclass(frozen=True, slots=True)
class GridReport:
    """Statistics of the newest ticks (``WINDOW`` of them); periods in seconds, counts since the start."""

    rate_hz: float
    period_p99_s: float
    late: int
    missed: int
    ticks: int


class Statistics:
    """Periods of the newest ticks, and counts of late (more than a tenth of a period) and missed ticks."""

    WINDOW = 1000

    def __init__(self) -> None:
        self.late = 0
        self.missed = 0
        self.ticks = 0
        self._periods: deque[float] = deque(maxlen=self.WINDOW)

    def add(self, period_s: float, late: bool, missed: int) -> None:
        """Count one tick that came ``period_s`` after the one before."""
        self._periods.append(period_s)
        self.ticks += 1
        self.late += late
        self.missed += missed

    def report(self) -> GridReport:
        """The figures of now."""
        ordered: list[float] = []
        for period in self._periods:
            insort(ordered, period)
        if not ordered:
            return GridReport(0.0, 0.0, self.late, self.missed, self.ticks)
        last = len(ordered) - 1
        return GridReport(
            rate_hz=len(ordered) / sum(ordered) if sum(ordered) > 0.0 else 0.0,
            period_p99_s=ordered[round(0.99 * last)],
            late=self.late,
            missed=self.missed,
            ticks=self.ticks,
        )


class Grid:
    """Calls ``tick(now_s, dt_s)`` every ``period_s`` on a grid of the loop's clock, until cancelled or it raises.

    ``slew_s``, set from within a tick, moves the phase of the ticks after it, at most 1 % of a period a tick.
    ``pause_s(late_s)`` is asked when a tick is due, and again after as many seconds as it says, until it says none:
    a tick may wait a little for what it needs, and the grid stays where it is.
    """

    def __init__(self, period_s: float, alarm: Alarm) -> None:
        self.period_s = period_s
        self.slew_s = 0.0
        self.pause_s: Callable[[float], float] = lambda _late_s: 0.0
        self.statistics = Statistics()
        self._alarm = alarm
        self._due_s = 0.0
        self._last_s = 0.0

    @property
    def due_s(self) -> float:
        """When the next tick is due, time of the loop's clock."""
        return self._due_s

    async def run(self, tick: Callable[[float, float], None]) -> None:
        """Tick until cancelled; an exception of ``tick`` ends it and comes out here."""
        loop = asyncio.get_running_loop()
        failed: asyncio.Future[None] = loop.create_future()
        self._last_s = loop.time()
        self._due_s = self._last_s + self.period_s

        def ring() -> None:
            if failed.done():
                return
            try:
                self._alarm.set(self._ticked(tick, loop.time()), ring)
            except Exception as error:  # noqa: BLE001 - it comes out of run()
                failed.set_exception(error if not isinstance(error, StopIteration) else RuntimeError(repr(error)))

        self._alarm.set(self._due_s, ring)
        try:
            await failed
        finally:
            self._alarm.close()

    def _ticked(self, tick: Callable[[float, float], None], now_s: float) -> float:
        """Tick if it is time; when to look again."""
        if now_s < self._due_s:
            return self._due_s
        pause_s = self.pause_s(now_s - self._due_s)
        if pause_s > 0.0:
            return now_s + pause_s
        tick(now_s, self._advance(now_s))
        return self._due_s

    def _advance(self, now_s: float) -> float:
        late_s = now_s - self._due_s
        missed = int(late_s / self.period_s)
        dt_s = now_s - self._last_s
        self.statistics.add(dt_s, late_s > 0.1 * self.period_s, missed)
        limit_s = MAX_SLEW * self.period_s
        self._due_s += (missed + 1) * self.period_s + min(limit_s, max(-limit_s, self.slew_s))
        self.slew_s = 0.0
        self._last_s = now_s
        return dt_s
