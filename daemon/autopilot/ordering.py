"""The order of samples by the autopilot's stamps: what was overtaken on its way, a clock set back, a reboot."""

from dataclasses import dataclass
from enum import Enum


class Order(Enum):
    """NEWER: take it. OVERTAKEN: a newer one is known. REBOOTED: take it once the reboot is dealt with."""

    NEWER = "newer"
    OVERTAKEN = "overtaken"
    REBOOTED = "rebooted"


@dataclass(slots=True)
class _Newest:
    stamp_us: int
    arrival_s: float
    behind: int = 0


class SampleOrder:
    """Judges the stamps of several streams, each by itself.

    A sample behind the newest was overtaken, unless ``set_back_samples`` in a row are: then the clock was set back.
    ``reboot_step_s``: one behind by more is of an autopilot that has rebooted, when its uptime fits into the time since
    the newest came, within ``reboot_slack_s``; a clock that was merely set back shows a longer one.
    """

    def __init__(self, *, set_back_samples: int = 3, reboot_step_s: float = 1.0, reboot_slack_s: float = 0.5) -> None:
        self._set_back_samples = set_back_samples
        self._reboot_step_s = reboot_step_s
        self._reboot_slack_s = reboot_slack_s
        self._newest: dict[str, _Newest] = {}

    def restart(self) -> None:
        """Forget all: the autopilot has rebooted."""
        self._newest.clear()

    def judge(self, name: str, stamp_us: int, arrival_s: float) -> Order:
        """The place of a sample of a stream; only one that is NEWER is remembered."""
        newest = self._newest.get(name)
        if newest is not None and stamp_us < newest.stamp_us:
            behind_s = (newest.stamp_us - stamp_us) * 1e-6
            silent_s = arrival_s - newest.arrival_s
            if behind_s > self._reboot_step_s and stamp_us * 1e-6 <= silent_s + self._reboot_slack_s:
                return Order.REBOOTED
            newest.behind += 1
            if newest.behind < self._set_back_samples:
                return Order.OVERTAKEN
        self._newest[name] = _Newest(stamp_us, arrival_s)
        return Order.NEWER
