"""PX4's navigator and flight mode manager: home, what a mode begins with, and the setpoint that is flown."""

import struct
from typing import TYPE_CHECKING

from daemon.frames import add
from daemon.messages import ZERO3, FlightMode, Setpoint
from daemon.sim.estimator import Estimate
from daemon.sim.flight_tasks import FlightTasks
from daemon.sim.sensors import global_of

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


class Navigator:
    """``setpoint``: rates and thrust that are flown; ``home_local_m``, ``home_global``: where home is.

    ``attitude_setpoint_ms``: ATTITUDE_TARGET's stamp, that of the last attitude setpoint; rate offboard has none.
    """

    def __init__(self, px4: "SimulatedPx4") -> None:
        self._px4 = px4
        self.tasks = FlightTasks(px4.parameters)
        self.setpoint = Setpoint(ZERO3, 0.0)
        self.attitude_setpoint_ms = 0
        self._flown_mode: FlightMode | None = None
        self.set_home()

    def set_home(self) -> None:
        """Home is where the vehicle believes to be: at boot, arming and disarming."""
        estimator = self._px4.estimator
        self.home_local_m = estimator.estimate.position_ned_m
        self.home_global = global_of(add(self.home_local_m, estimator.origin_ned_m), self._px4.home)

    def step(self, estimate: Estimate) -> None:
        """The setpoint by the estimate of this moment."""
        px4 = self._px4
        for jump in px4.estimator.jumps:
            self.tasks.shift(jump)
        px4.estimator.jumps.clear()
        mode = px4.commander.task
        if mode is not self._flown_mode:
            self._enter(mode)
        if mode is FlightMode.OFFBOARD:
            self.setpoint = px4.receiver.offboard_setpoint(estimate)
            return
        flies = px4.commander.armed and (self.tasks.lifts or not px4.commander.detector.landed)
        self.setpoint = self.tasks.run(estimate, px4.height_m) if flies else Setpoint(ZERO3, 0.0)
        self.attitude_setpoint_ms = px4.time_us // 1000

    def _enter(self, mode: FlightMode) -> None:
        self._flown_mode = mode
        px4 = self._px4
        estimate = px4.estimator.estimate
        self.tasks.home_ned_m = self.home_local_m
        target_down_m: float | None = None
        if mode is FlightMode.TAKEOFF:
            amsl_m = px4.commander.takeoff_altitude_amsl_m
            if amsl_m is None:
                altitude_m = px4.parameters["MIS_TAKEOFF_ALT"]
                if px4.commander.armed:
                    px4.announcer.say("takeoff_default_altitude", struct.pack("<f", altitude_m))
                target_down_m = estimate.position_ned_m[2] - altitude_m
            else:
                target_down_m = px4.home.altitude_amsl_m - amsl_m - px4.estimator.origin_ned_m[2]
        elif mode in (FlightMode.LAND, FlightMode.RETURN):
            px4.announcer.stow_gimbal(px4.system_id)
        self.tasks.enter(mode, estimate, target_down_m, landed=px4.commander.detector.landed)
