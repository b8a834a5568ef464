"""When messages came, and whether what comes is of now; pure.

What comes after a silence may have waited, in a radio or, when we stood still, in our own socket: it tells of the past,
until TIMESYNC answers a request that was sent since. An autopilot that never answered one is believed, and so is one
that does not while messages flow for ``UNANSWERED_S``.
"""

from math import inf

QUIET_S = 0.2  # ODOMETRY alone comes every 10 ms
UNANSWERED_S = 5.0  # what waited comes in a burst, its answer behind it: longer than any buffer takes to drain


class Arrivals:
    """``note`` takes the time of each message; any one thread at a time."""

    def __init__(self) -> None:
        self._last_s = -inf
        self._silence_ended_s = -inf

    def note(self, now_s: float) -> None:
        """A message has come."""
        if now_s - max(self._last_s, self._silence_ended_s) > QUIET_S:
            self._silence_ended_s = now_s
        self._last_s = now_s

    def stood_still(self, now_s: float) -> None:
        """What has come, and waits for us, tells of the past. A suspended machine's clock may not have seen it pass."""
        self._silence_ended_s = now_s

    def silent_for(self, duration_s: float, now_s: float) -> bool:
        """No message has come for longer than this."""
        return now_s - self._last_s > duration_s

    def of_now(self, answered_s: float) -> bool:
        """What comes has not waited since before the last silence; ``answered_s`` as ``TimeSync`` has it."""
        unanswered_s = self._last_s - self._silence_ended_s
        return answered_s == -inf or answered_s >= self._silence_ended_s or unanswered_s > UNANSWERED_S

    def sent_after(self, answered_s: float, now_s: float) -> float:
        """What comes now was sent after this; of an autopilot that does not answer it is believed to come at once."""
        return now_s if now_s - answered_s > UNANSWERED_S else answered_s
