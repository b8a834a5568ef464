"""PX4's MAVLink receiver: what comes in, and the answers that need no commander."""

from math import inf, isfinite, nan
from typing import TYPE_CHECKING

from daemon.frames import add
from daemon.messages import GlobalPosition, Quat, Setpoint
from daemon.sim.commands import ACCEPTED, DENIED, FAILED, TEMPORARILY_REJECTED, Command, integer
from daemon.sim.estimator import Estimate
from daemon.sim.flight_tasks import Sticks
from daemon.sim.parameters import DOES_NOT_EXIST
from daemon.sim.position_control import attitude_rates
from daemon.sim.sample import Fields
from daemon.sim.sensors import ned_of
from daemon.sim.streams import TABLE
from daemon.sim.telemetry import MESSAGES

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4

Sender = tuple[int, int]

_SET_MODE, _REBOOT = 176, 246
_GET_INTERVAL, _SET_INTERVAL, _REQUEST_MESSAGE = 510, 511, 512
_EXTERNAL_POSITION = 43003
_GROUND_STATION = 6
_IGNORE_RATES, _IGNORE_ATTITUDE = 0b111, 0b10000000
_VERSION = {
    "capabilities": 59647,
    "flight_sw_version": 17891583,
    "middleware_sw_version": 17891583,
    "os_sw_version": 101854463,
    "board_version": 1,
    "flight_custom_version": [0, 0, 0, 146, 90, 168, 89, 229],
    "middleware_custom_version": [0, 0, 0, 146, 90, 168, 89, 229],
    "os_custom_version": [0] * 8,
    "vendor_id": 0,
    "product_id": 0,
    "uid2": [0] * 18,
}
_VERSION_ID, _MESSAGE_INTERVAL_ID = 148, 244


