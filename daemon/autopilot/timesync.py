"""Our side of TIMESYNC, without I/O: asks the autopilot for its time and keeps the quickest answers.

A request carries our time, the answer the autopilot's beside it (MAVLink time synchronization protocol). The
autopilot read its clock between our sending and the arrival, which bounds the offset; of the quickest exchanges the
middle is near the truth. A line through them follows a clock that runs slow (a simulated autopilot: 1-2 %).

When all exchanges become slower the link has changed, not the clocks: the line is held, or a delay of one direction
would pass as half of it in each. What the link adds is then known for each direction. The longer it lasts the less the
line is worth, and slower exchanges count again.
"""

from collections import deque
from dataclasses import dataclass
from math import inf, sqrt
from statistics import median_low

from daemon.autopilot.px4 import Fields, Message
from daemon.messages import ClockSync

REQUEST_S = 0.1  # between requests, as often as PX4 asks
WINDOW_S = 3.0
LEAST = 4  # exchanges that make a first estimate
RECENT_S = 0.5  # of exchanges that tell what the link takes now: one or two that were held up tell nothing
STALE_S = 1.0  # without an answer for so long nothing is known
_KEPT = 64  # requests whose answers are awaited: there and back in six seconds
_STEP_MARGIN_S = 0.01  # of a bound that is broken when a clock stepped; a simulator's clock has steps of 4 ms
_SLOWER, _SLOWER_S = 1.5, 0.002  # an exchange counts up to so many times half the quickest round trip, and so much more
_FORGET = 0.0005  # of that quickest one in a second; quartz drifts by a tenth of it
_DRIFT_SHARE = 0.03  # of an exchange in the drift with which a line is held: the last ones lean on the slower link
_SLOPE_SIGMAS = 4.0  # a drift that stands out of its own error by less is taken as none


@dataclass(frozen=True, slots=True)
class Exchange:
    """``remote_us``: the autopilot's clock; ``offset_s``: ours minus it in the middle; ``round_trip_s``."""

    remote_us: int
    offset_s: float
    round_trip_s: float
    arrival_s: float


