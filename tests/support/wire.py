"""A client of the whole daemon in virtual time: its lines go through the dispatcher, replies are kept by their id."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

from daemon.goals.dispatch import Dispatcher
from daemon.goals.service import Caller
from support.flight import CALLER, Flight


class Wire:
    """Stands for a `Session`: without its socket, and each line has its turn at once."""

    def __init__(self, flight: Flight, dispatcher: Dispatcher | None = None) -> None:
        self.caller: Caller = CALLER
        self.goals_waiting = 0
        self.rate_hz = 10.0
        self.replies: dict[Any, dict[str, Any]] = {}
        self.dispatcher = dispatcher or Dispatcher(flight.service, flight.hub, _at_once)
        self._flight = flight

    def send(self, line: bytes, *, essential: bool) -> None:
        told = json.loads(line)
        for message in told if isinstance(told, list) else [told]:
            if "id" in message:
                self.replies[message["id"]] = message

    def started(self) -> None:
        pass

    def finished(self) -> None:
        pass

    def ask(self, *requests: tuple[str, str, dict[str, Any]], batch: bool = False) -> None:
        """Send (id, method, params), a line each, or all as a batch."""
        messages = [{"jsonrpc": "2.0", "id": i, "method": method, "params": params} for i, method, params in requests]
        for line in [messages] if batch else messages:
            self.dispatcher.handle(self, json.dumps(line).encode())  # type: ignore[arg-type]

    async def reply(self, request_id: str, limit_s: float = 60.0) -> dict[str, Any]:
        await self._flight.until(lambda: request_id in self.replies, limit_s)
        return self.replies[request_id]


async def _at_once(_caller: Caller) -> None:
    await asyncio.sleep(0)


def slow_planner(seconds: float, after: int = 0) -> None:
    """Let work for the executor take time, all but the first pieces of it."""
    loop = asyncio.get_running_loop()
    at_once: Callable[..., Awaitable[Any]] = loop.run_in_executor
    count = 0

    def slowly(*arguments: Any) -> Awaitable[Any]:
        nonlocal count
        count += 1
        if count <= after:
            return at_once(*arguments)

        async def work() -> Any:
            await asyncio.sleep(seconds)
            return await at_once(*arguments)

        return asyncio.ensure_future(work())

    loop.run_in_executor = slowly  # type: ignore[method-assign,assignment]