class Receiver:
    """Keeps the newest setpoint and sticks; the rest it answers or hands to the commander."""

    def __init__(self, px4: "SimulatedPx4") -> None:
        self._px4 = px4
        self._setpoint: tuple[Quat | None, Setpoint] = (None, Setpoint((0.0, 0.0, 0.0), 0.0))
        self._setpoint_us: int | None = None
        self._sticks_us: int | None = None
        self._pilot = False
        self._echo: list[tuple[int, str]] = []

    @property
    def setpoint_age_s(self) -> float:
        """Since the last offboard setpoint; infinite before the first."""
        return inf if self._setpoint_us is None else (self._px4.simulated_us - self._setpoint_us) * 1e-6

    @property
    def sticks_age_s(self) -> float:
        """Since the last MANUAL_CONTROL; infinite before the first, zero while a pilot has the sticks."""
        if self._pilot:
            return 0.0
        return inf if self._sticks_us is None else (self._px4.simulated_us - self._sticks_us) * 1e-6

    def offboard_setpoint(self, estimate: Estimate) -> Setpoint:
        """The setpoint that Offboard flies; the last one stays, however old."""
        attitude, setpoint = self._setpoint
        if attitude is None:
            return setpoint
        rates = add(attitude_rates(attitude, estimate.attitude_wb), setpoint.rates_frd_rad_s)
        return Setpoint(rates, setpoint.thrust)

    def receive(self, name: str, fields: Fields, sender: Sender) -> None:
        """One message; those for other systems and those that PX4 does not know are dropped."""
        if fields.get("target_system", 0) not in (0, self._px4.system_id):
            return
        handler = _HANDLERS.get(name)
        if handler is not None:
            handler(self, fields, sender)

    def pilot_holds(self, sticks: Sticks) -> None:
        """A pilot's own remote control, always there from now on."""
        self._pilot = True
        self._px4.navigator.tasks.sticks = sticks

    def echo_parameters(self) -> None:
        """PX4 sends a parameter that was set a second time, about 20 ms later."""
        while self._echo and self._echo[0][0] <= self._px4.simulated_us:
            self._px4.send("PARAM_VALUE", self._px4.parameters.message(self._echo.pop(0)[1]))

    def _attitude_target(self, f: Fields, _: Sender) -> None:
        mask = int(f["type_mask"])
        rates = (0.0, 0.0, 0.0)
        if mask & _IGNORE_RATES != _IGNORE_RATES:
            rates = (float(f["body_roll_rate"]), float(f["body_pitch_rate"]), float(f["body_yaw_rate"]))
        q = f["q"]
        attitude = None if mask & _IGNORE_ATTITUDE else (float(q[0]), float(q[1]), float(q[2]), float(q[3]))
        self._setpoint = (attitude, Setpoint(rates, float(f["thrust"])))
        self._setpoint_us = self._px4.simulated_us

    def _manual_control(self, f: Fields, _: Sender) -> None:
        self._sticks_us = self._px4.simulated_us
        self._px4.navigator.tasks.sticks = Sticks(
            forward=f["x"] / 1000.0, right=f["y"] / 1000.0, throttle=f["z"] / 1000.0, yaw=f["r"] / 1000.0
        )

    def _heartbeat(self, f: Fields, _: Sender) -> None:
        if f["type"] == _GROUND_STATION:
            self._px4.announcer.ground_station_heard = True

    def _command_long(self, f: Fields, sender: Sender) -> None:
        parameters = tuple([_number(f.get(f"param{i}")) for i in range(1, 8)])
        self._command(Command(int(f["command"]), parameters, sender))

    def _command_int(self, f: Fields, sender: Sender) -> None:
        parameters = [_number(f.get(f"param{i}")) for i in range(1, 5)]
        place = (float(f["x"]) * 1e-7, float(f["y"]) * 1e-7, _number(f["z"]))
        self._command(Command(int(f["command"]), (*parameters, *place), sender))

    def _command(self, command: Command) -> None:
        handler = _COMMANDS.get(command.number)
        commander = self._px4.commander
        if handler is not None:
            commander.acknowledge(command, handler(self, command.parameters))
            return
        if command.number == _SET_MODE:  # the receiver acknowledges before the commander has looked
            commander.acknowledge(command, ACCEPTED)
        commander.commands.append(command)

    def _set_interval(self, p: tuple[float, ...]) -> int:
        interval_us = p[1] if isfinite(p[1]) else 0.0
        return ACCEPTED if self._px4.sender.streams.set_interval(integer(p[0]), interval_us) else FAILED

    def _get_interval(self, p: tuple[float, ...]) -> int:
        identifier = integer(p[0])
        fields = {"message_id": identifier, "interval_us": self._px4.sender.streams.interval(identifier)}
        self._px4.send("MESSAGE_INTERVAL", fields)
        return ACCEPTED

    def _request_message(self, p: tuple[float, ...]) -> int:
        identifier, px4 = integer(p[0]), self._px4
        if identifier == _VERSION_ID:
            px4.send("AUTOPILOT_VERSION", {**_VERSION, "uid": 5283920058631409231 + px4.system_id - 1})
        elif identifier not in TABLE or not px4.sender.send_now(TABLE[identifier][0]):
            return DENIED
        return ACCEPTED

    def _reboot(self, p: tuple[float, ...]) -> int:
        if self._px4.armed:
            return TEMPORARILY_REJECTED
        if p[0] == 1.0:
            self._px4.reboot_soon = True
        return ACCEPTED

    def _external_position(self, p: tuple[float, ...]) -> int:
        """MAV_CMD_EXTERNAL_POSITION_ESTIMATE: horizontal only, reset at once."""
        px4 = self._px4
        place = GlobalPosition(p[4], p[5], px4.home.altitude_amsl_m)
        north, east, _ = ned_of(place, px4.home)
        origin, estimate = px4.estimator.origin_ned_m, px4.estimator.estimate.position_ned_m
        px4.estimator.offset_position((north - origin[0] - estimate[0], east - origin[1] - estimate[1], 0.0), 2)
        return ACCEPTED

    def _set_origin(self, f: Fields, _: Sender) -> None:
        px4 = self._px4
        place = GlobalPosition(f["latitude"] * 1e-7, f["longitude"] * 1e-7, f["altitude"] * 1e-3)
        target, origin = ned_of(place, px4.home), px4.estimator.origin_ned_m
        px4.estimator.move_origin((target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]))
        px4.send("GPS_GLOBAL_ORIGIN", MESSAGES["GPS_GLOBAL_ORIGIN"](px4, px4.present))

    def _param_read(self, f: Fields, sender: Sender) -> None:
        name, px4 = str(f["param_id"]).rstrip("\0"), self._px4
        if name in px4.parameters:
            px4.send("PARAM_VALUE", px4.parameters.message(name))
        else:
            self._param_error(name, sender)

    def _param_set(self, f: Fields, sender: Sender) -> None:
        name, px4 = str(f["param_id"]).rstrip("\0"), self._px4
        if name not in px4.parameters:
            self._param_error(name, sender)
            return
        if isfinite(f["param_value"]):
            px4.parameters.set(name, f["param_value"])
        px4.send("PARAM_VALUE", px4.parameters.message(name))
        self._echo.append((px4.simulated_us + 20_000, name))

    def _param_error(self, name: str, sender: Sender) -> None:
        fields = {"param_id": name, "param_index": -1, "error": DOES_NOT_EXIST}
        self._px4.send("PARAM_ERROR", {"target_system": sender[0], "target_component": sender[1], **fields})

    def _timesync(self, f: Fields, _: Sender) -> None:
        if f["tc1"] == 0:
            self._px4.send("TIMESYNC", {"tc1": self._px4.time_us * 1000, "ts1": f["ts1"]})

    def _ping(self, f: Fields, sender: Sender) -> None:
        if f["target_system"] == 0:
            self._px4.send("PING", {**f, "target_system": sender[0], "target_component": sender[1]})


def _number(value: float | None) -> float:
    return nan if value is None else float(value)


_COMMANDS = {
    _GET_INTERVAL: Receiver._get_interval,
    _SET_INTERVAL: Receiver._set_interval,
    _REQUEST_MESSAGE: Receiver._request_message,
    _REBOOT: Receiver._reboot,
    _EXTERNAL_POSITION: Receiver._external_position,
}
_HANDLERS = {
    "SET_ATTITUDE_TARGET": Receiver._attitude_target,
    "COMMAND_LONG": Receiver._command_long,
    "COMMAND_INT": Receiver._command_int,
    "HEARTBEAT": Receiver._heartbeat,
    "MANUAL_CONTROL": Receiver._manual_control,
    "PARAM_REQUEST_READ": Receiver._param_read,
    "PARAM_SET": Receiver._param_set,
    "PING": Receiver._ping,
    "SET_GPS_GLOBAL_ORIGIN": Receiver._set_origin,
    "TIMESYNC": Receiver._timesync,
}
