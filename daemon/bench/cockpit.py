"""A vehicle's control task and commander on any autopilot, fed with a manoeuvre's references instead of a goal's."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from daemon.autopilot.port import Autopilot
from daemon.bench.manoeuvres import Manoeuvre, moved
from daemon.frames import tilt_of, yaw_of
from daemon.loops.grid import Alarm
from daemon.loops.vehicle import Vehicle
from daemon.messages import (
    WINDOW_SPACING_S,
    AutopilotStatus,
    FrameShift,
    Odometry,
    Reference,
    ReferenceWindow,
    Vec3,
)
from daemon.pipeline import Inputs, Parameters, Record
from daemon.safety.supervisor import FLYING, State
from daemon.settings import Config

READY_S = 60.0
SETTLE_S = 3.0
STILL_S = 4.0
_LEAD_S = 0.3
_WINDOW_SAMPLES = 100
_PUBLISH_S = 0.1


@dataclass(frozen=True, slots=True)
class Sample:
    """One ODOMETRY message: seconds since the manoeuvre began, its position and the reference at its own stamp.

    ``truth_ned_m`` is the true position at that stamp in the same local frame, None where nobody knows it.
    """

    time_s: float
    position_ned_m: Vec3
    reference_ned_m: Vec3
    truth_ned_m: Vec3 | None
    tilt_rad: float


@dataclass(slots=True)
class Flown:
    """A manoeuvre as it was flown; ``lost``: why it ended early, ``height_change_m``: the worst while engaging."""

    samples: list[Sample] = field(default_factory=list)
    height_change_m: float = 0.0
    lost: str | None = None
    step_s: list[float] = field(default_factory=list)


class Cockpit:
    """One vehicle that is in the air; ``truth_at`` and ``stamp_s`` tell what the simulation knows better."""

    def __init__(
        self,
        autopilot: Autopilot,
        config: Config,
        parameters: Parameters,
        alarm: Callable[[], Alarm],
        *,
        truth_at: Callable[[Odometry], Vec3 | None] = lambda _odometry: None,
        stamp_s: Callable[[Odometry], float | None] = lambda _odometry: None,
    ) -> None:
        self._vehicle = Vehicle(config, autopilot, alarm, asyncio.get_running_loop().time)
        self._vehicle.parameters.set(parameters)
        self.reference_at: Callable[[float], Reference] | None = None
        self._autopilot = autopilot
        self._control = self._vehicle.control
        self._control.listeners[:] = [self._on_tick]
        self._window = self._vehicle.trajectory.window
        self._record = self._vehicle.record
        self.commander = self._vehicle.commander
        self._truth_at = truth_at
        self._stamp_s = stamp_s
        self._flown = Flown()
        self._newest: Odometry | None = None
        self._begun_s: float | None = None
        self._engaged_height_m: float | None = None

    @property
    def status(self) -> AutopilotStatus:
        """What the autopilot says of itself."""
        return self._autopilot.status.value

    def listen(self, listener: Callable[[Inputs, Record], None]) -> None:
        """Call it after each tick from now on."""
        self._control.listeners.append(listener)

    async def run(self) -> None:
        """Run link and control until cancelled."""
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._autopilot.run())
                tasks.create_task(self._control.run())
        finally:
            await self._autopilot.close()

    async def airborne(self, height_m: float) -> None:
        """Wait for the vehicle; take off when it is on the ground."""
        commander = self.commander
        await commander.wait_for(
            lambda: commander.state in (State.STANDBY, State.PILOT, State.READY) and self._estimated(),
            READY_S,
            "connected",
        )
        if commander.state is State.STANDBY:
            await commander.wait_for(lambda: self.status.global_position is not None, READY_S, "located")
            await commander.takeoff(height_m)

    async def settle_in_hold(self) -> None:
        """Hold, and stand still for a while: the next contestant's start is no worse than the last one's."""
        if self.commander.state is not State.READY:
            await self.commander.hold()
        await asyncio.sleep(STILL_S)

    def here(self, time_s: float) -> Reference | None:
        """Rest where the vehicle is."""
        record = self._record.value
        newest = record.estimate.newest if record else None
        if newest is None:
            return None
        return Reference(time_s, newest.position_ned_m, yaw_rad=yaw_of(newest.attitude_wb))

    async def fly(self, manoeuvre: Manoeuvre, parameters: Parameters, begin: Callable[[], None]) -> Flown:
        """Engage, settle, fly the manoeuvre, hand back to Hold. ``begin`` is called when the manoeuvre begins."""
        self._flown, self._begun_s, self._engaged_height_m = Flown(), None, None
        self._window.set(None)
        self._vehicle.parameters.set(parameters)
        self.reference_at = None
        self._engaged_height_m = self._height_m()
        await self.commander.engage()
        await asyncio.sleep(SETTLE_S)
        self._engaged_height_m = None
        begin()
        flown = self._flown
        if self.commander.state in FLYING:
            await self._feed(manoeuvre, flown)
        self._begun_s = None
        self._window.set(None)
        if self.commander.state in FLYING:
            await self.commander.hold()
        return flown

    async def _feed(self, manoeuvre: Manoeuvre, flown: Flown) -> None:
        """Publish windows ten times a second until the manoeuvre is over or the vehicle is no longer ours."""
        loop = asyncio.get_running_loop()
        record = self._record.value
        assert record is not None and record.reference is not None
        start, shift = record.reference, record.estimate.shift
        begun_s = loop.time() + _LEAD_S

        def at(time_s: float) -> Reference:
            relative = manoeuvre.reference_at(max(0.0, time_s - begun_s))
            placed = moved(relative, start.position_ned_m, begun_s, start.yaw_rad)
            return placed if time_s >= begun_s else _dated(placed, time_s)

        self.reference_at = at
        self._begun_s = begun_s
        while loop.time() < begun_s + manoeuvre.duration_s:
            if self.commander.state not in FLYING:
                flown.lost = record.supervision.reason if (record := self._record.value) else "disconnected"
                break
            self._window.set(_window(at, loop.time(), shift))
            await asyncio.sleep(_PUBLISH_S)
        self.reference_at = None

    def _estimated(self) -> bool:
        record = self._record.value
        return record is not None and record.estimate.newest is not None

    def _height_m(self) -> float | None:
        odometry = self._autopilot.odometry.value
        if odometry is None:
            return None
        truth = self._truth_at(odometry)
        return -(truth or odometry.position_m)[2]

    def _on_tick(self, inputs: Inputs, record: Record) -> None:
        odometry = inputs.odometry
        if odometry is None or odometry is self._newest or record.estimate.newest is None:
            return
        self._newest = odometry
        if self._engaged_height_m is not None:
            height_m = self._height_m() or self._engaged_height_m
            self._flown.height_change_m = max(self._flown.height_change_m, abs(height_m - self._engaged_height_m))
        if self._begun_s is None or self.reference_at is None:
            return
        stamp_s = self._stamp_s(odometry)
        if stamp_s is None:
            stamp_s = record.estimate.newest.time_s
        if stamp_s < self._begun_s:
            return
        self._flown.step_s.append(self._control.step_s)
        self._flown.samples.append(
            Sample(
                stamp_s - self._begun_s,
                odometry.position_m,
                self.reference_at(stamp_s).position_ned_m,
                self._truth_at(odometry),
                tilt_of(odometry.attitude_wb),
            )
        )


def _dated(r: Reference, time_s: float) -> Reference:
    """The reference at rest, at another time."""
    return Reference(time_s, r.position_ned_m, yaw_rad=r.yaw_rad)


def _window(at: Callable[[float], Reference], from_s: float, shift: FrameShift) -> ReferenceWindow:
    samples = tuple(at(from_s + i * WINDOW_SPACING_S) for i in range(_WINDOW_SAMPLES))
    return ReferenceWindow("bench", samples, shift)
