"""Who listens to which topic of telemetry at which rate: the client library's side of a subscription."""

import asyncio
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from daemon.goals.client_errors import NoDaemonError

QUEUE = 256


@dataclass(frozen=True, slots=True)
class Telemetry:
    """One notification of a topic; ``data`` has the shape that `daemon.goals.results` gives it.

    The topic ``goal`` has two: ``data["notification"]`` is goal.feedback or goal.result.
    """

    topic: str
    data: Any


class Listener:
    """Takes the notifications of some topics; of what waits too long the oldest goes."""

    def __init__(self, topics: Iterable[str], rate_hz: float) -> None:
        self.topics = frozenset(topics)
        self.rate_hz = rate_hz
        self._queue: asyncio.Queue[Telemetry | NoDaemonError] = asyncio.Queue(QUEUE)

    def put(self, item: Telemetry | NoDaemonError) -> None:
        """Give it a notification, or the end."""
        if self._queue.full():
            self._queue.get_nowait()
        self._queue.put_nowait(item)

    async def get(self) -> Telemetry:
        """The next notification. Raises `NoDaemonError` when the connection is lost for good."""
        item = await self._queue.get()
        if isinstance(item, NoDaemonError):
            raise item
        return item


class Listeners:
    """All listeners of one connection."""

    def __init__(self) -> None:
        self._all: list[Listener] = []

    @property
    def topics(self) -> frozenset[str]:
        """What somebody listens to."""
        return frozenset[str]().union(*(listener.topics for listener in self._all))

    def add(self, topics: Iterable[str], rate_hz: float) -> Listener:
        """A new one; it gets what comes from now on."""
        listener = Listener(topics, rate_hz)
        self._all.append(listener)
        return listener

    def remove(self, listener: Listener) -> frozenset[str]:
        """Forget it; the topics that nobody listens to any more."""
        self._all.remove(listener)
        return listener.topics - self.topics

    def subscriptions(self, topics: Iterable[str]) -> Iterator[dict[str, Any]]:
        """Parameters of ``telemetry.subscribe``: each topic at the highest rate that one of its listeners wants."""
        rates: dict[float, list[str]] = {}
        for topic in sorted(topics):
            rate_hz = max(listener.rate_hz for listener in self._all if topic in listener.topics)
            rates.setdefault(rate_hz, []).append(topic)
        for rate_hz, those in rates.items():
            yield {"topics": those, "rate_hz": rate_hz}

    def tell(self, topic: str, data: Any) -> None:
        """Pass a notification on to those of its topic."""
        for listener in self._all:
            if topic in listener.topics:
                listener.put(Telemetry(topic, data))

    def lose(self, error: NoDaemonError) -> None:
        """Tell all of them that nothing comes any more."""
        for listener in self._all:
            listener.put(error)
