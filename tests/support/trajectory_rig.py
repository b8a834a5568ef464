"""The trajectory task alone: a vehicle that flies every window exactly, in virtual time, and no control law."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from itertools import pairwise
from math import hypot
from typing import Any

import pytest

from daemon import pipeline
from daemon.config import load
from daemon.frames import add, from_yaw, scale, subtract
from daemon.guidance.goals import Goal, HoldGoal, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.latest import Latest
from daemon.loops.goal_book import GoalEntry
from daemon.loops.goal_order import GoalOrder, Progress
from daemon.loops.grid import Grid, LoopAlarm
from daemon.loops.trajectory_task import TrajectoryTask
from daemon.messages import (
    WINDOW_SPACING_S,
    AutopilotStatus,
    EstimatedState,
    FrameShift,
    GlobalPosition,
    Reference,
    ReferenceWindow,
    RequestKind,
    Vec3,
    VehicleRequest,
)
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, Record
from daemon.safety.geofence import Geofence
from daemon.safety.supervisor import FLYING, State
from daemon.sim.virtual_time import run_virtual

LIMITS = MotionLimits()
TICK_S = 0.01
ORIGIN = GlobalPosition(47.4, 8.5, 490.0)
FAR: Vec3 = (30.0, 10.0, -12.0)
NEAR: Vec3 = (2.0, -1.0, -10.0)
CONFIG = load([])
PARAMETERS = pipeline_parameters(CONFIG, geofence(CONFIG, (0.0, 0.0, 0.0)))
INPUTS = Inputs(
    odometry=None,
    imu=None,
    status=AutopilotStatus(),
    window=None,
    request=None,
    latched=False,
    parameters=PARAMETERS,
)
NOTHING: Record = pipeline.step(pipeline.initial(PARAMETERS), INPUTS, 0.0, TICK_S)[2]


class Rig:
    """The task, its cells, and what it told. Set ``state``, ``left`` and ``shift`` to play supervisor and estimator."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        self.record: Latest[Record | None] = Latest(None)
        self.request: Latest[VehicleRequest | None] = Latest(None)
        self.status: Latest[AutopilotStatus] = Latest(AutopilotStatus(global_origin=ORIGIN))
        self.task = TrajectoryTask(
            Grid(0.1, LoopAlarm(loop)),
            self.record,
            self.request,
            self.status,
            lambda: LIMITS,
            lambda: GuidanceParameters(profile=Profile.JERK_LIMITED),
            Geofence,
            1.0,
        )
        self.task.listeners.append(self)
        self.state, self.left = State.HOLDING, ""
        self.shift = FrameShift()
        self.flown = Reference(0.0, (0.0, 0.0, -10.0))
        self.history: list[Reference] = []
        self.ended: list[GoalEntry] = []
        self.progress: list[Progress] = []
        self.count = 0

    def goal_progress(self, progress: Progress) -> None:
        self.progress.append(progress)

    def goal_ended(self, entry: GoalEntry) -> None:
        self.ended.append(entry)

    @property
    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    @property
    def window(self) -> ReferenceWindow:
        assert self.task.window.value is not None
        return self.task.window.value

    def submit(self, goal: Goal | None = None, **order: object) -> str:
        self.count += 1
        goal_id = f"g{self.count}"
        made = GoalOrder(goal_id=goal_id, kind="waypoint", goal=goal or HoldGoal(duration_s=60.0), limits=LIMITS)
        self.task.submit(replace(made, **order))  # type: ignore[arg-type]
        return goal_id

    def asks(self, kind: RequestKind) -> None:
        self.request.set(VehicleRequest(1, kind))
        self.left = "requested"

    async def fly(self) -> None:
        """A control task: the window where it covers the moment, exactly."""
        while True:
            self.tick()
            await asyncio.sleep(TICK_S)

    def tick(self) -> None:
        window, now_s = self.task.window.value, self.now_s
        self.flown = replace(self.flown, time_s=now_s)
        if window is not None and self.state in FLYING:
            index = round((now_s - window.samples[0].time_s) / WINDOW_SPACING_S)
            assert 0 <= index < len(window.samples), "the window has run out"
            self.flown = window.samples[index]
        self.history.append(self.flown)
        flown = self.flown
        attitude = from_yaw(flown.yaw_rad)
        state = EstimatedState(now_s, flown.position_ned_m, flown.velocity_ned_m_s, attitude, (0.0, 0.0, 0.0))
        record = replace(
            NOTHING,
            now_s=now_s,
            estimate=replace(NOTHING.estimate, newest=state, shift=self.shift),
            supervision=replace(NOTHING.supervision, state=self.state, left=self.left),
            reference=flown if self.state in FLYING else None,
        )
        self.record.set(record)
        self.task.on_control_tick(INPUTS, record)

    async def wait(self, seconds: float) -> None:
        await asyncio.sleep(seconds)

    async def until(self, done: Callable[[], bool], limit_s: float = 60.0) -> None:
        deadline_s = self.now_s + limit_s
        while not done():
            assert self.now_s < deadline_s, "it does not come"
            await asyncio.sleep(TICK_S)

    async def end_of(self, goal_id: str) -> GoalEntry:
        await self.until(lambda: any(entry.goal_id == goal_id for entry in self.ended))
        found = [entry for entry in self.ended if entry.goal_id == goal_id]
        assert len(found) == 1
        return found[0]


def run(scenario: Callable[[Rig], Awaitable[None]]) -> None:
    """Fly a scenario; an error of the task comes out of it."""

    async def main() -> None:
        rig = Rig()
        parts = [asyncio.ensure_future(part) for part in (rig.task.run(), rig.fly())]
        played = asyncio.ensure_future(scenario(rig))
        await asyncio.wait({*parts, played}, return_when=asyncio.FIRST_COMPLETED)
        for part in parts:
            if part.done():
                played.cancel()
                part.result()
            part.cancel()
        await played

    run_virtual(main())


def slow_planning(monkeypatch: pytest.MonkeyPatch, takes_s: list[float]) -> list[float]:
    """Planning beside the loop takes that long, one number for each attempt; returns when each began."""
    loop, begun = asyncio.get_running_loop(), list[float]()

    def run_in_executor(_executor: None, work: Callable[..., object], *args: object) -> "asyncio.Task[object]":
        async def slowly() -> object:
            begun.append(loop.time())
            await asyncio.sleep(takes_s[len(begun) - 1])
            return work(*args)

        return asyncio.ensure_future(slowly())

    monkeypatch.setattr(loop, "run_in_executor", run_in_executor)
    return begun


def to(position: Vec3, **waypoint: Any) -> WaypointGoal:
    return WaypointGoal(position_ned_m=position, **waypoint)


def assert_smooth(history: list[Reference]) -> None:
    """p, v and a go on from tick to tick but for what the jerk allowed changes."""
    for one, two in pairwise(history):
        dt = two.time_s - one.time_s
        p = add(add(one.position_ned_m, scale(one.velocity_ned_m_s, dt)), scale(one.acceleration_ned_m_s2, dt * dt / 2))
        v = add(one.velocity_ned_m_s, scale(one.acceleration_ned_m_s2, dt))
        for was, now, jerk_time in (
            (p, two.position_ned_m, dt**3 / 6.0),
            (v, two.velocity_ned_m_s, dt**2 / 2.0),
            (one.acceleration_ned_m_s2, two.acceleration_ned_m_s2, dt),
        ):
            x, y, z = subtract(now, was)
            assert max(hypot(x, y), abs(z)) <= LIMITS.jerk_m_s3 * jerk_time + 1e-6, (one, two)
