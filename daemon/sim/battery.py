"""The battery: charge, voltage, sag."""

from daemon.sim.airframe import Battery

_BELIEF_S = 1.3


class BatteryState:
    """Charge falls with the current, or as PX4's simulated battery does: at a fixed pace while armed.

    ``fraction`` is what PX4 believes: it follows the charge by about a second (recorded).
    """

    def __init__(self, battery: Battery) -> None:
        self._battery = battery
        self._charge = 1.0
        self.fraction = 1.0
        self._current_a = 0.0

    @property
    def voltage_v(self) -> float:
        """Terminal voltage."""
        b = self._battery
        open_v = b.cells * (b.cell_empty_v + self._charge * (b.cell_full_v - b.cell_empty_v))
        return open_v - self._current_a * b.resistance_ohm

    @property
    def thrust_share(self) -> float:
        """What a rotor still gives of its thrust: with the square of the voltage where the airframe says so."""
        if not self._battery.thrust_falls_with_voltage:
            return 1.0
        return (self.voltage_v / (self._battery.cells * self._battery.cell_full_v)) ** 2

    def step(self, dt_s: float, armed: bool, thrust_over_hover: float, drain_s: float, floor: float) -> None:
        """``drain_s``: seconds from full to empty while armed (SIM_BAT_DRAIN; 0: by current), not below ``floor``."""
        if not armed:
            self._current_a = 0.0
            return
        b = self._battery
        self._current_a = b.hover_current_a * max(0.0, thrust_over_hover) ** 1.5
        pace = 1.0 / drain_s if drain_s > 0.0 else self._current_a / (b.capacity_ah * 3600.0)
        self._charge = max(min(floor, self._charge), self._charge - pace * dt_s)
        self.fraction += (self._charge - self.fraction) * dt_s / _BELIEF_S

    def set(self, fraction: float) -> None:
        """Charge and belief at once; 1.0 after disarming, as PX4's simulated battery does."""
        self._charge = self.fraction = fraction
