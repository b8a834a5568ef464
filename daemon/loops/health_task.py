"""The health task: feeds the watchdog while both tasks tick, tells systemd the state, follows home and the
autopilot's parameters, warns.
"""

from __future__ import annotations

import asyncio
from math import inf
from typing import TYPE_CHECKING

from daemon import frames, logs
from daemon.loops.engageable import not_flown
from daemon.loops.grid import Grid
from daemon.loops.parameter_watch import ParameterWatch
from daemon.messages import ZERO3, AutopilotStatus, BatteryCharge, FrameShift, Vec3
from daemon.notify import notify
from daemon.parameters import geofence
from daemon.safety.reasons import REASONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from daemon.loops.vehicle import Vehicle

SLIP_PERIOD_S = 5.0
SLIP_SHARE = 0.02

log = logs.get("health")


class HealthTask:
    """Runs at 5 Hz beside the other tasks."""

    def __init__(self, vehicle: Vehicle, grid: Grid) -> None:
        self.warnings: dict[str, str] = {}
        self.asked: dict[str, Callable[[], str | None]] = {}  # each tick, by name: a warning, or None
        self._vehicle = vehicle
        self._grid = grid
        self._ticks = (-1, -1)
        self._parameters = ParameterWatch(vehicle, self.warnings)
        self._connection: tuple[bool, int] = (False, -1)
        self._asking: asyncio.Task[None] | None = None
        self._missed: dict[str, int] = {}
        self._said: str | None = None
        self._judged_s = -inf

    async def run(self) -> None:
        """Run until cancelled."""
        try:
            await self._grid.run(self._tick)
        finally:
            self._ask_no_more()

    def _tick(self, now_s: float, _dt_s: float) -> None:
        vehicle = self._vehicle
        ticks = (vehicle.control.grid.statistics.ticks, vehicle.trajectory.grid.statistics.ticks)
        if ticks[0] != self._ticks[0] and ticks[1] != self._ticks[1]:
            notify("WATCHDOG=1")
        self._ticks = ticks
        self._say_state()
        if now_s - self._judged_s >= SLIP_PERIOD_S:
            self._judged_s = now_s
            self._judge_grids()
        for name, text in vehicle.control.watchers.failures.items():
            self.warnings[f"{name}_failed"] = text
        for name, ask in self.asked.items():
            self._tell(name, ask())
        status = vehicle.autopilot.status.value
        self._follow_fence(status)
        self._parameters.judge_thrust()
        self._warn_of(status)
        self._follow_connection((status.connected, status.boot_count))

    def _say_state(self) -> None:
        """What `systemctl status` shows, when it is another one."""
        record = self._vehicle.record.value
        if record is None:
            return
        reason = record.supervision.reason
        said = f"{record.supervision.state.value}: {REASONS.get(reason, reason.replace('_', ' '))}"
        if said != self._said:
            self._said = said
            notify(f"STATUS={said}")

    def _warn_of(self, status: AutopilotStatus) -> None:
        slow = ", ".join(self._vehicle.autopilot.slow_streams.value) if status.connected else ""
        text = f"{slow} of the autopilot: fewer than needed arrive; look at baud rate and MAV_*_RATE"
        self._tell("slow_streams", text if slow else None)
        charge = status.battery_charge
        low = charge >= BatteryCharge.LOW
        self._tell("battery", f"the autopilot calls the battery {charge.name.lower()}" if low else None)
        self._tell("airframe", not_flown(status) or None)
        homeless = status.armed and status.home is None and status.home_ned_m is None
        astray = homeless and self._vehicle.config.safety.fence.anchor == "home"
        self._tell("home_unknown", "no home position: the fence lies about the local origin" if astray else None)

    def _tell(self, name: str, text: str | None) -> None:
        """A warning from now on; None: no longer."""
        if text is None:
            self.warnings.pop(name, None)
        elif text != self.warnings.get(name):
            self.warnings[name] = text
            log.warning(name, text=text)

    def _follow_connection(self, connection: tuple[bool, int]) -> None:
        """Ask for the parameters anew at each connection and reboot."""
        if connection == self._connection:
            return
        self._connection = connection
        self._ask_no_more()
        if connection[0]:
            self._asking = asyncio.get_running_loop().create_task(self._parameters.run())

    def _ask_no_more(self) -> None:
        if self._asking is not None:
            self._asking.cancel()

    def _judge_grids(self) -> None:
        """Warn while a task misses more than ``SLIP_SHARE`` of its ticks."""
        for name, grid in (("control", self._vehicle.control.grid), ("trajectory", self._vehicle.trajectory.grid)):
            missed = grid.statistics.missed
            lately, self._missed[name] = missed - self._missed.get(name, missed), missed
            slips = lately * grid.period_s > SLIP_SHARE * SLIP_PERIOD_S
            text = f"the {name} task missed {lately} ticks in {SLIP_PERIOD_S:g} s: the machine is busy"
            self._tell(f"{name}_slips", text if slips else None)

    def _follow_fence(self, status: AutopilotStatus) -> None:
        """The fence's anchor, where the local frame of now calls it."""
        vehicle = self._vehicle
        record = vehicle.record.value
        shift = record.estimate.shift if record else FrameShift()
        fence = geofence(vehicle.config, self._anchor(status, shift))
        vehicle.flown.place_fence(fence, shift)

    def _anchor(self, status: AutopilotStatus, shift: FrameShift) -> Vec3:
        if self._vehicle.config.safety.fence.anchor == "origin":
            return shift.origin_ned_m
        if status.home is not None and status.global_origin is not None:
            return frames.ned_from_global(status.home, status.global_origin)
        return status.home_ned_m or ZERO3
