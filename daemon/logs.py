"""Logs are events with fields: readable lines on a terminal, JSON everywhere else (systemd's journal, a pipe).

In the journal each line has its level (``journalctl -p warning``).
Every line of a flight carries its id as ``flight``. An event that repeats itself is written ``BURST`` times in
``WINDOW_S``; the next line after that says how many were left out.
"""

import contextlib
import logging
import os
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

import structlog

BURST = 10
WINDOW_S = 10.0
_MOST_KEYS = 1000
_PRIORITIES = {"debug": 7, "info": 6, "warning": 4, "error": 3, "critical": 2}  # syslog's


class Repeats:
    """A processor that drops what repeats too often: the same event of the same part at the same level."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._windows: dict[tuple[Any, ...], list[float]] = {}

    def __call__(self, _logger: Any, method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
        """Pass the event on, or drop it."""
        key = (event.get("part"), event.get("event"), method)
        now_s = self._clock()
        window = self._windows.get(key)
        if window is None or now_s - window[0] >= WINDOW_S:
            left_out = 0 if window is None else int(window[1]) - BURST
            if len(self._windows) >= _MOST_KEYS:
                self._windows.clear()
            self._windows[key] = [now_s, 1]
            return {**event, "left_out": left_out} if left_out > 0 else event
        window[1] += 1
        if window[1] > BURST:
            raise structlog.DropEvent
        return event


class Flight:
    """A processor that adds the id of the flight, from whoever knows it."""

    def __init__(self) -> None:
        self.source: Callable[[], str | None] = lambda: None

    def __call__(self, _logger: Any, _method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
        """Add ``flight`` while there is one."""
        flight = self.source()
        return event if flight is None else {**event, "flight": flight}


flight = Flight()


class Json:
    """A renderer: one line of JSON, what happened first. ``journal``: behind the ``<level>`` of sd-daemon(3)."""

    def __init__(self, journal: bool) -> None:
        self._journal = journal
        self._render = structlog.processors.JSONRenderer()

    def __call__(self, logger: Any, method: str, event: structlog.typing.EventDict) -> str:
        """The line."""
        level = event.pop("level", method)
        line = self._render(logger, method, {"event": event.pop("event", ""), "level": level, **event})
        return f"<{_PRIORITIES.get(level, 6)}>{line!s}" if self._journal else str(line)


def _is_journal(stream: TextIO) -> bool:
    """Tell whether it is the one that systemd connected (JOURNAL_STREAM of systemd.exec(5)), not another since."""
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


class _Tolerant:
    """A stream whose reader may go away: a line that cannot be written must not end a flight."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        """Write, or lose the text."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.write(text)

    def flush(self) -> None:
        """Flush, or lose what is left."""
        with contextlib.suppress(OSError, ValueError):
            self._stream.flush()


def configure(level: str = "info", stream: TextIO | None = None, as_json: bool | None = None) -> None:
    """Set up structlog once at start. ``as_json`` None: JSON unless the stream is a terminal."""
    out = stream or sys.stderr
    terminal = out.isatty() and "JOURNAL_STREAM" not in os.environ
    use_json = as_json if as_json is not None else not terminal
    renderer: structlog.typing.Processor = (
        Json(_is_journal(out))
        if use_json
        else structlog.dev.ConsoleRenderer(colors=terminal and "NO_COLOR" not in os.environ)
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            Repeats(),
            structlog.processors.add_log_level,
            flight,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=structlog.WriteLoggerFactory(_Tolerant(out)),  # type: ignore[arg-type]
        cache_logger_on_first_use=True,
    )


def get(name: str) -> structlog.typing.FilteringBoundLogger:
    """A logger whose events carry ``part=name``."""
    logger: structlog.typing.FilteringBoundLogger = structlog.get_logger(part=name)
    return logger
