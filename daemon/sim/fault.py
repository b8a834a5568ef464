"""A fault: something that begins on a simulated PX4 and, maybe, ends."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """``duration_s``: None lasts until it is cleared."""

    duration_s: float | None = None
    lasts: ClassVar[bool] = True

    def check(self, px4: "SimulatedPx4") -> None:
        """Raise ValueError when it does not fit the vehicle."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Make it happen."""

    def end(self, px4: "SimulatedPx4") -> None:
        """Undo it."""


def one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    """Raise ValueError when a value is not among the known."""
    if value not in known:
        raise ValueError(f"{name}: {value!r} is none of {', '.join(known)}")
