"""When the machine itself stood still during a flight, by a witness of its own.

A virtual machine is stopped by its host now and then, a laptop by its firmware; a client that runs on it misses its
ticks then, whatever it is. ``stillness.c`` runs on each core above everything else and notes when it was not woken in
time. What a client missed then, and only that, is not its own.
"""

import contextlib
import tempfile
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

from daemon.bench.c_program import NotCompiledError, compile_c

Span = tuple[float, float]  # from, to: seconds of CLOCK_MONOTONIC
Start = Callable[[list[str], Path], AbstractAsyncContextManager[Any]]
_SOURCE = Path(__file__).with_suffix(".c")


class Stillness:
    """Spans in which one of ``cores`` stood still; filled when ``watched`` ends. None: nobody could watch."""

    def __init__(self, cores: Iterable[int]) -> None:
        self.spans: list[Span] | None = None
        self._cores = tuple(cores)

    @contextlib.asynccontextmanager
    async def watched(self, start: Start) -> AsyncIterator[None]:
        """A witness on each core meanwhile. ``start`` runs a command to the end of the block, its output in a file."""
        with tempfile.TemporaryDirectory() as folder:
            program, notes = Path(folder) / "stillness", [Path(folder) / f"core{core}" for core in self._cores]
            try:
                compile_c(_SOURCE, program)
            except NotCompiledError:
                yield
                return
            async with contextlib.AsyncExitStack() as stack:
                for core, note in zip(self._cores, notes, strict=True):
                    await stack.enter_async_context(start([str(program), str(core)], note))
                yield
            self.spans = spans_of([note.read_text() for note in notes])


def spans_of(notes: Sequence[str]) -> list[Span] | None:
    """The spans of all witnesses in order, those that touch as one; None when one was not permitted to watch."""
    if not all(note.startswith("watching") for note in notes):
        return None
    merged: list[Span] = []
    for begun_s, ended_s in sorted(_span(line) for note in notes for line in note.splitlines()[1:]):
        if merged and begun_s <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(ended_s, merged[-1][1]))
        else:
            merged.append((begun_s, ended_s))
    return merged


def _span(line: str) -> Span:
    begun_s, ended_s = map(float, line.split())
    return begun_s, ended_s


def still_s(spans: Sequence[Span], from_s: float, to_s: float) -> float:
    """How long of a time the machine stood still."""
    return sum(max(0.0, min(ended_s, to_s) - max(begun_s, from_s)) for begun_s, ended_s in spans)