class TimeSync:
    """``receive`` takes TIMESYNC, ``poll`` gives requests; ``sync`` is what is known, None: nothing.

    ``answered_s``: when the newest request that was answered was sent; what comes after its answer is younger.
    """

    def __init__(self) -> None:
        self.sync: ClockSync | None = None
        self.answered_s = -inf
        self._asked: dict[int, float] = {}
        self._asked_s = -inf
        self._window: deque[Exchange] = deque()
        self._least_s = inf
        self._drift = 0.0

    def restart(self) -> None:
        """Forget all: another clock, or the same after a long silence."""
        self.sync = None
        self._window.clear()
        self._least_s = inf

    def poll(self, now_s: float) -> list[Message]:
        """The request that is due, if one is. What was known is dropped when answers have stopped."""
        if self._window and now_s - self._window[-1].arrival_s > STALE_S:
            self.restart()
        return [self.ask(now_s)] if now_s - self._asked_s >= REQUEST_S else []

    def ask(self, now_s: float) -> Message:
        """A request, due or not."""
        self._asked_s = now_s
        sent_ns = _nanoseconds(now_s)
        self._asked[sent_ns] = now_s
        while len(self._asked) > _KEPT:
            del self._asked[next(iter(self._asked))]
        return ("TIMESYNC", {"tc1": 0, "ts1": sent_ns})

    def receive(self, fields: Fields, arrival_s: float) -> list[Message]:
        """An answer to us is taken; a request is answered. Raises KeyError, TypeError, ValueError when malformed."""
        remote_ns, ours_ns = int(fields["tc1"]), int(fields["ts1"])
        if remote_ns == 0:
            return [("TIMESYNC", {"tc1": _nanoseconds(arrival_s), "ts1": ours_ns})]
        sent_s = self._asked.pop(ours_ns, None)
        if sent_s is not None:  # not an answer to another, nor a second one
            self.answered_s = max(self.answered_s, sent_s)
            offset = 0.5 * (sent_s + arrival_s) - remote_ns * 1e-9
            self._take(Exchange(remote_ns // 1000, offset, arrival_s - sent_s, arrival_s))
        return []

    def _take(self, exchange: Exchange) -> None:
        window = self._window
        if self._contradicts(exchange):
            self.restart()
        window.append(exchange)
        while exchange.arrival_s - window[0].arrival_s > WINDOW_S:
            window.popleft()
        if len(window) >= LEAST:
            self.sync = self._line(list(window))

    def _line(self, window: list[Exchange]) -> ClockSync:
        """Through what is about as quick as ever; while the newest is not, what is known goes on."""
        newest, before = window[-1], self.sync
        elapsed_s = 0.0 if before is None else (newest.remote_us - before.stamp_us) * 1e-6
        self._least_s = min(self._least_s + _FORGET * elapsed_s, 0.5 * min(e.round_trip_s for e in window))
        quick = [e for e in window if 0.5 * e.round_trip_s <= _SLOWER * self._least_s + _SLOWER_S]
        round_trip_s = _round_trip_s(window)
        if before is not None and (len(quick) < LEAST or quick[-1] is not newest):
            uncertainty_s = before.uncertainty_s + _FORGET * elapsed_s
            offset_s = before.offset_at(newest.remote_us)
            return ClockSync(newest.remote_us, offset_s, self._drift, uncertainty_s, round_trip_s)
        line = fitted(quick if len(quick) >= LEAST else window, newest.remote_us, round_trip_s)
        self._drift = line.drift if before is None else self._drift + _DRIFT_SHARE * (line.drift - self._drift)
        return line

    def _contradicts(self, exchange: Exchange) -> bool:
        """True when no delay on the way explains the answer: one of the clocks stepped, or stood still."""
        if not self._window:
            return False
        last = self._window[-1]
        expected, uncertain = last.offset_s, 0.5 * last.round_trip_s
        if self.sync is not None:
            expected, uncertain = self.sync.offset_at(exchange.remote_us), self.sync.uncertainty_s
        allowed = uncertain + 0.5 * exchange.round_trip_s + _STEP_MARGIN_S
        return exchange.remote_us < last.remote_us or abs(exchange.offset_s - expected) > allowed


def fitted(window: list[Exchange], newest: int, round_trip_s: float) -> ClockSync:
    """A line through the quicker half of the exchanges, as of ``newest``, microseconds of the autopilot's clock.

    Uncertain by half a round trip and noise.
    """
    quick = sorted(window, key=lambda e: e.round_trip_s)[: max(LEAST, len(window) // 2)]
    points = [((e.remote_us - newest) * 1e-6, e.offset_s) for e in quick]
    count = len(points)
    mean_t = sum(t for t, _ in points) / count
    mean_o = sum(o for _, o in points) / count
    spread = sum((t - mean_t) ** 2 for t, _ in points)
    slope = sum((t - mean_t) * (o - mean_o) for t, o in points) / spread if spread > 0.0 else 0.0
    noise = _noise(points, mean_t, mean_o, slope)
    if abs(slope) * sqrt(spread) <= _SLOPE_SIGMAS * noise:
        slope, noise = 0.0, _noise(points, mean_t, mean_o, 0.0)
    uncertainty_s = 0.5 * quick[0].round_trip_s + noise
    return ClockSync(newest, mean_o - slope * mean_t, slope, uncertainty_s, round_trip_s)


def _round_trip_s(window: list[Exchange]) -> float:
    """The middle one of the last ``RECENT_S``."""
    since_s = window[-1].arrival_s - RECENT_S
    return median_low(e.round_trip_s for e in window if e.arrival_s >= since_s)


def _noise(points: list[tuple[float, float]], mean_t: float, mean_o: float, slope: float) -> float:
    """Standard deviation about the line through the means."""
    square = sum((o - mean_o - slope * (t - mean_t)) ** 2 for t, o in points)
    return sqrt(square / max(1, len(points) - 2))


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)
