"""The one table of what we ask the autopilot to send, and the check of what arrives."""

from dataclasses import dataclass

from daemon.autopilot.px4 import CURRENT_MODE_ID, Message, request_message, set_message_interval


@dataclass(frozen=True, slots=True)
class Stream:
    """A message that we ask for at ``rate_hz``; fewer than ``least_hz`` of them is a fault.

    0: not checked, for PX4 does not send it at all before it has a position or a home, or sends it on change only.
    ``once``: ask for one at once as well, for it is sent rarely or on change only.
    """

    name: str
    message_id: int
    rate_hz: float
    least_hz: float = 0.0
    once: bool = False


_ORIGIN = 49
ANSWERS = "answers to TIMESYNC"  # without which nothing tells what is of now

STREAMS: tuple[Stream, ...] = (
    Stream("ODOMETRY", 331, 100.0, least_hz=60.0),
    # For the cross-check of the tilt alone, which at 100 Hz would see the same (largest difference 7.3 deg, 8.2 at 50).
    Stream("HIGHRES_IMU", 105, 50.0, least_hz=30.0),
    # On news alone, 2 Hz. On each change PX4 tells the old mode first and the new one within 28 ms, one that lasts 3 ms
    # too; asked for at 20 Hz it is 65 ms, and of a mode that lasts 15 ms nothing is told (measured). 0.5 Hz by default.
    Stream("CURRENT_MODE", CURRENT_MODE_ID, 100.0, least_hz=1.0, once=True),
    Stream("EXTENDED_SYS_STATE", 245, 10.0, least_hz=3.0),
    Stream("SYS_STATUS", 1, 5.0, least_hz=1.5),
    Stream("GLOBAL_POSITION_INT", 33, 5.0),
    Stream("HOME_POSITION", 242, 1.0, once=True),
    Stream("GPS_GLOBAL_ORIGIN", _ORIGIN, 1.0, once=True),
)


def requests() -> list[Message]:
    """The commands that ask for the whole table."""
    messages = [set_message_interval(stream.message_id, stream.rate_hz) for stream in STREAMS]
    return messages + [request_message(stream.message_id) for stream in STREAMS if stream.once]


class StreamMonitor:
    """Counts arrivals and, once a period, names the streams that come too slowly, and ``ANSWERS`` when none came.

    Acknowledgements do not say what they are for: when fewer come than were asked for, all streams are asked for again.
    """

    PERIOD_S = 2.0
    LATE_S = 0.3

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._seen: set[str] = set()
        self._since_s: float | None = None
        self._unanswered = 0
        self._reset_counter: int | None = None
        self.slow: tuple[str, ...] = ()

    def restart(self, now_s: float) -> None:
        """Begin anew: the whole table has just been asked for."""
        self._seen.clear()
        self._unanswered = len(STREAMS)
        self.begin(now_s)

    def begin(self, now_s: float) -> None:
        """What came until now does not count: a period begins."""
        self._counts.clear()
        self._since_s = now_s

    def count(self, name: str) -> None:
        """One message has arrived."""
        self._counts[name] = self._counts.get(name, 0) + 1

    def acknowledged(self) -> None:
        """The autopilot has answered to a SET_MESSAGE_INTERVAL."""
        self._unanswered = max(0, self._unanswered - 1)

    def follow(self, reset_counter: int) -> list[Message]:
        """Ask after each reset of the estimate where the local frame lies: what told that it moved may be lost."""
        before, self._reset_counter = self._reset_counter, reset_counter
        return [] if before in (None, reset_counter) else [request_message(_ORIGIN)]

    def check(self, now_s: float) -> list[Message]:
        """At the end of a period, set ``slow`` and ask again for what is missed; at other times nothing.

        A period whose end we look at late is not judged: it was we who stood still.
        """
        if self._since_s is None or now_s - self._since_s < self.PERIOD_S:
            return []
        elapsed_s = now_s - self._since_s
        if elapsed_s > self.PERIOD_S + self.LATE_S:
            self.begin(now_s)
            return []
        self._seen.update(self._counts)
        lagging = tuple(s for s in STREAMS if self._counts.get(s.name, 0) < s.least_hz * elapsed_s)
        again = STREAMS if self._unanswered else lagging
        missing = [s for s in STREAMS if s.once and s.name not in self._seen]
        self.slow = tuple(stream.name for stream in lagging) + (() if ANSWERS in self._counts else (ANSWERS,))
        self._unanswered = len(again)
        self.begin(now_s)
        intervals = [set_message_interval(stream.message_id, stream.rate_hz) for stream in again]
        return intervals + [request_message(stream.message_id) for stream in missing]
