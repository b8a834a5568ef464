"""Real-time rights: taken where permitted, a plain warning where not, and never a reason not to fly."""

import os
import threading

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
        refused = apply(loops(realtime_priority=40, cpu_affinity=[3]))  # type: ignore[arg-type]
    assert {line["event"]: line["text"] for line in lines} == refused
    assert list(refused) == ["cpu_affinity_refused", "realtime_refused"]
    assert "LimitRTPRIO" in refused["realtime_refused"]


def test_priority_and_cores_are_taken_as_configured_for_every_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    cores: list[tuple[object, ...]] = []
    priorities: list[tuple[int | None, int, int]] = []
    monkeypatch.setattr(os, "sched_setaffinity", lambda *arguments: cores.append(arguments))
    monkeypatch.setattr(os, "sched_setscheduler", lambda t, how, p: priorities.append((t, how, p.sched_priority)))
    end = threading.Event()
    other = threading.Thread(target=end.wait)
    other.start()
    try:
        apply(loops(realtime_priority=40, cpu_affinity=[0]))  # type: ignore[arg-type]
        threads = [thread.native_id for thread in threading.enumerate()]
    finally:
        end.set()
        other.join()
    assert {threading.main_thread().native_id, other.native_id} <= set(threads)
    assert cores == [(thread, (0,)) for thread in threads]
    assert priorities == [(thread, os.SCHED_FIFO, 40) for thread in threads]
