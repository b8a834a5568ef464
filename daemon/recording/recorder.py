"""The flight record: every tick on disk, written by a thread of its own that the loop never waits for.

In the composition root::

    recorder = Recorder(settings, about={"version": ..., "config_hash": ..., "config": ...}, clock=loop.time)
    control.watchers.add("recorder", lambda inputs, record: recorder.tick(control.state, inputs, record))
    recorder.start()
    ...                                    # event(), goal() and plan() as things happen
    recorder.close()                       # last, within CLOSE_S

``Recorder`` hands over and counts; ``RecordWriter`` decides what is written to which file and does it.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.pipeline import Inputs, PipelineState, Record
from daemon.recording.live import Live
from daemon.recording.topics import Note, Step
from daemon.recording.writer import RecordWriter

BACKLOG = 1000  # entries between loop and writer; ten seconds of a disk that hangs
WAKE_EVERY = 25  # ticks; right after a tick the interpreter is free until the next one
LIVE_WAKE_EVERY = 10  # the same when somebody may look
IDLE_S = 0.5  # how long the writer sleeps when no ticks come
CLOSE_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSettings:
    """Where and how much. ``when``: ``armed`` records flights with ``before_s`` and ``after_s`` around, or ``always``.

    A file is closed at ``max_file_mb``; beyond ``keep_mb`` in the directory the oldest records are removed.
    ``enabled`` False writes no files; ``live_port`` serves the same topics on loopback (None: it does not).
    """

    directory: Path
    when: str = "armed"
    before_s: float = 2.0
    after_s: float = 2.0
    max_file_mb: float = 256.0
    keep_mb: float = 4096.0
    path_poses: int = 200
    period_s: float = 0.01
    enabled: bool = True
    live_port: int | None = None


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """``written`` ticks, ``dropped`` entries, ``failures`` of the disk; ``file`` and ``flight`` are open now."""

    written: int
    dropped: int
    failures: int
    flight: str | None
    file: Path | None


class Recorder:
    """The loop's side: a bounded hand-over of references to immutable objects. No method blocks or raises."""

    def __init__(
        self,
        settings: RecordingSettings,
        about: Mapping[str, Any],
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._wall = wall
        self._writer = RecordWriter(settings, about, self._wall_s)
        self._live: Live | None = None
        self._entries: deque[Step | Note] = deque()
        self._dropped = 0
        self._told_drops = 0
        self._wake_every = WAKE_EVERY if settings.live_port is None else LIVE_WAKE_EVERY
        self._since_wake = 0
        self._wake = threading.Event()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def tick(self, state: PipelineState, inputs: Inputs, record: Record) -> None:
        """Hand over a tick with the flow's memory after it; under 2 us."""
        if len(self._entries) >= BACKLOG:
            self._dropped += 1
            return
        self._entries.append(Step(state, inputs, record))
        self._since_wake += 1
        if self._since_wake >= self._wake_every:
            self._since_wake = 0
            self._wake.set()

    def event(
        self,
        code: str,
        text: str,
        goal_id: str | None = None,
        field: str | None = None,
        reset: Mapping[str, Any] | None = None,
    ) -> None:
        """Something that happened now: a refusal, a command, a change of configuration, a reset of the estimate."""
        self._note("event", {"code": code, "text": text, "goal_id": goal_id, "field": field, "reset": reset})

    def goal(self, what: str, goal_id: str | None, details: Mapping[str, Any]) -> None:
        """A goal was ``submitted``, ``updated``, ``refused`` or ``ended``; details with the protocol's own keys."""
        self._note("goal", {**details, "what": what, "goal_id": goal_id})

    def plan(self, payload: Mapping[str, Any]) -> None:
        """A new planned path, as the protocol's ``telemetry.plan`` has it."""
        self._note("plan", dict(payload))

    @property
    def report(self) -> RecordingReport:
        """Figures of now."""
        writer = self._writer
        return RecordingReport(writer.written, self._dropped, writer.failures, writer.flight, writer.file)

    @property
    def warning(self) -> str | None:
        """What is wrong with the record, in words; None: nothing."""
        report = self.report
        if self._writer.trouble or not (report.failures or report.dropped):
            return self._writer.trouble
        return (
            f"the flight record has gaps: writing failed ({report.failures}), entries were dropped ({report.dropped})"
        )

    def close(self) -> None:
        """Write what was handed over and end the file, waiting at most ``CLOSE_S``."""
        self._closing = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    def _wall_s(self) -> float:
        """Wall time minus the loop's clock."""
        return self._wall() - self._clock()

    def _note(self, kind: str, payload: dict[str, Any]) -> None:
        if len(self._entries) >= BACKLOG:
            self._dropped += 1
            return
        now_s = self._clock()
        self._entries.append(Note(kind, now_s, {"time_s": now_s, **payload}))

    def _run(self) -> None:
        settings = self._settings
        self._writer.check()
        if settings.live_port is not None:
            self._live = Live(settings.live_port, self._wall_s(), settings.path_poses, settings.period_s)
        while not self._closing:
            self._wake.wait(IDLE_S)
            self._wake.clear()
            self._drain()
        self._drain()
        self._writer.close()
        if self._live is not None:
            self._live.close()

    def _drain(self) -> None:
        try:
            self._write_all()
        except Exception as error:  # noqa: BLE001 - the thread's boundary: a fault of the record must not stay unseen
            self._writer.failed(error)

    def _write_all(self) -> None:
        dropped = self._dropped - self._told_drops
        if dropped:
            self._told_drops += dropped
            self._writer.gap(dropped, self._clock())
        for _ in range(len(self._entries)):
            entry = self._entries.popleft()
            for side in (self._writer, self._live):
                if side is None:
                    continue
                if isinstance(entry, Step):
                    side.tick(entry)
                else:
                    side.note(entry)
        self._writer.flush_if_due()
