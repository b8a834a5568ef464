"""One vehicle request at a time: whose turn it is, and waits that are bounded and end with the turn."""

import asyncio
from collections.abc import Callable

from daemon.autopilot.port import CommandTimeoutError

POLL_S = 0.02
SUPERSEDED = "superseded by a newer vehicle request"
STOOD_STILL = "the daemon stood still before it was done; ask again"


class NotPossibleError(Exception):
    """The request does not fit the state that the vehicle or the daemon is in; the text says why."""


class Turns:
    """A newer request ends a pending one with ``NotPossibleError("superseded ...")``.

    ``withdraw``: a command of the request before that was not acknowledged must not come after a newer request's.
    """

    def __init__(self, withdraw: Callable[[], None]) -> None:
        self._withdraw = withdraw
        self._turn = 0
        self._takes = False
        self._ended_by = SUPERSEDED

    def begin(self, *, takes: bool = False) -> int:
        """End the request before; the number of this one's turn. ``takes``: it arms, takes off or engages."""
        self._turn += 1
        self._takes = takes
        self._ended_by = SUPERSEDED
        self._withdraw()
        return self._turn

    def stood_still(self) -> None:
        """End what would still arm, take off or engage: who asked has given up, and may stand beside the vehicle."""
        if self._takes:
            self.begin()
            self._ended_by = STOOD_STILL

    def lasts(self, turn: int) -> bool:
        """Whether no newer request has come."""
        return self._turn == turn

    def require(self, turn: int) -> None:
        """Raise ``NotPossibleError`` when a newer request has come."""
        self._require(self.lasts(turn))

    async def until(self, turn: int, done: Callable[[], bool], limit_s: float, what: str) -> None:
        """Wait as long as the turn lasts. Raises ``NotPossibleError``, ``CommandTimeoutError``."""
        await self.wait(lambda: self.lasts(turn), done, limit_s, what)

    async def wait(self, wanted: Callable[[], bool], done: Callable[[], bool], limit_s: float, what: str) -> None:
        """Look every ``POLL_S``: what is waited for is several cells, each with its own writer."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + limit_s
        while True:
            self._require(wanted())
            if done():
                return
            if loop.time() > deadline_s:
                raise CommandTimeoutError(f"not {what} after {limit_s:g} s; it may still come")
            await asyncio.sleep(POLL_S)

    def _require(self, wanted: bool) -> None:
        if not wanted:
            raise NotPossibleError(self._ended_by)
