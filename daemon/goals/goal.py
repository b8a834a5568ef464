"""A submitted goal as its client holds it: feedback to iterate over, a result to wait for."""

import asyncio
from collections.abc import AsyncIterator, Generator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from daemon.goals.results import Outcome

if TYPE_CHECKING:
    from daemon.goals.client import FlightClient


@dataclass(frozen=True, slots=True)
class Feedback:
    """How far the vehicle is: ``progress`` from 0 to 1, ``eta_s`` None while unknown."""

    goal_id: str
    distance_m: float | None
    angle_deg: float | None
    progress: float
    eta_s: float | None


@dataclass(frozen=True, slots=True)
class Result:
    """How a goal ended; ``by`` is the id of the goal that preempted it, ``reason`` why it was canceled or aborted."""

    goal_id: str
    outcome: Outcome
    by: str | None = None
    reason: str | None = None
    error_m: float | None = None
    error_deg: float | None = None
    duration_s: float | None = None

    @property
    def succeeded(self) -> bool:
        """Tell whether the vehicle got there."""
        return self.outcome == "succeeded"


def result_from(record: dict[str, Any]) -> Result:
    """Result of a goal's record that is done; what only a newer daemon tells is left out."""
    return Result(**{key: value for key, value in record.items() if key in _RESULT_KEYS})


def feedback_from(params: dict[str, Any]) -> Feedback:
    """Feedback of its notification; what only a newer daemon tells is left out."""
    return Feedback(**{key: value for key, value in params.items() if key in _FEEDBACK_KEYS})


_RESULT_KEYS = {field.name for field in fields(Result)}
_FEEDBACK_KEYS = {field.name for field in fields(Feedback)}


class Goal:
    """``async for feedback in goal`` until it ends, ``await goal`` for its `Result`."""

    def __init__(self, client: "FlightClient", goal_id: str, preempted: str | None) -> None:
        self._client = client
        self._changed = asyncio.Event()
        self._result: asyncio.Future[Result] = asyncio.get_running_loop().create_future()
        self.goal_id = goal_id
        self.preempted = preempted
        self.feedback: Feedback | None = None

    @property
    def done(self) -> bool:
        """Tell whether the goal has ended."""
        return self._result.done()

    async def result(self) -> Result:
        """Wait until the goal ends. Raises `NoDaemonError` when the daemon is gone for good."""
        return await asyncio.shield(self._result)

    async def cancel(self) -> None:
        """Cancel: the vehicle brakes and holds; the result with ``canceled`` follows."""
        await self._client.cancel(self.goal_id)

    async def move(self, north: float, east: float, down: float, **waypoint: Any) -> None:
        """Move the goal without ending it; takes what `FlightClient.goto` takes of a waypoint."""
        await self._client.update(self.goal_id, north, east, down, **waypoint)

    def __await__(self) -> Generator[Any, None, Result]:
        return self.result().__await__()

    async def __aiter__(self) -> AsyncIterator[Feedback]:
        seen: Feedback | None = None
        while True:
            if self.feedback is not None and self.feedback is not seen:
                seen = self.feedback
                yield seen
            elif self.done:
                return
            else:
                await self._changed.wait()

    def take_feedback(self, feedback: Feedback) -> None:
        """Keep the newest feedback; an iterator that is slow skips the ones between."""
        self.feedback = feedback
        self._wake()

    def take_result(self, result: Result) -> None:
        """The goal has ended."""
        if not self._result.done():
            self._result.set_result(result)
        self._wake()

    def fail(self, error: Exception) -> None:
        """How the goal ends will not be known."""
        if not self._result.done():
            self._result.set_exception(error)
            self._result.exception()  # so that a result that nobody waits for is no warning
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()
