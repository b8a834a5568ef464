"""PX4's health and arming checks: what is available, what fails, and saying so when it changes. Runs at 10 Hz."""

from dataclasses import dataclass

from daemon.messages import FlightMode
from daemon.sim.announcer import Announcer
from daemon.sim.failsafe import BatteryWarning, Health
from daemon.sim.parameters import Parameters

NO_ARMING = frozenset((FlightMode.LAND, FlightMode.RETURN))
_SUPPLY_CHECK_OFF = 894281  # CBRK_SUPPLY_CHK: with it an empty battery goes unnoticed (recorded)
_BATTERY_EVENTS = {
    BatteryWarning.LOW: "battery_low",
    BatteryWarning.CRITICAL: "battery_critical",
    BatteryWarning.EMERGENCY: "battery_emergency",
}


@dataclass(slots=True)
class Inputs:
    """What the commander sees of the rest of the vehicle, written before each tick."""

    on_ground: bool = True
    thrust_share: float = 0.0
    position_valid: bool = True
    heading_stable: bool = True
    compass_fault: bool = False
    task_finished: bool = False
    battery_fraction: float = 1.0
    setpoint_age_s: float = float("inf")
    sticks_age_s: float = float("inf")


class HealthMonitor:
    """``health`` is what the failsafe decides by, as of the last check; ``failing`` names the standing failures."""

    def __init__(self, parameters: Parameters, announcer: Announcer, inputs: Inputs) -> None:
        self._parameters = parameters
        self._announcer = announcer
        self._inputs = inputs
        self.health = Health()
        self.failing: tuple[str, ...] = ()
        self.battery_warning = BatteryWarning.NONE
        self._reported = False
        self._sticks_seen = False

    def offboard_appeared(self) -> bool:
        """Setpoints are noticed at once (recorded: 2 to 12 ms), their loss at 10 Hz."""
        return not self.health.offboard_signal and self._inputs.setpoint_age_s < self._parameters["COM_OF_LOSS_T"]

    def check(self, intended: FlightMode, armed: bool) -> None:
        """Look at everything."""
        seen, p = self._inputs, self._parameters
        uses_sticks = p["COM_RC_IN_MODE"] != 4
        sticks = uses_sticks and seen.sticks_age_s < p["COM_RC_LOSS_T"]
        # sticks that were lost before arming are optional until they come back (Failsafe::updateArmingState)
        self._sticks_seen = uses_sticks and (sticks or (self._sticks_seen and armed))
        lost = self._sticks_seen and not sticks
        if lost and not self.health.manual_control_lost:
            self._announcer.say("manual_control_lost")
        self.health = Health(
            offboard_signal=seen.setpoint_age_s < p["COM_OF_LOSS_T"],
            position=seen.position_valid,
            manual_control=sticks,
            manual_control_lost=lost,
            battery=self._judge_battery(armed),
        )
        self._report(intended, armed)

    def _judge_battery(self, armed: bool) -> BatteryWarning:
        p, charge = self._parameters, self._inputs.battery_fraction
        if p["CBRK_SUPPLY_CHK"] == _SUPPLY_CHECK_OFF or not armed:
            warning = BatteryWarning.NONE
        elif charge <= p["BAT_EMERGEN_THR"]:
            warning = BatteryWarning.EMERGENCY
        elif charge <= p["BAT_CRIT_THR"]:
            warning = BatteryWarning.CRITICAL
        elif charge <= p["BAT_LOW_THR"]:
            warning = BatteryWarning.LOW
        else:
            warning = BatteryWarning.NONE
        if warning > self.battery_warning:
            self._announcer.say(_BATTERY_EVENTS[warning], b"\xff\xff\xff\xff\x0b")
            if warning is BatteryWarning.LOW:
                self._announcer.say("battery_low_advice")
        self.battery_warning = warning
        return warning

    def _report(self, intended: FlightMode, armed: bool) -> None:
        """Standing failures, announced when they change."""
        seen, health = self._inputs, self.health
        failing = tuple(
            name
            for name, fails in (
                ("heading_not_stable", not seen.heading_stable),
                ("local_position", not seen.position_valid),
                ("global_position", not seen.position_valid),
                ("compass_fault", seen.compass_fault),
                ("mission", True),
                ("offboard_signal", not health.offboard_signal),
                ("manual_control", not health.manual_control),
                ("mode_cannot_arm", not armed and intended in NO_ARMING),
                ("ground_station", not self._announcer.ground_station_heard),
            )
            if fails
        )
        if failing != self.failing and self._reported:
            self._announcer.report_checks(failing)
        self.failing, self._reported = failing, True
