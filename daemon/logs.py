"""Logs are events with fields: readable lines on a terminal, JSON everywhere else (systemd's journal, a pipe)."""

import logging
import os
import sys
from typing import TextIO

import structlog


def configure(level: str = "info", stream: TextIO | None = None, as_json: bool | None = None) -> None:
    """Set up structlog once at start. ``as_json`` None: JSON unless the stream is a terminal."""
    out = stream or sys.stderr
    terminal = out.isatty() and "JOURNAL_STREAM" not in os.environ
    use_json = as_json if as_json is not None else not terminal
    renderer: structlog.typing.Processor = (
        structlog.processors.JSONRenderer()
        if use_json
        else structlog.dev.ConsoleRenderer(colors=terminal and "NO_COLOR" not in os.environ)
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=structlog.WriteLoggerFactory(out),
        cache_logger_on_first_use=True,
    )


def get(name: str) -> structlog.typing.FilteringBoundLogger:
    """A logger whose events carry ``part=name``."""
    logger: structlog.typing.FilteringBoundLogger = structlog.get_logger(part=name)
    return logger
