"""Who waits for which acknowledgement. Without I/O: times come in, messages to repeat go out."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from daemon.autopilot.events import RESULT_ACCEPTED, RESULT_IN_PROGRESS
from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError, LinkError
from daemon.autopilot.px4 import CMD_ARM, CMD_TAKEOFF, Message
from daemon.messages import FlightMode


@dataclass(frozen=True, slots=True)
class _ModeRequest:
    mode: FlightMode
    sent_s: float


class ModeAcks:
    """DO_SET_MODE is acknowledged twice: the first is always 0, the second is the true result (PX4 as measured).

    No ack says which request or which of the two it is, and on a slow link a second one comes after the first one of a
    later request. But first acks come in the order of the requests, and second ones too: of how many requests the first
    and the second ack may have come is followed in all ways that fit, and a refusal is told when all agree on its mode.
    A request counts for ``forget_s``, for an ack of it may be lost.
    """

    def __init__(self, forget_s: float = 1.0) -> None:
        self._forget_s = forget_s
        self._waiting: deque[_ModeRequest] = deque()
        self._come: set[tuple[int, int]] = {(0, 0)}  # first and second acks of those that wait

    def requested(self, mode: FlightMode, now_s: float) -> None:
        """A request has left."""
        self._forget(now_s)
        self._waiting.append(_ModeRequest(mode, now_s))

    def ack(self, result: int, now_s: float) -> FlightMode | None:
        """An ack has come: the mode that it refuses, or None."""
        self._forget(now_s)
        if result == RESULT_IN_PROGRESS:
            return None
        seconds = {(first, second + 1) for first, second in self._come if second < first}
        if result == RESULT_ACCEPTED:
            asked = len(self._waiting)
            self._settle({(first + 1, second) for first, second in self._come if first < asked} | seconds)
            return None
        refused = {self._waiting[second - 1].mode for _, second in seconds}
        if not seconds and self._waiting:  # a first ack was lost
            refused, seconds = {request.mode for request in self._waiting}, {(1, 1)}
        self._settle(seconds)
        return refused.pop() if len(refused) == 1 else None

    def clear(self) -> None:
        """Nobody waits any more."""
        self._waiting.clear()
        self._come = {(0, 0)}

    def _settle(self, come: set[tuple[int, int]]) -> None:
        """An ack was one of these; one that fits no request changes nothing."""
        self._come = come or self._come
        for _ in range(min(second for _, second in self._come)):
            self._drop_oldest()

    def _forget(self, now_s: float) -> None:
        while self._waiting and now_s - self._waiting[0].sent_s > self._forget_s:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        self._waiting.popleft()
        self._come = {(max(first - 1, 0), max(second - 1, 0)) for first, second in self._come}


Done = Callable[[LinkError | None], None]


@dataclass(slots=True)
class _Pending:
    message: Message
    done: Done
    deadline_s: float
    resend_s: float
    result: int | None = None
    refused_s: float = field(default=float("inf"))
    report_s: float = field(default=float("inf"))


class CommandAcks:
    """Commands that wait for their ack, by command number; repeated while there is none.

    A refusal is reported ``reason_wait_s`` after its ack, because the EVENT that explains it follows the ack; after a
    poll that comes ``late_s`` after the one before, the EVENT may wait to be read: then at the next poll.
    """

    def __init__(self, resend_s: float = 0.5, reason_wait_s: float = 0.05, late_s: float = 0.2) -> None:
        self._resend_s = resend_s
        self._reason_wait_s = reason_wait_s
        self._late_s = late_s
        self._polled_s = float("inf")
        self._pending: dict[int, _Pending] = {}

    def start(self, message: Message, now_s: float, timeout_s: float, done: Done) -> None:
        """A command has left; a later one of the same number takes the place of an earlier one."""
        command = int(message[1]["command"])
        earlier = self._pending.pop(command, None)
        self._pending[command] = _Pending(message, done, now_s + timeout_s, now_s + self._resend_s)
        if earlier is not None:
            earlier.done(CommandTimeoutError(f"command {command} was replaced by a later one"))

    def ack(self, command: int, result: int, now_s: float) -> None:
        """An ack has come; in progress: keep waiting and do not repeat."""
        pending = self._pending.get(command)
        if pending is None or pending.result is not None:
            return
        if result == RESULT_ACCEPTED:
            del self._pending[command]
            pending.done(None)
        elif result == RESULT_IN_PROGRESS:
            pending.resend_s = float("inf")
        else:
            pending.result, pending.refused_s = result, now_s
            pending.report_s = now_s + self._reason_wait_s

    def poll(self, now_s: float, why: Callable[[int, float], str], *, heard: bool) -> list[Message]:
        """Report what is due; returns what must be sent again. ``why`` puts a MAV_RESULT of a time in words.

        Nothing is repeated before the autopilot is ``heard``: somebody else may have the vehicle by then.
        """
        again: list[Message] = []
        late, self._polled_s = now_s - self._polled_s > self._late_s, now_s
        for command, pending in list(self._pending.items()):
            if pending.result is not None and now_s >= pending.report_s:
                if late:
                    continue
                del self._pending[command]
                pending.done(CommandRefusedError(why(pending.result, pending.refused_s)))
            elif pending.result is None and now_s >= pending.deadline_s:
                del self._pending[command]
                pending.done(CommandTimeoutError(f"command {command} was not acknowledged"))
            elif heard and pending.result is None and now_s >= pending.resend_s:
                pending.resend_s = now_s + self._resend_s
                name, fields = pending.message
                pending.message = (name, fields | {"confirmation": fields["confirmation"] + 1})
                again.append(pending.message)
        return again

    def mode_changed(self, mode: FlightMode) -> None:
        """A take-off that shows counts as acknowledged. Nothing is repeated: somebody else may have the vehicle now."""
        for command, pending in list(self._pending.items()):
            pending.resend_s = float("inf")
            if command == CMD_TAKEOFF and mode is FlightMode.TAKEOFF:
                self.ack(command, RESULT_ACCEPTED, 0.0)

    def armed_changed(self, armed: bool) -> None:
        """What was asked for and shows counts as acknowledged; who is disarmed meanwhile is not armed again."""
        pending = self._pending.get(CMD_ARM)
        if pending is None:
            return
        arms = pending.message[1]["param1"] == 1.0
        if arms == armed:
            self.ack(CMD_ARM, RESULT_ACCEPTED, 0.0)
        elif arms:
            pending.resend_s = float("inf")

    def drop(self, done: Done) -> None:
        """Whoever gave this does not wait any more: the command is not repeated."""
        self._pending = {command: pending for command, pending in self._pending.items() if pending.done is not done}

    def fail(self, error: LinkError) -> None:
        """Give every waiting command this end."""
        pending, self._pending = list(self._pending.values()), {}
        for waiting in pending:
            waiting.done(error)
