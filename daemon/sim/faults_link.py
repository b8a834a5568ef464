"""Faults of the link, of the telemetry and of the autopilot as a computer."""

from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING, ClassVar

from daemon.sim.fault import Fault, one_of
from daemon.sim.link_faults import PERFECT, LinkFaults, LinkQuality
from daemon.sim.sample import Fields

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


@dataclass(frozen=True, slots=True, kw_only=True)
class Link(Fault):
    """A bad link; ``direction`` is ``up`` (to PX4), ``down`` (from PX4) or ``both``."""

    direction: str = "both"
    silent: bool = False
    loss: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    reordering: float = 0.0

    def __post_init__(self) -> None:
        one_of("direction", self.direction, ("up", "down", "both"))

    def begin(self, px4: "SimulatedPx4") -> None:
        """Replace the link's quality."""
        names = ("silent", "loss", "delay_s", "jitter_s", "reordering")
        for link in self._links(px4):
            link.quality = LinkQuality(**{name: getattr(self, name) for name in names})

    def end(self, px4: "SimulatedPx4") -> None:
        """A perfect link again."""
        for link in self._links(px4):
            link.quality = PERFECT

    def _links(self, px4: "SimulatedPx4") -> list[LinkFaults]:
        return [link for name, link in px4.links.items() if self.direction in (name, "both")]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoiltTelemetry(Fault):
    """Base of what happens to messages on their way out."""

    messages: tuple[str, ...] = ("ODOMETRY",)

    def spoil(self, fields: Fields, first: Fields) -> Fields | None:
        """The message instead of ``fields``; ``first`` was the first one since the fault began. None: not sent."""
        return fields


@dataclass(frozen=True, slots=True, kw_only=True)
class FrozenTelemetry(SpoiltTelemetry):
    """Messages come with the values they had; ``stamps_advance``: with new stamps, as a stuck estimator sends them."""

    stamps_advance: bool = True

    def spoil(self, fields: Fields, first: Fields) -> Fields | None:
        """The first message again."""
        advancing = ("time_usec", "time_boot_ms") if self.stamps_advance else ()
        return first | {key: fields[key] for key in advancing if key in fields}


@dataclass(frozen=True, slots=True, kw_only=True)
class NanTelemetry(SpoiltTelemetry):
    """Every float of the messages is NaN."""

    def spoil(self, fields: Fields, first: Fields) -> Fields | None:
        """NaN for every float."""
        return {key: _nan(value) for key, value in fields.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class StoppedTelemetry(SpoiltTelemetry):
    """The messages do not come."""

    def spoil(self, fields: Fields, first: Fields) -> Fields | None:
        """Nothing."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockStep(Fault):
    """The autopilot's clock jumps by ``step_s``, forwards or backwards."""

    lasts: ClassVar[bool] = False

    step_s: float = 1.0

    def begin(self, px4: "SimulatedPx4") -> None:
        """Step."""
        px4.clock_offset_us += round(self.step_s * 1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reboot(Fault):
    """The autopilot starts anew: motors off, clock at zero."""

    lasts: ClassVar[bool] = False

    def begin(self, px4: "SimulatedPx4") -> None:
        """Reboot at the end of this step."""
        px4.reboot_soon = True


@dataclass(frozen=True, slots=True, kw_only=True)
class NoAcks(Fault):
    """Commands are carried out and never acknowledged."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Fall silent."""
        px4.commander.silent = True

    def end(self, px4: "SimulatedPx4") -> None:
        """Acknowledge again."""
        px4.commander.silent = False


def _nan(value: object) -> object:
    if isinstance(value, float):
        return nan
    if isinstance(value, list) and value and isinstance(value[0], float):
        return [nan] * len(value)
    return value
