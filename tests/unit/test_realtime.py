"""Real-time rights: taken where permitted, a plain warning where not, and never a reason not to fly."""

import os

import pytest
import structlog

from daemon.config import load
from daemon.realtime import apply


def loops(**changes: object) -> object:
    return load([], {"loops": changes}).loops


def test_nothing_is_asked_for_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_arguments: object) -> None:
        raise AssertionError

    monkeypatch.setattr(os, "sched_setscheduler", never)
    monkeypatch.setattr(os, "sched_setaffinity", never)
    with structlog.testing.capture_logs() as lines:
        apply(loops())  # type: ignore[arg-type]
    assert lines == []


def test_what_is_refused_is_said_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    with structlog.testing.capture_logs() as lines:
        apply(loops(realtime_priority=40, cpu_affinity=[3]))  # type: ignore[arg-type]
    assert [line["event"] for line in lines] == ["cpu_affinity_refused", "realtime_refused"]
    assert "LimitRTPRIO" in lines[1]["advice"]


def test_priority_and_cores_are_taken_as_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *arguments: asked.append(arguments))
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: asked.append(arguments))
    apply(loops(realtime_priority=40, cpu_affinity=[0]))  # type: ignore[arg-type]
    (affinity, priority) = asked
    assert affinity == (0, (0,))
    assert (priority[1], priority[2].sched_priority) == (os.SCHED_FIFO, 40)  # type: ignore[attr-defined]
