"""Random numbers for the simulation: one seeded generator, drawn in blocks because single draws are slow."""

from collections.abc import Iterator
from math import exp, sqrt

import numpy as np

_BLOCK = 4096


def normals(seed: int, *stream: int) -> Iterator[float]:
    """Standard normal numbers without end, the same for the same seed; each stream of a seed is independent."""
    generator = np.random.default_rng((seed, *stream))
    while True:
        yield from generator.standard_normal(_BLOCK).tolist()


class Coloured:
    """First-order Gauss-Markov noise (Ornstein-Uhlenbeck), unit standard deviation, sampled every ``dt_s``."""

    __slots__ = ("_drive", "_keep", "value")

    def __init__(self, time_constant_s: float, dt_s: float, first: float = 0.0) -> None:
        self._keep = exp(-dt_s / time_constant_s)
        self._drive = sqrt(1.0 - self._keep * self._keep)
        self.value = first

    def update(self, normal: float) -> float:
        """The next value from a standard normal number."""
        self.value = self._keep * self.value + self._drive * normal
        return self.value
