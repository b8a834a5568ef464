"""Wind: steady, gusts, and Dryden turbulence (MIL-F-8785C, low altitude)."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, hypot, pi, sqrt

from daemon.messages import ZERO3, Vec3

_LEAST_SPEED_M_S = 1.0  # Dryden's time constants are lengths over air speed; keeps them finite in still air


@dataclass(frozen=True, slots=True, eq=False)
class Gust:
    """One-minus-cosine gust: ``peak_ned_m_s`` in the middle of ``duration_s``."""

    peak_ned_m_s: Vec3
    duration_s: float


class Wind:
    """``steady_ned_m_s`` and ``turbulence_m_s`` (standard deviation of the horizontal gusts) may be set at any time."""

    def __init__(self, draw: Iterator[float]) -> None:
        self._draw = draw
        self.steady_ned_m_s: Vec3 = ZERO3
        self.turbulence_m_s = 0.0
        self._gust: Gust | None = None
        self._gust_s = 0.0
        self._turbulence: Vec3 = ZERO3

    def gust(self, gust: Gust) -> None:
        """Begin a gust now."""
        self._gust, self._gust_s = gust, 0.0

    def step(self, dt_s: float, height_m: float) -> Vec3:
        """Wind at the vehicle, NED."""
        if self._gust is None and self.turbulence_m_s == 0.0:
            return self.steady_ned_m_s
        x, y, z = self.steady_ned_m_s
        if self.turbulence_m_s > 0.0:
            self._turbulence = self._turbulent(dt_s, height_m)
            x, y, z = x + self._turbulence[0], y + self._turbulence[1], z + self._turbulence[2]
        if self._gust is not None:
            self._gust_s += dt_s
            if self._gust_s >= self._gust.duration_s:
                self._gust = None
            else:
                share = 0.5 * (1.0 - cos(2.0 * pi * self._gust_s / self._gust.duration_s))
                gx, gy, gz = self._gust.peak_ned_m_s
                x, y, z = x + gx * share, y + gy * share, z + gz * share
        return (x, y, z)

    def _turbulent(self, dt_s: float, height_m: float) -> Vec3:
        """First-order Dryden filters: horizontal length and intensity by height, vertical length the height."""
        height_ft = max(10.0, height_m / 0.3048)
        scale = 0.177 + 0.000823 * min(height_ft, 1000.0)
        horizontal_m = 0.3048 * height_ft / scale**1.2
        vertical_m = 0.3048 * height_ft
        speed = max(_LEAST_SPEED_M_S, hypot(*self.steady_ned_m_s))
        vertical_std = self.turbulence_m_s * scale**0.4
        stds, lengths = (
            (self.turbulence_m_s, self.turbulence_m_s, vertical_std),
            (horizontal_m, horizontal_m, vertical_m),
        )
        values = []
        for value, std, length in zip(self._turbulence, stds, lengths, strict=True):
            share = min(1.0, speed * dt_s / length)
            values.append(value * (1.0 - share) + std * sqrt(2.0 * share - share * share) * next(self._draw))
        return (values[0], values[1], values[2])
