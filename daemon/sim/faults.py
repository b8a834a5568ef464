"""Faults as data: each says what happens to a simulated PX4 when it begins and when it ends.

In files and at run time a fault is a mapping: ``{fault: gps_loss, duration_s: 10}``; a scenario is a list of them with
``at_s`` (simulated seconds from the start). Faults that pass by themselves or cannot end have no ``end``.
"""

from dataclasses import dataclass, field, fields
from math import inf, isfinite, nan, radians
from typing import TYPE_CHECKING, Any, ClassVar

from daemon.messages import ZERO3, FlightMode, Vec3
from daemon.sim.flight_tasks import Sticks
from daemon.sim.link_faults import PERFECT, LinkFaults, LinkQuality
from daemon.sim.modes import ALL_MODES, MANUAL_MODES
from daemon.sim.telemetry import Fields
from daemon.sim.wind import Gust

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

_RANGES = {
    "delay_s": (0.0, 60.0),
    "duration_s": (0.0, inf),
    "efficiency": (0.0, 1.5),
    "forward": (-1.0, 1.0),
    "fraction": (0.0, 1.0),
    "jitter_s": (0.0, 60.0),
    "loss": (0.0, 1.0),
    "mass_kg": (0.0, 100.0),
    "reordering": (0.0, 1.0),
    "right": (-1.0, 1.0),
    "throttle": (0.0, 1.0),
    "turbulence_m_s": (0.0, 50.0),
    "yaw": (-1.0, 1.0),
}
_MODES = tuple(mode.value for mode in ALL_MODES)


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
        _one_of("direction", self.direction, ("up", "down", "both"))

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
class EkfReset(Fault):
    """A reset of the estimate. ``kind``: position_ne, position_d, velocity_ne, velocity_d, heading.

    ``size_m`` or ``size_m_s`` go north (or down), ``size_deg`` clockwise. ``origin``: a position reset for good, as
    by a new origin; otherwise GPS pulls the estimate back.
    """

    lasts: ClassVar[bool] = False

    kind: str = "position_ne"
    size_m: float = 1.0
    size_m_s: float = 0.5
    size_deg: float = 20.0
    origin: bool = True

    def __post_init__(self) -> None:
        _one_of("kind", self.kind, ("position_ne", "position_d", "velocity_ne", "velocity_d", "heading"))

    def begin(self, px4: "SimulatedPx4") -> None:
        """Reset now."""
        estimator = px4.estimator
        if self.kind in ("position_ne", "position_d"):
            jump: Vec3 = (self.size_m, 0.0, 0.0) if self.kind == "position_ne" else (0.0, 0.0, self.size_m)
            if self.origin:
                estimator.move_origin((-jump[0], -jump[1], -jump[2]))
            else:
                estimator.offset_position(jump, 1)
        elif self.kind in ("velocity_ne", "velocity_d"):
            speed = self.size_m_s
            estimator.offset_velocity((speed, 0.0, 0.0) if self.kind == "velocity_ne" else (0.0, 0.0, speed))
        else:
            estimator.turn_heading(radians(self.size_deg))


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsLoss(Fault):
    """No satellites: the estimate drifts off while it looks calm, and jumps back when they return."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Lose GPS."""
        px4.parameters.set("SIM_GPS_USED", 0)

    def end(self, px4: "SimulatedPx4") -> None:
        """GPS is back."""
        px4.parameters.set("SIM_GPS_USED", 10)


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyWind(Fault):
    """Wind of this velocity (where it blows to, NED), with turbulence of this standard deviation."""

    north_m_s: float = 0.0
    east_m_s: float = 0.0
    down_m_s: float = 0.0
    turbulence_m_s: float = 0.0

    def begin(self, px4: "SimulatedPx4") -> None:
        """Blow."""
        px4.wind.steady_ned_m_s = (self.north_m_s, self.east_m_s, self.down_m_s)
        px4.wind.turbulence_m_s = self.turbulence_m_s

    def end(self, px4: "SimulatedPx4") -> None:
        """Calm."""
        px4.wind.steady_ned_m_s, px4.wind.turbulence_m_s = ZERO3, 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WindGust(Fault):
    """One gust with this peak; ``duration_s`` is its length (2 s when not given)."""

    lasts: ClassVar[bool] = False

    north_m_s: float = 0.0
    east_m_s: float = 0.0
    down_m_s: float = 0.0

    def begin(self, px4: "SimulatedPx4") -> None:
        """Begin the gust."""
        px4.wind.gust(Gust((self.north_m_s, self.east_m_s, self.down_m_s), self.duration_s or 2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorEfficiency(Fault):
    """A rotor (0 to 3, PX4's order) gives this share of its thrust."""

    rotor: int = 0
    efficiency: float = 0.8

    def check(self, px4: "SimulatedPx4") -> None:
        """There must be such a rotor."""
        if not 0 <= self.rotor < len(px4.rotor_efficiency):
            raise ValueError(f"rotor: {self.rotor} is not in 0 to {len(px4.rotor_efficiency) - 1}")

    def begin(self, px4: "SimulatedPx4") -> None:
        """Weaken it."""
        self._set(px4, self.efficiency)

    def end(self, px4: "SimulatedPx4") -> None:
        """Whole again."""
        self._set(px4, 1.0)

    def _set(self, px4: "SimulatedPx4", efficiency: float) -> None:
        values = list(px4.rotor_efficiency)
        values[self.rotor] = efficiency
        px4.rotor_efficiency = tuple(values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Payload(Fault):
    """More mass at the centre."""

    mass_kg: float = 0.2

    def begin(self, px4: "SimulatedPx4") -> None:
        """Take it on."""
        px4.payload_kg = self.mass_kg

    def end(self, px4: "SimulatedPx4") -> None:
        """Drop it."""
        px4.payload_kg = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryLow(Fault):
    """The charge falls to this fraction at once; ``failsafe``: PX4 acts on it (COM_LOW_BAT_ACT 3)."""

    fraction: float = 0.14
    failsafe: bool = True

    def begin(self, px4: "SimulatedPx4") -> None:
        """Empty it."""
        px4.battery.set(self.fraction)
        if self.failsafe:
            px4.parameters.set("CBRK_SUPPLY_CHK", 0)
            px4.parameters.set("COM_LOW_BAT_ACT", 3)

    def end(self, px4: "SimulatedPx4") -> None:
        """Full again."""
        px4.battery.set(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotTakesOver(Fault):
    """A pilot switches the mode (``hold``, ``position``, ``land`` ...) and, in manual modes, has the sticks."""

    lasts: ClassVar[bool] = False

    mode: str = "position"
    forward: float = 0.0
    right: float = 0.0
    throttle: float = 0.5
    yaw: float = 0.0

    def __post_init__(self) -> None:
        _one_of("mode", self.mode, _MODES)

    def begin(self, px4: "SimulatedPx4") -> None:
        """Switch."""
        mode = FlightMode(self.mode)
        if mode in MANUAL_MODES:
            px4.parameters.set("COM_RC_IN_MODE", 1)
            px4.receiver.pilot_holds(Sticks(self.forward, self.right, self.throttle, self.yaw))
        px4.pilot_switches_to(mode)


@dataclass(frozen=True, slots=True, kw_only=True)
class KillSwitch(Fault):
    """Motors stop at once, wherever the vehicle is."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Kill."""
        px4.commander.kill(True)

    def end(self, px4: "SimulatedPx4") -> None:
        """Release the switch."""
        px4.commander.kill(False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmingRefused(Fault):
    """Arming is denied."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Refuse."""
        px4.commander.refuse_arming = True

    def end(self, px4: "SimulatedPx4") -> None:
        """Allow."""
        px4.commander.refuse_arming = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ModesRefused(Fault):
    """These modes are refused (first ack accepted, second not, as PX4 does)."""

    modes: tuple[str, ...] = ("offboard",)

    def __post_init__(self) -> None:
        for mode in self.modes:
            _one_of("modes", mode, _MODES)

    def begin(self, px4: "SimulatedPx4") -> None:
        """Refuse."""
        px4.commander.refused_modes |= {FlightMode(mode) for mode in self.modes}

    def end(self, px4: "SimulatedPx4") -> None:
        """Allow."""
        px4.commander.refused_modes -= {FlightMode(mode) for mode in self.modes}


@dataclass(frozen=True, slots=True, kw_only=True)
class NoAcks(Fault):
    """Commands are carried out and never acknowledged."""

    def begin(self, px4: "SimulatedPx4") -> None:
        """Fall silent."""
        px4.commander.silent = True

    def end(self, px4: "SimulatedPx4") -> None:
        """Acknowledge again."""
        px4.commander.silent = False


FAULTS: dict[str, type[Fault]] = {
    "arming_refused": ArmingRefused,
    "battery_low": BatteryLow,
    "clock_step": ClockStep,
    "ekf_reset": EkfReset,
    "frozen_telemetry": FrozenTelemetry,
    "gps_loss": GpsLoss,
    "gust": WindGust,
    "kill_switch": KillSwitch,
    "link": Link,
    "modes_refused": ModesRefused,
    "motor_efficiency": MotorEfficiency,
    "nan_telemetry": NanTelemetry,
    "no_acks": NoAcks,
    "payload": Payload,
    "pilot": PilotTakesOver,
    "reboot": Reboot,
    "stopped_telemetry": StoppedTelemetry,
    "wind": SteadyWind,
}


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault of a scenario, ``at_s`` simulated seconds after the start."""

    at_s: float
    fault: Fault = field(default_factory=Fault)


def _nan(value: object) -> object:
    if isinstance(value, float):
        return nan
    if isinstance(value, list) and value and isinstance(value[0], float):
        return [nan] * len(value)
    return value


def _one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ValueError(f"{name}: {value!r} is none of {', '.join(known)}")


def from_mapping(data: dict[str, Any]) -> Fault:
    """A fault from its mapping. Raises ValueError that names the offending key."""
    name = data.get("fault")
    kind = FAULTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise ValueError(f"fault: {name!r} is none of {', '.join(FAULTS)}")
    known = {f.name: f for f in fields(kind)}
    arguments: dict[str, Any] = {}
    for key, value in data.items():
        if key in ("fault", "at_s"):
            continue
        if key not in known:
            raise ValueError(f"{name}.{key}: unknown; known: {', '.join(known)}")
        arguments[key] = _checked(f"{name}.{key}", str(known[key].type), value)
        low, high = _RANGES.get(key, (-inf, inf))
        if key in _RANGES and not low <= value <= high:
            raise ValueError(f"{name}.{key}: {value!r} is not in {low:g} to {high:g}")
    try:
        return kind(**arguments)
    except ValueError as error:
        raise ValueError(f"{name}.{error}") from error


def scenario(items: list[dict[str, Any]]) -> tuple[ScheduledFault, ...]:
    """A scenario in the order of time. Raises ValueError that names the offending item and key."""
    planned = []
    for index, item in enumerate(items):
        try:
            at_s = _checked("at_s", "float", item.get("at_s"))
            planned.append(ScheduledFault(at_s, from_mapping(item)))
        except ValueError as error:
            raise ValueError(f"[{index}].{error}") from error
    return tuple(sorted(planned, key=lambda entry: entry.at_s))


def _checked(path: str, annotation: str, value: Any) -> Any:
    """The value as the field's type, or ValueError."""
    if "tuple" in annotation:
        items = [value] if isinstance(value, str) else value
        if isinstance(items, list) and all(isinstance(item, str) for item in items):
            return tuple(items)
    elif "bool" in annotation:
        if isinstance(value, bool):
            return value
    elif "str" in annotation:
        if isinstance(value, str):
            return value
    elif "int" in annotation.split(" ") or annotation == "<class 'int'>":
        if isinstance(value, int) and not isinstance(value, bool):
            return value
    elif isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value):
        return float(value)
    raise ValueError(f"{path}: {value!r} is not of type {annotation}")
