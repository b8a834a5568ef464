"""A process that does not run for a while, in virtual time: its clock goes on, and so does the autopilot."""

import asyncio
from collections.abc import Callable

from daemon.sim.in_process import STEP_S
from support.flight import Flight


def freeze(
    flight: Flight, seconds: float, *, then: Callable[[], None] = lambda: None, before_end_s: float = 0.0
) -> None:
    """Stand still; ``then`` happens to the autopilot ``before_end_s`` before the end.

    What the autopilot sends meanwhile waits in the socket: overdue ticks come first, as they may when the whole
    process goes on at once.
    """
    clock = asyncio.get_running_loop()._clock  # type: ignore[attr-defined]
    steps = round(seconds / STEP_S)
    at = steps - max(1, round(before_end_s / STEP_S))
    for step in range(steps):
        if step == at:
            then()
        clock.now_ns += round(STEP_S * 1e9)
        flight.autopilot._steps += 1
        flight.px4.step()
