"""PX4's MAVLink sender: which sample goes into which message, how old it is by then, what faults do to it."""

from collections import deque
from typing import TYPE_CHECKING

from daemon.sim.sample import Fields, Sample
from daemon.sim.streams import Streams
from daemon.sim.telemetry import MESSAGES

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

_ESTIMATE_AGE_US = 12_000  # an estimate has made its way to the sender after this
_SENSED_STEPS = 3  # attitude and IMU samples of the last steps: the oldest, 8 ms ago, is what is being sent
_SENSED = frozenset(("ATTITUDE", "ATTITUDE_QUATERNION", "HIGHRES_IMU"))
_SAMPLED = _SENSED | {"ODOMETRY", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"}


class Sender:
    """``streams`` says what is due; a message without a new sample waits. ``status_us``: the last news of the mode."""

    def __init__(self, px4: "SimulatedPx4") -> None:
        self._px4 = px4
        self.streams = Streams()
        self.status_us = 0
        self._estimates: deque[tuple[int, Sample]] = deque(maxlen=8)
        self._sensed: deque[tuple[int, Sample]] = deque(maxlen=_SENSED_STEPS)
        self._sent_us: dict[str, int] = {}

    def note_estimate(self) -> None:
        """The estimator has an output."""
        self._estimates.append((self._px4.simulated_us, self._px4.present))

    def note_sensors(self) -> None:
        """The sensors have an output: every step."""
        self._sensed.append((self._px4.simulated_us, self._px4.present))

    def step(self) -> None:
        """Send what is due and new."""
        px4 = self._px4
        for name in self.streams.due(px4.simulated_us, self._has_news):
            made_us, sample = self._newest(name)
            self._sent_us[name] = made_us
            fields: Fields | None = MESSAGES[name](px4, sample)
            if fields is not None and name in px4.faults.spoilt:
                fields = px4.faults.spoil(name, fields)
            if fields is not None:
                px4.send(name, fields)

    def send_now(self, name: str) -> bool:
        """REQUEST_MESSAGE, answered at once with what is of now. False: there is no news of the mode."""
        px4 = self._px4
        if name == "CURRENT_MODE":
            if not self._has_news(name):
                return False
            self._sent_us[name] = px4.simulated_us
        px4.send(name, MESSAGES[name](px4, px4.present))
        return True

    def _has_news(self, name: str) -> bool:
        if name == "CURRENT_MODE":
            return self.status_us > self._sent_us.get(name, -1)
        return name not in _SAMPLED or self._newest(name)[0] != self._sent_us.get(name)

    def _newest(self, name: str) -> tuple[int, Sample]:
        """The newest sample that has made its way to the sender of this message, and when it was made."""
        now_us = self._px4.simulated_us
        if name in _SENSED:
            return self._sensed[0]
        if name in _SAMPLED:
            for entry in reversed(self._estimates):
                if entry[0] <= now_us - _ESTIMATE_AGE_US:
                    return entry
        return now_us, self._px4.present
