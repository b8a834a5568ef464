"""Who only watches the control task: telemetry, the flight record. What fails here must not take the vehicle down."""

from collections.abc import Callable
from pathlib import PurePath
from traceback import walk_tb

from daemon import logs
from daemon.pipeline import Inputs, Record

Watcher = Callable[[Inputs, Record], None]

log = logs.get("control")


class Watchers:
    """Called by name in the order in which they were added. The first failure of each is logged and kept in words."""

    def __init__(self) -> None:
        self.failures: dict[str, str] = {}
        self._watchers: dict[str, Watcher] = {}

    def add(self, name: str, watcher: Watcher) -> None:
        """Call it after each tick from now on, after a failure too."""
        self._watchers[name] = watcher

    def tell(self, inputs: Inputs, record: Record) -> None:
        """Show all of them this tick."""
        for name, watcher in self._watchers.items():
            try:
                watcher(inputs, record)
            except Exception as error:  # noqa: BLE001 - it stands in the log and in the health; the flight goes on
                self._failed(name, error)

    def _failed(self, name: str, error: Exception) -> None:
        if name not in self.failures:
            self.failures[name] = f"{name} failed in flight: {error!r}"
            log.error("watcher_failed", watcher=name, error=repr(error), where=_where(error))


def _where(error: Exception) -> str:
    """The innermost lines of a traceback by number: their text would be read from disk."""
    lines = [f"{PurePath(frame.f_code.co_filename).name}:{line}" for frame, line in walk_tb(error.__traceback__)]
    return " < ".join(reversed(lines[-5:]))
