"""Parameters that are being read. Without I/O: times come in, requests to repeat go out."""

from collections.abc import Callable
from dataclasses import dataclass

from daemon.autopilot.port import CommandTimeoutError, LinkError
from daemon.autopilot.px4 import Message, param_request_read

Answer = float | int | None | LinkError
Done = Callable[[Answer], None]


@dataclass(slots=True)
class _Read:
    done: Done
    deadline_s: float
    resend_s: float


class ParamReads:
    """Waits for PARAM_VALUE or PARAM_ERROR by name; None stands for what the autopilot does not know."""

    def __init__(self, resend_s: float = 0.25) -> None:
        self._resend_s = resend_s
        self._reads: dict[str, _Read] = {}

    def start(self, name: str, now_s: float, timeout_s: float, done: Done) -> Message:
        """Returns the request to send; a read of the same name that still waits has timed out."""
        self.settle(name, CommandTimeoutError(f"parameter {name} was asked for again"))
        self._reads[name] = _Read(done, now_s + timeout_s, now_s + self._resend_s)
        return param_request_read(name)

    def settle(self, name: str, answer: Answer) -> None:
        """An answer has come; one that nobody waits for is dropped."""
        read = self._reads.pop(name, None)
        if read is not None:
            read.done(answer)

    def poll(self, now_s: float) -> list[Message]:
        """End what is overdue; returns what must be asked again."""
        again: list[Message] = []
        for name, read in list(self._reads.items()):
            if now_s >= read.deadline_s:
                self.settle(name, CommandTimeoutError(f"parameter {name} was not answered"))
            elif now_s >= read.resend_s:
                read.resend_s = now_s + self._resend_s
                again.append(param_request_read(name))
        return again

    def fail(self, error: LinkError) -> None:
        """Give every waiting read this end."""
        for name in list(self._reads):
            self.settle(name, error)
