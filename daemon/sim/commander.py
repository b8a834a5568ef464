"""PX4's commander: modes, arming, disarming, failsafes, commands and their acknowledgements. Runs at 100 Hz."""

from collections import deque
from collections.abc import Callable
from typing import Any

from daemon.messages import FlightMode, LandedState, SystemStatus
from daemon.sim.announcer import ACTION, DESCEND_ACTION, Announcer, mode_argument
from daemon.sim.commands import Command, execute
from daemon.sim.failsafe import BatteryWarning, Cause, can_run
from daemon.sim.failsafe_state import FailsafeState
from daemon.sim.health_monitor import NO_ARMING, HealthMonitor, Inputs
from daemon.sim.land_detector import LandDetector
from daemon.sim.parameters import Parameters

_CHECK_TICKS = 10  # health checks run at 10 Hz
_PASSING = frozenset((FlightMode.TAKEOFF, FlightMode.LAND, FlightMode.RETURN))
_BY_EXTERNAL_COMMAND, _BY_LANDING, _BY_INACTION, _BY_KILL = 4, 6, 7, 8  # VehicleStatus.msg
_AUTOPILOT_STAYS = frozenset((FlightMode.POSITION, FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND))


class Commander:
    """Holds ``mode`` (what flies), ``intended`` (what was asked for), ``armed``, ``landed_state``, ``status``."""

    def __init__(
        self,
        parameters: Parameters,
        announcer: Announcer,
        send: Callable[[str, dict[str, Any]], None],
        land_patience_s: float,
    ) -> None:
        self._parameters = parameters
        self.announcer = announcer
        self._send = send
        self.inputs = Inputs()
        self.monitor = HealthMonitor(parameters, announcer, self.inputs)
        self.detector = LandDetector(land_patience_s)
        self.mode = self.intended = self._mode_after_disarming = FlightMode.HOLD
        self.descending = self.landing_at_home = False
        self.armed = False
        self.killed = False
        self.failsafe = FailsafeState(parameters)
        self.takeoff_altitude_amsl_m: float | None = None
        self.commands: deque[Command] = deque()
        self.refused_modes: set[FlightMode] = set()
        self.refuse_arming = False
        self.silent = False  # takes commands but acknowledges none
        self.changed = True  # vehicle_status was published
        self._ticks = 0
        self._armed_s = self._landed_s = self._killed_s = 0.0
        self._flown = False

    @property
    def landed_state(self) -> LandedState:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.detector.landed:
            return LandedState.ON_GROUND
        if self.mode is FlightMode.TAKEOFF:
            return LandedState.TAKEOFF
        if self.mode is FlightMode.LAND or (self.mode is FlightMode.RETURN and self.landing_at_home):
            return LandedState.LANDING
        return LandedState.IN_AIR

    @property
    def task(self) -> FlightMode:
        """What has to be flown: Return lands as Land does, UNKNOWN is Descend."""
        if self.descending:
            return FlightMode.UNKNOWN
        return FlightMode.LAND if self.landing_at_home else self.mode

    @property
    def status(self) -> SystemStatus:
        """HEARTBEAT.system_status; UNINIT when this mode cannot be armed."""
        if self.killed:
            return SystemStatus.FLIGHT_TERMINATION
        if self.armed:
            return SystemStatus.CRITICAL if self.failsafe.flown is not None else SystemStatus.ACTIVE
        return SystemStatus.STANDBY if self.can_arm else SystemStatus.UNINIT

    @property
    def can_arm(self) -> bool:
        """Whether an arming command would be accepted now."""
        ready = self.inputs.heading_stable and not self.inputs.compass_fault and self.inputs.position_valid
        return (
            ready
            and not self.refuse_arming
            and not self.killed
            and self.intended not in NO_ARMING
            and can_run(self.intended, self.monitor.health)
        )

    def tick(self, dt_s: float) -> None:
        """One turn: commands, health, failsafe, landing, disarming."""
        self._ticks += 1
        if self._ticks % _CHECK_TICKS == 0 or self.monitor.offboard_appeared():
            self.monitor.check(self.intended, self.armed)
        while self.commands:
            command = self.commands.popleft()
            self.acknowledge(command, execute(self, command))
        self._fail_safe(dt_s)
        self._follow_task()
        self._watch_ground(dt_s)
        self._watch_disarming(dt_s)

    # -- modes

    def request_mode(self, mode: FlightMode) -> bool:
        """A user asks for a mode: always taken while disarmed, Land always, else only when it can run."""
        forced = not self.armed or mode is FlightMode.LAND  # without a position that becomes Descend
        if mode in self.refused_modes or not (forced or can_run(mode, self.monitor.health)):
            return False
        action = self.failsafe.action
        if action.mode is not None and action.cause is Cause.MANUAL_CONTROL and mode is not self.intended:
            self.announcer.say("pilot_took_over")
        self.failsafe.taken_over(self.monitor.health)
        self.takeoff_altitude_amsl_m = None
        self._intend(mode)
        return True

    def pilot_switches_to(self, mode: FlightMode) -> None:
        """A pilot's switch: as a command without acknowledgement, after a look at what is available now."""
        self.monitor.check(self.intended, self.armed)
        self.request_mode(mode)

    def _intend(self, mode: FlightMode) -> None:
        self.intended = mode
        if mode not in _PASSING:
            self._mode_after_disarming = mode
        self._fly(mode)

    def _fly(self, mode: FlightMode, *, descend: bool = False) -> None:
        self.mode, self.descending = mode, descend
        self.landing_at_home = False
        self.changed = True

    def _follow_task(self) -> None:
        """Take-off ends in Hold, the way home in a landing."""
        if not self.inputs.task_finished:
            return
        if self.mode is FlightMode.TAKEOFF and self.failsafe.flown is None:
            self._intend(FlightMode.HOLD)
        elif self.mode is FlightMode.RETURN and not self.landing_at_home:
            self.landing_at_home = True
            self.announcer.say("return_land")

    # -- health and failsafe

    def _fail_safe(self, dt_s: float) -> None:
        if not self.armed:
            return
        failsafe = self.failsafe
        before, held = failsafe.flown, failsafe.holding
        failsafe.step(self.intended, self.monitor.health, dt_s)
        mode, descend = failsafe.flown, failsafe.action.descend and not failsafe.holding
        if mode is None:
            if before is not None:
                self._fly(self.intended)
        elif mode is not before or descend != self.descending:
            self._announce_failsafe(mode, descend)
            if mode is not self.mode or descend != self.descending:
                self._fly(mode, descend=descend)
            if mode is FlightMode.RETURN and not held:
                self.announcer.say("return_start")

    def _announce_failsafe(self, mode: FlightMode, descend: bool) -> None:
        action = self.failsafe.action
        assert action.mode is not None
        intended, number = mode_argument(self.intended), ACTION[action.mode]
        if self.failsafe.holding:
            delay_s = round(self._parameters["COM_FAIL_ACT_T"]).to_bytes(2, "little")
            self.announcer.say("failsafe_hold", intended + bytes([number]) + delay_s + bytes([action.cause]))
        elif action.cause is not Cause.GENERIC:
            self.announcer.say("failsafe_because", intended + bytes([number, action.cause]))
        elif descend and mode is FlightMode.LAND:
            self.announcer.say("failsafe_disengaged", intended + bytes([DESCEND_ACTION]))
        else:
            is_manned = mode not in _AUTOPILOT_STAYS
            self.announcer.say("failsafe_disengaged" if is_manned else "failsafe", intended + bytes([number]))

    # -- ground

    def _watch_ground(self, dt_s: float) -> None:
        seen = self.inputs
        change = self.detector.step(
            dt_s,
            on_ground=seen.on_ground,
            taking_off=self.mode is FlightMode.TAKEOFF,
            armed=self.armed,
            thrust_share=seen.thrust_share,
        )
        if change is False and self.armed:
            self._flown = True
            self.announcer.say("takeoff_detected")
        elif change is True and self.armed:
            self.announcer.say("landing_detected")
        self._landed_s = self._landed_s + dt_s if self.detector.landed else 0.0

    def _watch_disarming(self, dt_s: float) -> None:
        p = self._parameters
        if self.killed:
            self._killed_s += dt_s
            if self.armed and self._killed_s >= p["COM_KILL_DISARM"]:
                self.disarm(_BY_KILL)
        if not self.armed:
            return
        self._armed_s += dt_s
        if self._flown and self._landed_s >= p["COM_DISARM_LAND"] > 0.0:
            self.disarm(_BY_LANDING)
        elif not self._flown and self._armed_s >= p["COM_SPOOLUP_TIME"] + p["COM_DISARM_PRFLT"] > p["COM_SPOOLUP_TIME"]:
            self.disarm(_BY_INACTION)

    # -- arming

    def arm(self) -> bool:
        """Arm, or say why not."""
        if not self.armed and not self.can_arm:
            self.announcer.say("arm_denied")
            return False
        if not self.armed:
            self.armed, self._flown, self._armed_s, self._landed_s = True, False, 0.0, 0.0
            self.announcer.say("armed_by", bytes([_BY_EXTERNAL_COMMAND]))
            self.changed = True
        return True

    def start_in_air(self) -> None:
        """Armed and in Hold, without a take-off."""
        self.armed = self._flown = self.changed = True
        self.detector.landed = False

    def disarm(self, by: int = _BY_EXTERNAL_COMMAND) -> None:
        """Motors off; the intended mode goes back to the last one that stays."""
        if not self.armed:
            return
        self.armed = False
        self.announcer.say("disarmed_by", bytes([by]))
        self.failsafe.cleared()
        if by != _BY_EXTERNAL_COMMAND or self._flown:
            self.intended = self._mode_after_disarming
        self._fly(self.intended)
        self.monitor.battery_warning = BatteryWarning.NONE

    def kill(self, on: bool) -> None:
        """The kill switch: motors stop at once, disarmed after COM_KILL_DISARM (``Commander::handleAutoDisarm``)."""
        if on is not self.killed:
            self.announcer.say("kill_engaged" if on else "kill_disengaged")
        self.killed, self._killed_s = on, 0.0

    def acknowledge(self, command: Command, result: int) -> None:
        """COMMAND_ACK to whoever sent the command."""
        if self.silent:
            return
        self._send(
            "COMMAND_ACK",
            {
                "command": command.number,
                "result": result,
                "progress": 0,
                "result_param2": 0,
                "target_system": command.sender[0],
                "target_component": command.sender[1],
            },
        )
