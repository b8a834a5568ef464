"""What a bad link does to messages: silence, loss, delay, jitter, reordering, in each direction. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from math import erf, sqrt
from typing import Any

Message = tuple[str, dict[str, Any], tuple[int, int]]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkQuality:
    """One direction of a link; the defaults are a perfect one. ``loss`` and ``reordering`` are probabilities.

    Each message waits ``delay_s`` and a random share of ``jitter_s``. Only ``reordering`` lets messages overtake each
    other: such a message waits ``reorder_s`` more.
    """

    silent: bool = False
    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    reordering: float = 0.0
    reorder_s: float = 0.03


PERFECT = LinkQuality()


class LinkFaults:
    """One direction: ``pass_on`` takes what was sent and gives what arrives by now."""

    def __init__(self, draw: Iterator[float]) -> None:
        self._draw = draw
        self.quality = PERFECT
        self._waiting: list[tuple[int, int, Message]] = []
        self._count = 0
        self._last_us = 0
        self.lost = 0

    @property
    def is_perfect(self) -> bool:
        """Nothing to do for this link."""
        return self.quality is PERFECT and not self._waiting

    def send(self, message: Message, now_us: int) -> None:
        """A message enters the link."""
        q = self.quality
        if q.silent or (q.loss > 0.0 and self._uniform() < q.loss):
            self.lost += 1
            return
        wait_s = q.delay_s + (q.jitter_s * self._uniform() if q.jitter_s > 0.0 else 0.0)
        arrival_us = max(self._last_us, now_us + round(wait_s * 1e6))
        self._last_us = arrival_us
        if q.reordering > 0.0 and self._uniform() < q.reordering:
            arrival_us += round(q.reorder_s * 1e6)
        self._count += 1
        heappush(self._waiting, (arrival_us, self._count, message))

    def arrived(self, now_us: int) -> list[Message]:
        """Messages that leave the link by now."""
        out = []
        while self._waiting and self._waiting[0][0] <= now_us:
            out.append(heappop(self._waiting)[2])
        return out

    def _uniform(self) -> float:
        """A number in [0, 1] from the common source of normal numbers."""
        return 0.5 * (1.0 + erf(next(self._draw) / sqrt(2.0)))
