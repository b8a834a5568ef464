"""When a core stood still during a flight, by a witness of its own.

A virtual machine is stopped by its host now and then, a laptop by its firmware; a client that runs there misses its
ticks then, whatever it is. ``stillness.c`` runs on each core that the client may use, above everything else, and notes
when it was not woken in time.
"""

import contextlib
import tempfile
from asyncio.subprocess import Process
from bisect import bisect
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import AbstractAsyncContextManager
from itertools import islice
from operator import itemgetter
from pathlib import Path

from daemon.bench.c_program import NotCompiledError, compile_c

Span = tuple[float, float]  # from, to: seconds of CLOCK_MONOTONIC
Start = Callable[[list[str], Path], AbstractAsyncContextManager[Process]]
_SOURCE = Path(__file__).with_suffix(".c")


class Stillness:
    """Spans in which one of ``cores`` stood still; filled when ``watched`` ends. None: it could not be watched."""

    def __init__(self, cores: Iterable[int]) -> None:
        self.spans: list[Span] | None = None
        self._cores = tuple(cores)

    @contextlib.asynccontextmanager
    async def watched(self, start: Start) -> AsyncIterator[None]:
        """A witness on each core meanwhile. ``start`` runs a command to the end of the block, its output in a file."""
        with tempfile.TemporaryDirectory() as folder:
            program, notes = Path(folder) / "stillness", [Path(folder) / f"core{core}" for core in self._cores]
            witnesses: list[Process] = []
            async with contextlib.AsyncExitStack() as stack:
                with contextlib.suppress(NotCompiledError, OSError):
                    compile_c(_SOURCE, program)
                    for core, note in zip(self._cores, notes, strict=True):
                        witnesses.append(await stack.enter_async_context(start([str(program), str(core)], note)))
                yield
            if len(witnesses) == len(notes) and all(witness.returncode == 0 for witness in witnesses):
                self.spans = spans_of([note.read_text() for note in notes])


def spans_of(notes: Sequence[str]) -> list[Span]:
    """The spans of all witnesses in order, those that overlap as one."""
    merged: list[Span] = []
    for begun_s, ended_s in sorted(_span(line) for note in notes for line in note.splitlines()):
        if merged and begun_s <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(ended_s, merged[-1][1]))
        else:
            merged.append((begun_s, ended_s))
    return merged


def _span(line: str) -> Span:
    begun_s, ended_s = map(float, line.split())
    return begun_s, ended_s


def within(spans: Sequence[Span], from_s: float, to_s: float) -> list[Span]:
    """What of the spans lies within a time; they are in order and do not overlap."""
    found: list[Span] = []
    for begun_s, ended_s in islice(spans, bisect(spans, from_s, key=itemgetter(1)), None):
        if begun_s >= to_s:
            break
        found.append((max(begun_s, from_s), min(ended_s, to_s)))
    return found


def still_s(spans: Sequence[Span], from_s: float, to_s: float) -> float:
    """How long of a time one of the cores stood still."""
    return sum(ended_s - begun_s for begun_s, ended_s in within(spans, from_s, to_s))
