"""Whose turn it is: users in turn, of each user its processes, of each process what it asked for."""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

ANEW_S = 1.0


class _Processes(Generic[T]):
    """What the processes of one user wait for: newcomers, and those of the round; by turns when there are both."""

    def __init__(self) -> None:
        self._newcomers: dict[int, deque[T]] = {}
        self._round: dict[int, deque[T]] = {}
        self._newcomer_next = True

    def __bool__(self) -> bool:
        return bool(self._newcomers or self._round)

    def put(self, pid: int, item: T, *, comes_anew: bool) -> None:
        """Add an item of a process."""
        comes_anew = pid in self._newcomers or (comes_anew and pid not in self._round)
        (self._newcomers if comes_anew else self._round).setdefault(pid, deque()).append(item)

    def count(self, pid: int) -> int:
        """How many items of a process wait."""
        return len(self._newcomers.get(pid, ())) + len(self._round.get(pid, ()))

    def take(self) -> tuple[int, T]:
        """Remove and return the next with its process, which goes to the end of the round; there must be one."""
        newcomer = bool(self._newcomers) and (self._newcomer_next or not self._round)
        source = self._newcomers if newcomer else self._round
        pid = next(iter(source))
        items = source.pop(pid)
        item = items.popleft()
        if items:
            self._round[pid] = items
        self._newcomer_next = not newcomer
        return pid, item


class Turns(Generic[T]):
    """A queue that is fair to users and processes, however many connections and requests each of them has.

    ``newcomers_first``: a process that had no turn for ``ANEW_S`` seconds of ``clock`` is next but one of its user's at
    the latest, behind others that came anew before it. So one that floods, or asks again after each answer, keeps none
    waiting that seldom asks (as the sparse flows of FQ-CoDel, RFC 8290). Not for what has to stay in the order in which
    processes came.
    """

    def __init__(self, *, newcomers_first: bool = False, clock: Callable[[], float] = time.monotonic) -> None:
        self._newcomers_first = newcomers_first
        self._clock = clock
        self._users: dict[int, _Processes[T]] = {}
        self._turn_s: dict[tuple[int, int], float] = {}  # when a process last had one, the oldest first

    def __bool__(self) -> bool:
        return bool(self._users)

    def put(self, uid: int, pid: int, item: T) -> None:
        """Add an item of a process of a user."""
        self._forget()
        processes = self._users.get(uid)
        if processes is None:
            processes = self._users[uid] = _Processes()
        processes.put(pid, item, comes_anew=self._newcomers_first and (uid, pid) not in self._turn_s)

    def count(self, uid: int, pid: int) -> int:
        """How many items of a process wait."""
        processes = self._users.get(uid)
        return processes.count(pid) if processes is not None else 0

    def take(self) -> T:
        """Remove and return the next. Raises `StopIteration` when there is none: look first."""
        uid = next(iter(self._users))
        processes = self._users.pop(uid)
        pid, item = processes.take()
        if processes:
            self._users[uid] = processes
        if self._newcomers_first:
            self._turn_s.pop((uid, pid), None)
            self._turn_s[uid, pid] = self._clock()
        return item

    def _forget(self) -> None:
        """Whose last turn was long ago comes anew."""
        oldest_s = self._clock() - ANEW_S
        while self._turn_s:
            process = next(iter(self._turn_s))
            if self._turn_s[process] > oldest_s:
                return
            del self._turn_s[process]


class Turnstile:
    """Lets one through at a time; processes that wait are let through in turn, in the order in which they came."""

    def __init__(self) -> None:
        self._busy = False
        self._waiting: Turns[asyncio.Future[None]] = Turns()

    async def enter(self, uid: int, pid: int) -> None:
        """Wait for the way to be free, and take it; who came in has to `leave`."""
        if self._busy:
            come: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._waiting.put(uid, pid, come)
            try:
                await come
            except asyncio.CancelledError:
                if not come.cancelled():  # let in, and cancelled in the same pass of the loop
                    self.leave()
                raise
        self._busy = True

    def count(self, uid: int, pid: int) -> int:
        """How many of a process wait."""
        return self._waiting.count(uid, pid)

    def leave(self) -> None:
        """Let the next one in."""
        while self._waiting:
            come = self._waiting.take()
            if not come.done():  # a task that was cancelled does not come any more
                come.set_result(None)
                return
        self._busy = False
