"""PX4's commander: modes, arming, disarming, failsafes, commands and their acknowledgements. Runs at 100 Hz."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any

from daemon.messages import FlightMode, LandedState, SystemStatus
from daemon.sim.announcer import ACTION, Announcer, mode_argument
from daemon.sim.failsafe import Action, BatteryWarning, Health, can_run, decide
from daemon.sim.land_detector import LandDetector
from daemon.sim.modes import MANUAL_MODES, from_numbers
from daemon.sim.parameters import Parameters

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
_CHECK_TICKS = 10  # health checks run at 10 Hz
_FORCE = 21196  # MAV_CMD_COMPONENT_ARM_DISARM: disarm in the air
_NO_ARMING = frozenset((FlightMode.LAND, FlightMode.RETURN))
_PASSING = frozenset((FlightMode.TAKEOFF, FlightMode.LAND, FlightMode.RETURN))
_BY_EXTERNAL_COMMAND, _BY_LANDING, _BY_INACTION, _BY_KILL = 4, 6, 7, 5
_BATTERY_EVENTS = {
    BatteryWarning.LOW: "battery_low",
    BatteryWarning.CRITICAL: "battery_critical",
    BatteryWarning.EMERGENCY: "battery_emergency",
}


@dataclass(slots=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT that waits for the commander."""

    number: int
    parameters: tuple[float, ...]
    sender: tuple[int, int]


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
        self._announcer = announcer
        self._send = send
        self.inputs = Inputs()
        self.detector = LandDetector(land_patience_s)
        self.mode = self.intended = self._mode_after_disarming = FlightMode.HOLD
        self.descending = self.landing_at_home = False
        self.armed = False
        self.killed = False
        self.action = Action()
        self.takeoff_altitude_amsl_m: float | None = None
        self.commands: deque[Command] = deque()
        self.refused_modes: set[FlightMode] = set()
        self.refuse_arming = False
        self.silent = False  # takes commands but acknowledges none
        self.changed = True  # vehicle_status was published
        self._ticks = 0
        self._armed_s = self._landed_s = self._killed_s = self._acting_s = 0.0
        self._flown = False
        self._health = Health()
        self._failing: tuple[str, ...] | None = None
        self._taken_over: str = ""
        self.battery_warning = BatteryWarning.NONE
        self._sticks_seen = False

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
            return SystemStatus.CRITICAL if self.action.mode is not None else SystemStatus.ACTIVE
        return SystemStatus.STANDBY if self.can_arm else SystemStatus.UNINIT

    @property
    def can_arm(self) -> bool:
        """Whether an arming command would be accepted now."""
        ready = self.inputs.heading_stable and not self.inputs.compass_fault and self.inputs.position_valid
        return (
            ready
            and not self.refuse_arming
            and not self.killed
            and self.intended not in _NO_ARMING
            and can_run(self.intended, self._health)
        )

    def tick(self, dt_s: float) -> None:
        """One turn: commands, health, failsafe, landing, disarming."""
        self._ticks += 1
        if self._ticks % _CHECK_TICKS == 0 or self._offboard_appeared():
            self._check()
        while self.commands:
            self._execute(self.commands.popleft())
        self._fail_safe(dt_s)
        self._follow_task()
        self._watch_ground(dt_s)
        self._watch_disarming(dt_s)

    # -- modes

    def request_mode(self, mode: FlightMode) -> bool:
        """A user asks for a mode: always taken while disarmed, else only when it can run."""
        if mode in self.refused_modes or (self.armed and not can_run(mode, self._health)):
            return False
        if self.action.mode is not None:
            self._taken_over = self.action.cause
            if mode is not self.intended and self.action.cause == "manual_control":
                self._announcer.say("pilot_took_over")
        self._intend(mode)
        return True

    def pilot_switches_to(self, mode: FlightMode) -> None:
        """A pilot's switch: as a command without acknowledgement, after a look at what is available now."""
        self._check()
        self.request_mode(mode)

    def _intend(self, mode: FlightMode) -> None:
        self.intended = mode
        if mode not in _PASSING:
            self._mode_after_disarming = mode
        self._fly(mode, self._taken_over_action())

    def _taken_over_action(self) -> Action:
        return Action() if self._taken_over or self.action.mode is None else self.action

    def _fly(self, mode: FlightMode, action: Action) -> None:
        self.action = action
        self.descending = action.descend
        self.landing_at_home = False
        self.mode = mode
        self.changed = True

    def _follow_task(self) -> None:
        """Take-off ends in Hold, the way home in a landing."""
        if not self.inputs.task_finished:
            return
        if self.mode is FlightMode.TAKEOFF and self.action.mode is None:
            self._intend(FlightMode.HOLD)
        elif self.mode is FlightMode.RETURN and not self.landing_at_home:
            self.landing_at_home = True
            self._announcer.say("return_land")

    # -- health and failsafe

    def _offboard_appeared(self) -> bool:
        """Setpoints are noticed at once (recorded: 2 to 12 ms), their loss at 10 Hz."""
        return not self._health.offboard_signal and self.inputs.setpoint_age_s < self._parameters["COM_OF_LOSS_T"]

    def _check(self) -> None:
        """PX4's health and arming checks, at 10 Hz."""
        seen, p = self.inputs, self._parameters
        uses_sticks = p["COM_RC_IN_MODE"] != 4
        sticks = uses_sticks and seen.sticks_age_s < p["COM_RC_LOSS_T"]
        self._sticks_seen = uses_sticks and (self._sticks_seen or sticks)
        lost = self._sticks_seen and not sticks
        if lost and not self._health.manual_control_lost:
            self._announcer.say("manual_control_lost")
        self._health = Health(
            offboard_signal=seen.setpoint_age_s < p["COM_OF_LOSS_T"],
            position=seen.position_valid,
            manual_control=sticks,
            manual_control_lost=lost,
            battery=self._battery_warning(),
        )
        self._report()

    def _battery_warning(self) -> BatteryWarning:
        p, charge = self._parameters, self.inputs.battery_fraction
        if p["CBRK_SUPPLY_CHK"] == 894281 or not self.armed:
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

    def _report(self) -> None:
        """Standing failures, announced when they change."""
        seen, health = self.inputs, self._health
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
                ("mode_cannot_arm", not self.armed and self.intended in _NO_ARMING),
                ("ground_station", not self._announcer.ground_station_heard),
            )
            if fails
        )
        if failing != self._failing and self._failing is not None:
            self._announcer.report_checks(failing)
        self._failing = failing

    def _fail_safe(self, dt_s: float) -> None:
        if not self.armed:
            return
        p = self._parameters
        action = decide(
            self.intended,
            self._health,
            offboard_loss=int(p["COM_OBL_RC_ACT"]),
            manual_loss=int(p["NAV_RCL_ACT"]),
            low_battery=int(p["COM_LOW_BAT_ACT"]),
        )
        if action.cause != self._taken_over:
            self._taken_over = ""
        elif action.cause:
            return
        if action.mode is None:
            if self.action.mode is not None:
                self._fly(self.intended, Action())
            return
        self._acting_s = self._acting_s + dt_s if self.action.mode is not None else 0.0
        if self.action.mode is None:
            self._enter(action)
            return
        held = self.mode is FlightMode.HOLD and self.action.delayed
        if self._acting_s >= self._hold_s(action) and (held or action != self.action):
            self._carry_out(action)

    def _hold_s(self, action: Action) -> float:
        return self._parameters["COM_FAIL_ACT_T"] if action.delayed else 0.0

    def _enter(self, action: Action) -> None:
        assert action.mode is not None
        if action.delayed and self._hold_s(action) > 0.0:
            cause = 4 if action.cause.startswith("battery") else 1
            arguments = mode_argument(self.intended) + bytes([ACTION[action.mode], 5, 0, cause])
            self._announcer.say("failsafe_hold", arguments)
            self._fly(FlightMode.HOLD, action)
        else:
            self._announcer.say("failsafe", mode_argument(self.intended) + bytes([ACTION[action.mode]]))
            self._fly(action.mode, action)
        if self.mode is FlightMode.RETURN:
            self._announcer.say("return_start")

    def _carry_out(self, action: Action) -> None:
        assert action.mode is not None
        self.action = action
        if self.mode is action.mode and self.descending == action.descend:
            return
        self._announcer.say("failsafe_because", mode_argument(self.intended) + bytes([ACTION[action.mode], 5]))
        self._fly(action.mode, action)

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
            self._announcer.say("takeoff_detected")
        elif change is True and self.armed:
            self._announcer.say("landing_detected")
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
        elif not self._flown and self._armed_s >= p["COM_DISARM_PRFLT"] > 0.0:
            self.disarm(_BY_INACTION)

    # -- arming

    def arm(self) -> bool:
        """Arm, or say why not."""
        if not self.armed and not self.can_arm:
            self._announcer.say("arm_denied")
            return False
        self._armed_s = 0.0
        if not self.armed:
            self.armed, self._flown, self._landed_s = True, False, 0.0
            self._announcer.say("armed_by", bytes([_BY_EXTERNAL_COMMAND]))
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
        self._announcer.say("disarmed_by", bytes([by]))
        self._taken_over = ""
        self.action = Action()
        if by != _BY_EXTERNAL_COMMAND or self._flown:
            self.intended = self._mode_after_disarming
        self._fly(self.intended, Action())
        self.battery_warning = BatteryWarning.NONE

    def kill(self, on: bool) -> None:
        """The kill switch: motors stop at once, disarmed after COM_KILL_DISARM."""
        self.killed, self._killed_s = on, 0.0

    # -- commands

    def _execute(self, command: Command) -> None:
        handler = _HANDLERS.get(command.number)
        result = handler(self, command.parameters) if handler is not None else UNSUPPORTED
        self.acknowledge(command, result)

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

    def _do_set_mode(self, p: tuple[float, ...]) -> int:
        mode = from_numbers(integer(p[1]), integer(p[2]))
        if mode is None:
            self._announcer.say("unsupported_main_mode")
            return TEMPORARILY_REJECTED
        if self.request_mode(mode):
            return ACCEPTED
        if mode is not FlightMode.OFFBOARD:
            arguments = mode_argument(mode) + bytes([ACTION.get(mode, 0)])
            self._announcer.say("mode_not_available", arguments, mode.value.capitalize())
        return TEMPORARILY_REJECTED

    def _do_arm(self, p: tuple[float, ...]) -> int:
        if p[0] == 1.0:
            return ACCEPTED if self.arm() else TEMPORARILY_REJECTED
        if self.armed and not self.detector.landed and integer(p[1]) != _FORCE and self.mode not in MANUAL_MODES:
            return TEMPORARILY_REJECTED
        self.disarm()
        return ACCEPTED

    def _do_takeoff(self, p: tuple[float, ...]) -> int:
        if not self.request_mode(FlightMode.TAKEOFF):
            return TEMPORARILY_REJECTED
        self.takeoff_altitude_amsl_m = p[6] if isfinite(p[6]) else None
        return ACCEPTED

    def _do_land(self, _: tuple[float, ...]) -> int:
        if not self.request_mode(FlightMode.LAND):
            return TEMPORARILY_REJECTED
        self._announcer.say("landing_here")
        return ACCEPTED

    def _do_return(self, _: tuple[float, ...]) -> int:
        if not self.request_mode(FlightMode.RETURN):
            return TEMPORARILY_REJECTED
        self._announcer.say("return_start")
        return ACCEPTED

    def _do_checks(self, _: tuple[float, ...]) -> int:
        self._announcer.report_checks(self._failing or ())
        return ACCEPTED


def integer(value: float) -> int:
    """A command's parameter as a number of something; 0 where it is not one."""
    return int(value) if isfinite(value) else 0


_HANDLERS: dict[int, Callable[[Commander, tuple[float, ...]], int]] = {
    20: Commander._do_return,
    21: Commander._do_land,
    22: Commander._do_takeoff,
    176: Commander._do_set_mode,
    400: Commander._do_arm,
    401: Commander._do_checks,
}
