"""Standard output and error that never fail: how a command ends does not depend on who reads of it."""

import io
import os
import select
import sys
from typing import Any, TextIO

_FDS = {"stdin": 0, "stdout": 1, "stderr": 2}


class _Unfailing(io.FileIO):
    """A file descriptor that drops what cannot be written; ``lost`` since then."""

    def __init__(self, fd: int, lost: bool) -> None:
        super().__init__(fd, "w", closefd=False)
        self.lost = lost

    def write(self, data: Any) -> int:
        """Write, or drop and say so once where stderr can."""
        try:
            while (written := super().write(data)) is None:  # somebody made the terminal non-blocking
                select.select([], [self], [])
            return written
        except OSError as error:
            if not self.lost and self.fileno() == _FDS["stdout"]:
                self.lost = True
                print(f"the output cannot be written ({error.strerror})", file=sys.stderr)
            self.lost = True
            return len(data)


def prepare() -> None:
    """Make the standard streams of this process so; a closed one leads nowhere, a letter it does not have is a ?."""
    for name, fd in _FDS.items():
        stream = getattr(sys, name)
        if stream is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != fd:
                os.dup2(nowhere, fd)
                os.close(nowhere)
        if name == "stdin":
            continue
        encoding = "utf-8" if stream is None else stream.encoding
        raw = _Unfailing(fd, lost=stream is None)
        buffered: Any = io.BufferedWriter(raw)
        setattr(sys, name, io.TextIOWrapper(buffered, encoding, errors="replace", line_buffering=True))


def lost() -> bool:
    """Tell whether nobody gets what is printed."""
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return isinstance(raw, _Unfailing) and raw.lost


def on_terminal() -> bool:
    """Tell whether a person looks at stdout."""
    return sys.stdout.isatty()


def colours(stream: TextIO) -> bool:
    """Tell whether a stream shows colours to a person who wants them (https://no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR")
