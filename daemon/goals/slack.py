"""The time that the control task leaves: all that clients can make the loop do is done in it, piece by piece."""

import asyncio
from collections import deque
from collections.abc import Callable

PAUSE_S = 0.001
SHARE = 0.25
LEAST_GUARD_S = 0.001
MOST_GUARD = 0.5
MOST_COST_S = 0.005
MOST_WAIT_S = 0.02
FORGET = 0.98
VISITS = 32

Worker = Callable[[], bool]


class Slack:
    """Calls workers in turn; each does a small piece of work, and says whether it did any.

    A piece begins only when the dearest of late would be over before the next tick of the control task
    (``next_tick_s``, time of the loop's clock), as far as half of its ``period_s`` allows, but waits ``MOST_WAIT_S`` at
    most; pieces, and the tasks that they start, get a share ``SHARE`` of the loop's time, and ``PAUSE_S`` lies between
    two. One event loop uses it.
    """

    def __init__(self, next_tick_s: Callable[[], float] | None = None, period_s: float = 0.01) -> None:
        self._next_tick_s = next_tick_s
        self._most_guard_s = MOST_GUARD * period_s
        self._wanted: deque[Worker] = deque()
        self._scheduled = False
        self._free_s = 0.0
        self._dearest_s = 0.0
        self._since_s: float | None = None

    def want(self, worker: Worker) -> None:
        """Call ``worker`` once, when it is its turn; a worker that has more to do then asks again."""
        if worker in self._wanted:
            return
        self._wanted.append(worker)
        if not self._scheduled:
            self._scheduled = True
            asyncio.get_running_loop().call_soon(self._turn)

    def start_s(self, now_s: float) -> float:
        """When the next piece may begin: ``now_s``, or later."""
        since_s = self._since_s if self._since_s is not None else now_s
        start_s = max(now_s, self._free_s)
        if self._next_tick_s is None:
            return start_s
        due_s = self._next_tick_s()
        guard_s = min(self._most_guard_s, max(LEAST_GUARD_S, self._dearest_s))
        if start_s > due_s - guard_s:
            start_s = due_s if due_s > now_s else now_s + PAUSE_S  # a tick that is late comes first
        return max(now_s, min(start_s, since_s + MOST_WAIT_S))

    def _turn(self) -> None:
        loop = asyncio.get_running_loop()
        now_s = loop.time()
        start_s = self.start_s(now_s)
        if start_s > now_s:
            self._since_s = self._since_s if self._since_s is not None else now_s
            loop.call_at(start_s, self._turn)
            return
        self._since_s = None
        did = True
        try:
            did = self._visit()
        finally:
            loop.call_soon(self._settle, now_s, did)  # behind the tasks that the piece started

    def _visit(self) -> bool:
        for _ in range(VISITS):
            if not self._wanted:
                return False
            if self._wanted.popleft()():
                return True
        return True

    def _settle(self, begun_s: float, did: bool) -> None:
        """Count what the piece cost; what is left waits for its turn."""
        loop = asyncio.get_running_loop()
        now_s = loop.time()
        if did:
            self._count(now_s, now_s - begun_s)
        if self._wanted:
            loop.call_at(self._free_s, self._turn)
        else:
            self._scheduled = False

    def _count(self, now_s: float, cost_s: float) -> None:
        cost_s = min(cost_s, MOST_COST_S)
        self._dearest_s = max(cost_s, FORGET * self._dearest_s)
        self._free_s = now_s + max(PAUSE_S, cost_s * (1.0 / SHARE - 1.0))
