"""Faults of the vehicle: estimate, air, motors, mass, battery, pilot, refusals."""

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, ClassVar

from daemon.messages import ZERO3, FlightMode, Vec3
from daemon.sim.fault import Fault, one_of
from daemon.sim.flight_tasks import Sticks
from daemon.sim.modes import ALL_MODES, MANUAL_MODES
from daemon.sim.wind import Gust

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

_MODES = tuple(mode.value for mode in ALL_MODES)


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
        one_of("kind", self.kind, ("position_ne", "position_d", "velocity_ne", "velocity_d", "heading"))

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
        one_of("mode", self.mode, _MODES)

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
            one_of("modes", mode, _MODES)

    def begin(self, px4: "SimulatedPx4") -> None:
        """Refuse."""
        px4.commander.refused_modes |= {FlightMode(mode) for mode in self.modes}

    def end(self, px4: "SimulatedPx4") -> None:
        """Allow."""
        px4.commander.refused_modes -= {FlightMode(mode) for mode in self.modes}
