"""Lines of bytes, without I/O."""

from daemon.goals.errors import MAX_LINE_BYTES, ErrorCode, ProtocolError


class LineSplitter:
    """Bytes in, lines out; holds what was fed and not taken."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._searched = 0

    @property
    def ready(self) -> bool:
        """Tell whether `take` has something to say: a line, or that it is too long."""
        return b"\n" in self._buffer or len(self._buffer) > MAX_LINE_BYTES

    @property
    def held(self) -> int:
        """Bytes that were fed and not taken."""
        return len(self._buffer)

    def feed(self, data: bytes | memoryview) -> None:
        """Add what was received."""
        self._buffer += data

    def take(self) -> bytes | None:
        """Next line without its end, empty when it is blank; None if there is none.

        Raises `ProtocolError` (INVALID_REQUEST) when a line is too long: nothing after it can be trusted.
        """
        end = self._buffer.find(b"\n", self._searched)
        if (end if end >= 0 else len(self._buffer)) > MAX_LINE_BYTES:
            reason = f"the line is longer than {MAX_LINE_BYTES} bytes; the connection is closed"
            raise ProtocolError(ErrorCode.INVALID_REQUEST, reason)
        if end < 0:
            self._searched = len(self._buffer)
            return None
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        self._searched = 0
        return line.strip()

    def finish(self) -> None:
        """The other side sends no more: what is left counts as a line."""
        if self._buffer and not self._buffer.endswith(b"\n"):
            self._buffer += b"\n"
