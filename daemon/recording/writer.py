"""The writer's side of the flight record: which file is open, when it ends, and what a failing disk does."""

import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, BinaryIO

import foxglove
from foxglove.mcap import MCAPCompression, MCAPWriteOptions, MCAPWriter

from daemon import logs
from daemon.recording import files, narrator
from daemon.recording.topics import Note, Step, Topics

if TYPE_CHECKING:
    from daemon.recording.recorder import RecordingSettings

FLUSH_S = 1.0  # a record that power loss cuts off is whole up to here
RETRY_S = 10.0  # after a failure of the disk
_MB = 1_000_000

log = logs.get("recorder")


class RecordWriter:
    """Takes steps in order, keeps the seconds before a flight, opens, flushes and rotates files; for one thread.

    ``trouble`` says in words why nothing is written, as long as that is so.
    ``wall`` is wall time minus the loop's clock, asked anew for each flight: a companion computer may learn it late.
    """

    def __init__(self, settings: "RecordingSettings", about: Mapping[str, Any], wall: Callable[[], float]) -> None:
        self.written = 0
        self.failures = 0
        self.trouble: str | None = None
        self.flight: str | None = None
        self.file: Path | None = None
        self._settings = settings
        self._about = about
        self._context = foxglove.Context()
        self._wall = wall
        self._topics = Topics(self._context, wall(), settings.path_poses)
        self._before: deque[Step | Note] = deque(maxlen=max(1, round(settings.before_s / settings.period_s)))
        self._told = narrator.Told()
        self._sink: MCAPWriter | None = None
        self._stream: BinaryIO | None = None
        self._part = 0
        self._begun = False
        self._flush_due_s = self._retry_s = 0.0
        self._armed_s = float("-inf")

    def check(self) -> None:
        """Whether files can be made in the directory, so that one hears of it before the flight."""
        if not self._settings.enabled:
            return
        try:
            self._settings.directory.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=self._settings.directory):
                self.trouble = None
        except OSError as error:
            self.failed(error)

    def tick(self, step: Step) -> None:
        """Write a tick, or keep it in case a flight begins."""
        now_s = step.record.now_s
        if step.inputs.status.armed:
            self._armed_s = now_s
        wanted = self._settings.enabled and (
            self._settings.when == "always" or now_s - self._armed_s <= self._settings.after_s
        )
        if wanted and self._sink is None and time.monotonic() >= self._retry_s:
            self._open(now_s)
        if self._sink is None:
            self._before.append(step)
            return
        while self._before:
            kept = self._before.popleft()
            if isinstance(kept, Step):
                self._write(kept)
            else:
                self.note(kept)
        self._write(step)
        if not wanted:
            self.close()

    def note(self, note: Note) -> None:
        """Write an event, a goal or a plan, or keep it like a tick."""
        if self._sink is None:
            self._before.append(note)
        else:
            self._guarded(lambda: self._topics.note(note))

    def gap(self, dropped: int, now_s: float) -> None:
        """Entries were lost before the next one: say so, and let a replay begin anew after it."""
        self._begun = False
        self._before.clear()
        text = f"{dropped} entries of the record were dropped: the disk is slow"
        self.note(Note("event", now_s, {"time_s": now_s, "code": "record_gap", "text": text, "goal_id": None}))
        log.warning("record_gap", dropped=dropped)

    def flush_if_due(self) -> None:
        """Once a second everything goes to the disk; a full file is ended. Without one, trouble is looked at again."""
        if self._sink is None and self.trouble and time.monotonic() >= self._retry_s:
            self.check()
        if self._sink is None or time.monotonic() < self._flush_due_s:
            return
        self._flush_due_s = time.monotonic() + FLUSH_S
        self._guarded(self._flush)
        if self._stream is not None and self._stream.tell() > self._settings.max_file_mb * _MB:
            self._end_file()

    def close(self) -> None:
        """End the flight's record."""
        if self._sink is not None:
            self._end_file()
            log.info("record_closed", flight=self.flight)
        self.flight = None
        self._part = 0

    def _write(self, step: Step) -> None:
        if not self._begun:
            self._guarded(lambda: self._begin(step))
            return
        self._told, events = narrator.tell(self._told, step, self._settings.period_s)

        def write() -> None:
            self._topics.tick(step)
            for event in events:
                self._topics.event(event)
            self.written += 1

        self._guarded(write)

    def _begin(self, step: Step) -> None:
        self._begun = self._topics.begin(step)

    def _open(self, now_s: float) -> None:
        directory = self._settings.directory
        try:
            directory.mkdir(parents=True, exist_ok=True)
            if self.flight is None:
                self._topics.wall_s = self._wall()
                self.flight = files.flight_id(now_s + self._topics.wall_s, directory)
            self._part += 1
            files.make_room(directory, round((self._settings.keep_mb - self._settings.max_file_mb) * _MB))
            self.file = files.part_path(directory, self.flight, self._part)
            self._stream = self.file.open("xb", buffering=0)
            options = MCAPWriteOptions(compression=MCAPCompression.Zstd, chunk_size=None, compression_threads=0)
            self._sink = foxglove.open_mcap(self._stream, context=self._context, writer_options=options)
        except OSError as error:
            self.failed(error)
            return
        self.trouble = None
        self._begun = False
        self._told = narrator.Told()
        facts = {"time_s": now_s, "flight": self.flight, "part": self._part, "wall_s": self._topics.wall_s}
        self._guarded(lambda: self._topics.about(now_s, {**facts, **self._about}))
        log.info("record_opened", flight=self.flight, file=str(self.file))

    def _flush(self) -> None:
        assert self._sink is not None and self._stream is not None
        self._sink.flush()
        os.fsync(self._stream.fileno())

    def _end_file(self) -> None:
        sink, stream = self._sink, self._stream
        self._sink = self._stream = self.file = None
        try:
            if sink is not None:
                sink.close()
            if stream is not None:
                stream.close()
        except (OSError, RuntimeError) as error:
            self.failed(error)

    def _guarded(self, write: Callable[[], None]) -> None:
        try:
            write()
        except (OSError, RuntimeError) as error:
            self.failed(error)

    def failed(self, error: Exception) -> None:
        """The disk does not take it: go on without a record and try again later."""
        self.failures += 1
        cause = (error.strerror if isinstance(error, OSError) else None) or str(error)
        self.trouble = f"no flight record is written to {self._settings.directory}: {cause}"
        self._retry_s = time.monotonic() + RETRY_S
        log.error("record_failed", error=str(error), file=str(self.file))
        if self._sink is not None:
            self._end_file()
