"""The whole daemon, sockets aside, on the simulated PX4 in virtual time: a minute of flight in a few seconds."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from daemon.config import load
from daemon.flight_service import Service
from daemon.goals.hub import Hub
from daemon.goals.methods import GoalSubmit
from daemon.goals.service import Caller
from daemon.journal import Journal
from daemon.loops.goal_book import GoalEntry
from daemon.loops.goal_order import Progress
from daemon.loops.grid import LoopAlarm
from daemon.loops.vehicle import Vehicle
from daemon.messages import FlightMode, Setpoint, Vec3
from daemon.pipeline import Inputs, Record
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual

T = TypeVar("T")
CALLER = Caller(connection=1, pid=1, uid=0, operator=True)


@dataclass
class Flight:
    """The vehicle with its daemon, and all that was seen: records, setpoints that left, modes asked, goals ended."""

    px4: SimulatedPx4
    autopilot: InProcessAutopilot
    vehicle: Vehicle
    service: Service
    hub: Hub
    records: list[Record] = field(default_factory=list)
    truths: list[Vec3] = field(default_factory=list)
    sent: list[tuple[float, Setpoint]] = field(default_factory=list)
    asked: list[tuple[float, FlightMode]] = field(default_factory=list)
    ended: list[GoalEntry] = field(default_factory=list)

    @property
    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    @property
    def state(self) -> State:
        return self.vehicle.commander.state

    @property
    def position(self) -> Vec3:
        return self.px4.truth.position_ned_m

    def on_tick(self, _inputs: Inputs, record: Record) -> None:
        self.records.append(record)
        self.truths.append(self.px4.truth.position_ned_m)
        self.asked += [(record.now_s, mode) for mode in record.modes]

    def goal_progress(self, progress: Progress) -> None:
        pass

    def goal_ended(self, entry: GoalEntry) -> None:
        self.ended.append(entry)

    async def airborne(self, altitude_m: float = 5.0, engage: bool = True) -> None:
        await self.until(lambda: self.state is State.STANDBY and self.records[-1].estimate.newest is not None)
        await self.vehicle.commander.takeoff(altitude_m)
        if engage:
            await self.vehicle.commander.engage()

    async def submit(self, **params: Any) -> str:
        """goal.submit, as it comes over the socket; returns the goal's id."""
        goal_id = self.hub.new_goal(_Nobody())
        await self.service.goal_submit(GoalSubmit.model_validate(params), CALLER, goal_id)
        return goal_id

    async def goto(self, *position: float, **waypoint: Any) -> str:
        return await self.submit(waypoint={"position": list(position), **waypoint})

    async def result(self, goal_id: str, limit_s: float = 120.0) -> GoalEntry:
        await self.until(lambda: any(entry.goal_id == goal_id for entry in self.ended), limit_s)
        return next(entry for entry in self.ended if entry.goal_id == goal_id)

    async def until(self, done: Callable[[], bool], limit_s: float = 60.0) -> float:
        """Wait for it; returns how long that took, seconds of flight."""
        since_s = self.now_s
        while not done():
            if self.now_s - since_s > limit_s:
                raise AssertionError(f"not within {limit_s} s; state {self.state}, goals {self.ended}")
            await asyncio.sleep(0.01)
        return self.now_s - since_s


class _Nobody:
    def send(self, line: bytes, *, essential: bool) -> None:
        pass


class _Watched(InProcessAutopilot):
    """Notes every setpoint that leaves."""

    flight: Flight

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        self.flight.sent.append((asyncio.get_running_loop().time(), setpoint))
        return super().send_setpoint(setpoint)


def fly(
    scenario: Callable[[Flight], Awaitable[T]],
    *,
    seed: int = 1,
    noise: bool = False,
    airframe: str = "sih",
    parameters: dict[str, float | int] | None = None,
    config: dict[str, Any] | None = None,
) -> T:
    """Run a scenario in virtual time and end the flight."""

    async def main() -> T:
        loop = asyncio.get_running_loop()
        px4 = SimulatedPx4(airframe=load_airframe(airframe), seed=seed, noise=noise, parameters=parameters)
        autopilot = _Watched(px4)
        vehicle = Vehicle(load([], config), autopilot, lambda: LoopAlarm(loop), loop.time)
        hub = Hub()
        flight = Flight(px4, autopilot, vehicle, Service(vehicle, Reports(vehicle), hub, Journal(hub, None)), hub)
        autopilot.flight = flight
        vehicle.control.listeners.append(flight.on_tick)
        vehicle.trajectory.listeners.append(flight)
        tasks = asyncio.ensure_future(vehicle.run())
        run = asyncio.ensure_future(scenario(flight))
        await asyncio.wait({tasks, run}, return_when=asyncio.FIRST_COMPLETED)
        if not run.done():
            run.cancel()
            await tasks
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)
        return run.result()

    return run_virtual(main())
