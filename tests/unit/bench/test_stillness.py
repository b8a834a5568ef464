"""When a core stood still: what the witnesses note, and that none of them can spoil a flight."""

import asyncio
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from daemon.bench import stillness as module
from daemon.bench.stillness import Start, Stillness, spans_of, still_s, within


def test_spans_of_all_cores_are_in_order_and_those_that_overlap_are_one() -> None:
    notes = ["1.000000 1.010000\n3.000000 3.020000\n", "2.000000 2.005000\n1.008000 1.012000\n"]
    assert spans_of(notes) == [(1.0, 1.012), (2.0, 2.005), (3.0, 3.02)]
    assert spans_of(["", ""]) == []


def test_only_what_lies_within_counts() -> None:
    spans = [(1.0, 2.0), (3.0, 5.0), (6.0, 7.0)]
    assert still_s(spans, 0.0, 10.0) == 4.0
    assert within(spans, 1.5, 4.0) == [(1.5, 2.0), (3.0, 4.0)]
    assert within(spans, 2.0, 3.0) == []
    assert within(spans, 3.5, 3.6) == [(3.5, 3.6)]


class Witnesses:
    """Programs that note what they are told to, and end as they are told to."""

    def __init__(self, notes: list[str], returncode: int = 0) -> None:
        self.commands: list[list[str]] = []
        self._notes = notes
        self._returncode = returncode

    @asynccontextmanager
    async def start(self, command: list[str], out: Path) -> AsyncIterator[SimpleNamespace]:
        self.commands.append(command[1:])
        self._write(out)
        yield SimpleNamespace(returncode=self._returncode)

    def _write(self, out: Path) -> None:
        out.write_text(self._notes[len(self.commands) - 1])


async def watched_by(witnesses: Witnesses) -> Stillness:
    stillness = Stillness([3, 5])
    async with stillness.watched(cast(Start, witnesses.start)):
        assert stillness.spans is None
    return stillness


async def test_a_witness_watches_each_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "compile_c", lambda *_: None)
    witnesses = Witnesses(["1.0 2.0\n", "4.0 5.0\n"])
    assert (await watched_by(witnesses)).spans == [(1.0, 2.0), (4.0, 5.0)]
    assert witnesses.commands == [["3"], ["5"]]


async def test_a_witness_that_fails_makes_none_of_them_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "compile_c", lambda *_: None)
    assert (await watched_by(Witnesses(["1.0 2.0\n", "3.0"], returncode=-9))).spans is None


async def test_without_a_compiler_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    assert (await watched_by(Witnesses([]))).spans is None


async def test_a_program_that_may_not_run_is_no_reason_not_to_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    @asynccontextmanager
    async def refused(command: list[str], out: Path) -> AsyncIterator[asyncio.subprocess.Process]:
        raise PermissionError(command[0])
        yield

    monkeypatch.setattr(module, "compile_c", lambda *_: None)
    stillness = Stillness([0])
    async with stillness.watched(refused):
        pass
    assert stillness.spans is None
