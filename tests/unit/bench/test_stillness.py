"""When the machine stood still: what the witnesses note, and the program that notes it."""

import asyncio
import os
import shutil
import signal
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from daemon.bench.loop import process
from daemon.bench.stillness import Stillness, spans_of, still_s


def test_spans_of_all_cores_are_in_order_and_those_that_touch_are_one() -> None:
    notes = ["watching\n1.000000 1.010000\n3.000000 3.020000\n", "watching\n2.000000 2.005000\n1.008000 1.012000\n"]
    assert spans_of(notes) == [(1.0, 1.012), (2.0, 2.005), (3.0, 3.02)]
    assert spans_of(["watching\n", "watching\n"]) == []


def test_a_witness_that_was_not_permitted_to_watch_makes_none_of_them_count() -> None:
    assert spans_of(["watching\n1.0 2.0\n", ""]) is None


def test_only_what_lies_within_counts() -> None:
    spans = [(1.0, 2.0), (3.0, 5.0)]
    assert still_s(spans, 0.0, 10.0) == 3.0
    assert still_s(spans, 1.5, 4.0) == 1.5
    assert still_s(spans, 2.0, 3.0) == 0.0


async def test_without_a_compiler_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    stillness = Stillness({0})
    async with stillness.watched(process):
        pass
    assert stillness.spans is None


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
async def test_a_program_that_is_stopped_notes_from_when_until_when() -> None:
    """Stopping the witness is to it as if the machine stood still."""
    witnesses: list[asyncio.subprocess.Process] = []

    @asynccontextmanager
    async def kept(command: list[str], out: Path):  # type: ignore[no-untyped-def]
        async with process(command, out) as witness:
            witnesses.append(witness)
            yield witness

    stillness = Stillness({min(os.sched_getaffinity(0))})
    async with stillness.watched(kept):
        await asyncio.sleep(0.2)
        before_s = asyncio.get_running_loop().time()
        witnesses[0].send_signal(signal.SIGSTOP)
        await asyncio.sleep(0.1)
        witnesses[0].send_signal(signal.SIGCONT)
        after_s = asyncio.get_running_loop().time()
        await asyncio.sleep(0.05)
    if stillness.spans is None:
        pytest.skip("SCHED_FIFO is not permitted here")
    longest_s, begun_s, ended_s = max((ended_s - begun_s, begun_s, ended_s) for begun_s, ended_s in stillness.spans)
    assert longest_s > 0.08
    assert before_s - 0.01 < begun_s < ended_s
    assert begun_s < after_s
