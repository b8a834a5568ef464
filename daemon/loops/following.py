"""Whether the vehicle follows its reference: from where a new plan starts, and when a goal has to be given up.

A plan moves with time alone. In a wind, or with a load, that the limits do not leave enough thrust or tilt for, its
reference goes on without the vehicle.
"""

from math import inf

from daemon.frames import norm
from daemon.messages import Reference
from daemon.pipeline import Record, at_rest

NEAR_M = 2.0  # from a reference farther off, going on without a step would mean to fly there first
BEHIND_S = 1.0


def start_of(record: Record) -> Reference:
    """The reference that a new plan starts from: the flown one, or the vehicle's motion when that one is far off."""
    assert record.reference is not None
    if record.predicted is None or deviation_m(record) <= NEAR_M:
        return record.reference
    return at_rest(record.predicted, record.reference.time_s)


def deviation_m(record: Record) -> float:
    """Distance between the vehicle and the flown reference, metres; 0 when the law does not fly."""
    return 0.0 if record.control is None else norm(record.control.position_error_ned_m)


class Following:
    """Remembers since when the vehicle is too far from its reference."""

    def __init__(self) -> None:
        self._since_s = inf

    def given_up(self, record: Record, deviation_max_m: float) -> bool:
        """Whether the vehicle has been farther off than ``deviation_max_m`` for ``BEHIND_S`` by now."""
        self._since_s = min(self._since_s, record.now_s) if deviation_m(record) > deviation_max_m else inf
        return record.now_s - self._since_s >= BEHIND_S
