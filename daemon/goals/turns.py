"""Whose turn it is: users in turn, of each user its processes, of each process what it asked for."""

import asyncio
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Turns(Generic[T]):
    """A queue that is fair to users and processes, however many connections and requests each of them has."""

    def __init__(self) -> None:
        self._users: dict[int, dict[int, deque[T]]] = {}

    def __bool__(self) -> bool:
        return bool(self._users)

    def put(self, uid: int, pid: int, item: T) -> None:
        """Add an item of a process of a user."""
        self._users.setdefault(uid, {}).setdefault(pid, deque()).append(item)

    def count(self, uid: int, pid: int) -> int:
        """How many items of a process wait."""
        return len(self._users.get(uid, {}).get(pid, ()))

    def take(self) -> T:
        """Remove and return the next. Raises `StopIteration` when there is none: look first."""
        uid = next(iter(self._users))
        processes = self._users.pop(uid)
        pid = next(iter(processes))
        items = processes.pop(pid)
        item = items.popleft()
        if items:
            processes[pid] = items
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
