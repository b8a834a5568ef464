"""Parameters that are being read. Without I/O: times come in, requests to repeat go out."""

from collections.abc import Callable
from dataclasses import dataclass

from daemon.autopilot.px4 import Message, param_request_read

Value = float | int | None


@dataclass(slots=True)
class _Read:
    done: Callable[[Value], None]
    deadline_s: float
    resend_s: float


class ParamReads:
    """Waits for PARAM_VALUE or PARAM_ERROR by name; None stands for unknown or unanswered."""

    def __init__(self, resend_s: float = 0.25) -> None:
        self._resend_s = resend_s
        self._reads: dict[str, _Read] = {}

    def start(self, name: str, now_s: float, timeout_s: float, done: Callable[[Value], None]) -> Message:
        """Returns the request to send; a read of the same name that still waits ends with None."""
        self.settle(name, None)
        self._reads[name] = _Read(done, now_s + timeout_s, now_s + self._resend_s)
        return param_request_read(name)

    def settle(self, name: str, value: Value) -> None:
        """An answer has come; one that nobody waits for is dropped."""
        read = self._reads.pop(name, None)
        if read is not None:
            read.done(value)

    def poll(self, now_s: float) -> list[Message]:
        """End what is overdue; returns what must be asked again."""
        again: list[Message] = []
        for name, read in list(self._reads.items()):
            if now_s >= read.deadline_s:
                self.settle(name, None)
            elif now_s >= read.resend_s:
                read.resend_s = now_s + self._resend_s
                again.append(param_request_read(name))
        return again

    def fail(self) -> None:
        """Nobody will answer any more."""
        for name in list(self._reads):
            self.settle(name, None)
