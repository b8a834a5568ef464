"""Whose turn it is: users in turn, of each user its processes, newcomers first, of each process what it asked for."""

import asyncio
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class _Processes(Generic[T]):
    """What the processes of one user wait for, in rounds; who comes anew need not wait for the round to end.

    A newcomer and one of the round are taken by turns. Who was taken stays in the round until its place there comes up
    again, even with nothing left to wait for: else one that asks anew after each answer would be a newcomer each time
    (as the new flows of FQ-CoDel, RFC 8290, 4.2).
    """

    def __init__(self) -> None:
        self._newcomers: dict[int, deque[T]] = {}
        self._round: dict[int, deque[T]] = {}
        self._waiting = 0
        self._newcomer_next = True

    def __bool__(self) -> bool:
        return self._waiting > 0

    def put(self, pid: int, item: T) -> None:
        """Add an item of a process."""
        known = self._round if pid in self._round else self._newcomers
        known.setdefault(pid, deque()).append(item)
        self._waiting += 1

    def count(self, pid: int) -> int:
        """How many items of a process wait."""
        return len(self._newcomers.get(pid, ())) + len(self._round.get(pid, ()))

    def take(self) -> T:
        """Remove and return the next; there must be one."""
        items = self._next()
        self._waiting -= 1
        return items.popleft()

    def _next(self) -> deque[T]:
        while True:
            by_turns = self._newcomer_next or not self._round
            source = self._newcomers if self._newcomers and by_turns else self._round
            pid = next(iter(source))
            items = source.pop(pid)
            if items:
                self._round[pid] = items
                self._newcomer_next = source is self._round
                return items


class Turns(Generic[T]):
    """A queue that is fair to users and processes, however many connections and requests each of them has.

    A process that has asked for nothing of late comes next but one of its user's at the latest, unless others came anew
    before it: a flood, by however many processes, does not keep it waiting.
    """

    def __init__(self) -> None:
        self._users: dict[int, _Processes[T]] = {}

    def __bool__(self) -> bool:
        return bool(self._users)

    def put(self, uid: int, pid: int, item: T) -> None:
        """Add an item of a process of a user."""
        processes = self._users.get(uid)
        if processes is None:
            processes = self._users[uid] = _Processes()
        processes.put(pid, item)

    def count(self, uid: int, pid: int) -> int:
        """How many items of a process wait."""
        processes = self._users.get(uid)
        return processes.count(pid) if processes is not None else 0

    def take(self) -> T:
        """Remove and return the next. Raises `StopIteration` when there is none: look first."""
        uid = next(iter(self._users))
        processes = self._users.pop(uid)
        item = processes.take()
        if processes:
            self._users[uid] = processes
        return item


class Turnstile:
    """Lets one through at a time; those who wait are let through in turn."""

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
