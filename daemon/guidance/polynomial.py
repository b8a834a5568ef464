"""Motion primitives of constant jerk, from the flown state on; and the seven candidates of a jerk's size.

Source: the polynomial trajectories of mavros_controllers; the jerk is the parameter, not six times it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from daemon.frames import norm, scale
from daemon.guidance.constant_jerk import carried
from daemon.guidance.plan import Plan, straights
from daemon.messages import ZERO3, Reference, Vec3

DIRECTIONS: tuple[Vec3, ...] = (
    ZERO3,
    (1.0, 0.0, 0.0),
    (-1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, -1.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.0, 0.0, -1.0),
)
_REAL = 1e-9  # imaginary part of a root that is a real one


class PolynomialPlan(Plan):
    """Constant jerk for a time. It does not end at rest: a brake follows it."""

    def __init__(self, start: Reference, jerk_ned_m_s3: Vec3, duration_s: float) -> None:
        self.start_s = start.time_s
        self._start = start
        self._jerk = jerk_ned_m_s3
        self._duration_s = duration_s

    @property
    def end_s(self) -> float:
        """End of the jerk."""
        return self.start_s + self._duration_s

    @property
    def target(self) -> Reference:
        """The state at the end, moving."""
        return self.sample(self.end_s)

    def sample(self, time_s: float) -> Reference:
        """The polynomial at a time, before the end and beyond."""
        start = self._start
        motion = (start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2)
        position, velocity, acceleration = carried(motion, self._jerk, max(0.0, time_s - self.start_s))
        return replace(
            start,
            time_s=time_s,
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            acceleration_ned_m_s2=acceleration,
            jerk_ned_m_s3=self._jerk,
        )

    def extremes(self) -> tuple[Reference, ...]:
        """The ends, where acceleration is largest, and where horizontal or vertical speed is extreme: v a = 0."""
        v, a, j = self._start.velocity_ned_m_s, self._start.acceleration_ned_m_s2, self._jerk

        def across(one: Vec3, other: Vec3) -> float:
            return one[0] * other[0] + one[1] * other[1]

        level = (0.5 * across(j, j), 1.5 * across(a, j), across(a, a) + across(v, j), across(v, a))
        since_s = [0.0, self._duration_s, *(root.real for root in np.roots(level) if abs(root.imag) < _REAL)]
        since_s += [] if j[2] == 0.0 else [-a[2] / j[2]]
        return tuple(self.sample(self.start_s + s) for s in since_s if 0.0 <= s <= self._duration_s)

    def polyline(self) -> Iterator[Vec3]:
        """By its acceleration, which is largest at one of the ends."""
        largest = max(norm(end.acceleration_ned_m_s2) for end in (self._start, self.target))
        count = straights(self._duration_s, largest)
        for i in range(count + 1):
            yield self.sample(self.start_s + self._duration_s * i / count).position_ned_m


def candidates(start: Reference, jerk_m_s3: float, duration_s: float) -> tuple[PolynomialPlan, ...]:
    """The seven primitives of mavros_controllers: no jerk, and a jerk of this size to either side of each axis."""
    return tuple(PolynomialPlan(start, scale(direction, jerk_m_s3), duration_s) for direction in DIRECTIONS)
