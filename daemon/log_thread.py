"""Standard error by a thread of its own: whoever logs never waits for the reader of the log.

A terminal that is paused, a full pipe or a slow journal would otherwise stop the event loop, and with it the vehicle.
"""

import contextlib
import io
import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue

BACKLOG = 1000  # texts that wait for the reader; what comes after that is lost, and counted
CLOSE_S = 0.5


class Beside(io.TextIOBase):
    """A text stream whose ``write`` takes the text and returns; a thread writes it to the file descriptor ``fd``.

    ``on_lost`` is called with the number of texts that found the backlog full, as soon as the reader reads again.
    """

    def __init__(self, fd: int, on_lost: Callable[[int], None], backlog: int = BACKLOG) -> None:
        self.lost = 0
        self._fd = fd
        self._on_lost = on_lost
        self._backlog = backlog
        self._told = 0
        self._texts: SimpleQueue[str | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def write(self, text: str) -> int:
        """Take the text, or count it as lost."""
        if self._texts.qsize() < self._backlog:
            self._texts.put(text)
        else:
            self.lost += 1
        return len(text)

    def writable(self) -> bool:
        """See ``io.TextIOBase``."""
        return True

    def fileno(self) -> int:
        """See ``io.TextIOBase``."""
        return self._fd

    def isatty(self) -> bool:
        """See ``io.TextIOBase``."""
        return os.isatty(self._fd)

    def finish(self, timeout_s: float = CLOSE_S) -> None:
        """Write what was taken, and end the thread; a reader that does not read is left behind."""
        self._texts.put(None)
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while (text := self._texts.get()) is not None:
            with contextlib.suppress(OSError):  # a reader that went away costs the text
                self._write_all(text.encode("utf-8", "backslashreplace"))
            lost = self.lost
            if lost > self._told:
                lost, self._told = lost - self._told, lost
                self._on_lost(lost)

    def _write_all(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:  # somebody who shares the descriptor made it so
                select.select((), (self._fd,), ())


@contextlib.contextmanager
def stderr_beside(on_lost: Callable[[int], None]) -> Iterator[None]:
    """For as long as this lasts, everything that is written to ``sys.stderr`` goes by a thread of its own."""
    before = sys.stderr
    try:
        beside = Beside(before.fileno(), on_lost)
    except (AttributeError, OSError, ValueError):  # no standard error, or not a file
        yield
        return
    before.flush()
    sys.stderr = beside
    try:
        yield
    finally:
        sys.stderr = before
        beside.finish()
