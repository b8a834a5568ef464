"""The health task: feeds the watchdog while both tasks tick, follows home and the autopilot's parameters, warns."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING

from daemon import frames, logs
from daemon.loops.grid import Grid
from daemon.messages import ZERO3, AutopilotStatus, FrameShift, Vec3
from daemon.notify import notify
from daemon.parameters import geofence, pipeline_parameters

if TYPE_CHECKING:
    from daemon.loops.vehicle import Vehicle

PARAMETER_TIMEOUT_S = 2.0
SLIP_PERIOD_S = 5.0
SLIP_SHARE = 0.02
HOVER_PARAMETER = "MPC_THR_HOVER"
HOVER_RANGE = (0.1, 0.9)

log = logs.get("health")


@dataclass(frozen=True, slots=True)
class Advice:
    """A parameter of the autopilot that is dangerous when ``bad`` says so of its value, what to set, and why."""

    name: str
    bad: Callable[[float], bool]
    text: str


ADVICE = (
    Advice(
        "COM_RC_OVERRIDE",
        lambda value: not int(value) & 2,
        "set bit 1 (value 3), so that the pilot's sticks take the vehicle out of offboard",
    ),
    Advice(
        "COM_OF_LOSS_T",
        lambda value: value > 1.0,
        "set 1.0 s or less: until then the vehicle keeps turning at the last rate when the daemon falls silent",
    ),
    Advice(
        "COM_OBL_RC_ACT",
        lambda value: int(value) in (1, 2, 6, 7),
        "set 5 (Hold) or 4 (Land), what the autopilot does when offboard is lost",
    ),
)


class HealthTask:
    """Runs at 5 Hz beside the other tasks."""

    def __init__(self, vehicle: Vehicle, grid: Grid) -> None:
        self.warnings: dict[str, str] = {}
        self._vehicle = vehicle
        self._grid = grid
        self._ticks = (-1, -1)
        self._asked_boot: tuple[bool, int] = (False, -1)
        self._asking: asyncio.Task[None] | None = None
        self._missed: dict[str, int] = {}
        self._judged_s = -inf

    async def run(self) -> None:
        """Run until cancelled."""
        try:
            await self._grid.run(self._tick)
        finally:
            if self._asking is not None:
                self._asking.cancel()

    def _tick(self, now_s: float, _dt_s: float) -> None:
        vehicle = self._vehicle
        ticks = (vehicle.control.grid.statistics.ticks, vehicle.trajectory.grid.statistics.ticks)
        if ticks[0] != self._ticks[0] and ticks[1] != self._ticks[1]:
            notify("WATCHDOG=1")
        self._ticks = ticks
        if now_s - self._judged_s >= SLIP_PERIOD_S:
            self._judged_s = now_s
            self._judge_grids()
        for name, text in vehicle.control.watchers.failures.items():
            self.warnings[f"{name}_failed"] = text
        status = vehicle.autopilot.status.value
        self._follow_fence(status)
        if status.connected and self._asked_boot != (True, status.boot_count):
            self._asked_boot = (True, status.boot_count)
            self._asking = asyncio.get_running_loop().create_task(self._ask_parameters())
        elif not status.connected:
            self._asked_boot = (False, status.boot_count)

    def _judge_grids(self) -> None:
        """Warn while a task misses more than ``SLIP_SHARE`` of its ticks."""
        for name, grid in (("control", self._vehicle.control.grid), ("trajectory", self._vehicle.trajectory.grid)):
            missed = grid.statistics.missed
            lately, self._missed[name] = missed - self._missed.get(name, missed), missed
            key, slips = f"{name}_slips", lately * grid.period_s > SLIP_SHARE * SLIP_PERIOD_S
            if slips:
                self.warnings[key] = (
                    f"the {name} task missed {lately} ticks in {SLIP_PERIOD_S:g} s: the machine is busy"
                )
                log.warning("grid_slips", task=name, missed=lately, within_s=SLIP_PERIOD_S)
            else:
                self.warnings.pop(key, None)

    def _follow_fence(self, status: AutopilotStatus) -> None:
        """The fence's anchor, where the local frame of now calls it."""
        vehicle = self._vehicle
        record = vehicle.record.value
        shift = record.estimate.shift if record else FrameShift()
        fence = geofence(vehicle.config, self._anchor(status, shift))
        before = vehicle.parameters.value
        if fence != before.bounds.fence or shift.count != before.fence_shift.count:
            bounds = replace(before.bounds, fence=fence)
            vehicle.parameters.set(replace(before, bounds=bounds, fence_shift=shift))

    def _anchor(self, status: AutopilotStatus, shift: FrameShift) -> Vec3:
        if self._vehicle.config.safety.fence.anchor == "origin":
            return shift.position_ned_m
        if status.home is not None and status.global_origin is not None:
            return frames.ned_from_global(status.home, status.global_origin)
        return status.home_ned_m or ZERO3

    async def _ask_parameters(self) -> None:
        """Take the autopilot's hover thrust where the configuration has none, and warn of dangerous parameters."""
        vehicle = self._vehicle
        hover = await vehicle.autopilot.read_parameter(HOVER_PARAMETER, PARAMETER_TIMEOUT_S)
        configured = vehicle.config.control.hover_thrust is not None
        if not configured and hover is not None and HOVER_RANGE[0] <= hover <= HOVER_RANGE[1]:
            before = vehicle.parameters.value
            made = pipeline_parameters(vehicle.config, before.bounds.fence, float(hover))
            vehicle.parameters.set(replace(made, fence_shift=before.fence_shift))
            log.info("hover_thrust_from_autopilot", hover_thrust=round(float(hover), 4))
        for advice in ADVICE:
            value = await vehicle.autopilot.read_parameter(advice.name, PARAMETER_TIMEOUT_S)
            if value is not None and advice.bad(float(value)):
                self.warnings[advice.name] = f"{advice.name} is {value:g}: {advice.text}"
                log.warning("dangerous_parameter", name=advice.name, value=value, advice=advice.text)
            else:
                self.warnings.pop(advice.name, None)
