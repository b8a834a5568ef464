"""A daemon without a vehicle behind the real socket: goals end when the test, or a script, says so."""

import asyncio
import threading
from contextlib import asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.hub import Hub
from daemon.goals.server import GoalServer
from daemon.goals.service import Identity
from daemon.goals.session import Session
from daemon.goals.sockets import Operators, listen

PATIENCE_S = 60.0
CEILING_M = 120.0
LOOP = {"rate_hz": 100.0, "period_p99_ms": 10.4, "late": 0, "missed": 0}
SETTING = {"path": "guidance.limits.speed_m_s", "value": 5.0, "min": 0.1, "max": 25.0, "unit": "m/s", "settable": True}

IN_HOLD = {"state": "ready", "mode": "hold", "armed": True, "landed": "in_air"}
ON_GROUND = {"state": "standby", "mode": "hold", "armed": False, "landed": "on_ground"}
DONE = {
    "arm": ON_GROUND | {"armed": True},
    "disarm": ON_GROUND,
    "takeoff": IN_HOLD,
    "engage": IN_HOLD | {"state": "holding", "mode": "offboard"},
    "hold": IN_HOLD,
    "land": ON_GROUND | {"mode": "land"},
    "return": ON_GROUND | {"mode": "return"},
}


class FakeFlight:
    """Implements `FlightService`. ``auto`` is the outcome that goals reach by themselves after ``steps`` feedbacks."""

    def __init__(self, hub: Hub, auto: str | None = None, steps: int = 3, step_s: float = 0.01):
        self.hub, self.auto, self.steps, self.step_s = hub, auto, steps, step_s
        self.calls: list[tuple[str, object]] = []
        self.active: str | None = None
        self.kind = ""
        self.records: dict[str, dict] = {}
        self.references: list[object] = []
        self.release = asyncio.Event()
        self.setting = dict(SETTING)
        self.state = "ready"
        self.releases = 0
        self.standstills = 0
        self.look = lambda: None
        self._tasks: set[asyncio.Task] = set()

    def identity(self):
        return Identity("c0ffee", 12.5)

    async def status_get(self, params, caller):
        goal = None
        if self.active is not None:
            goal = {"goal_id": self.active, "kind": self.kind, "distance_m": 4.0, "angle_deg": 1.0}
            goal |= {"progress": 0.5, "eta_s": 3.0}
        vehicle = {"position_ned_m": [1.0, 2.0, -3.0], "velocity_ned_m_s": [0.0, 0.0, 0.0]}
        vehicle |= {"attitude_wb": [1.0, 0.0, 0.0, 0.0], "rates_frd_rad_s": [0.0, 0.0, 0.0]}
        vehicle |= {"age_s": 0.004, "covariance_m2": 0.01}
        autopilot = {"connected": True, "mode": "hold", "intended_mode": "hold", "armed": True}
        autopilot |= {"landed": "in_air", "battery_pct": 87.0, "round_trip_ms": 4.0}
        return {
            "state": self.state,
            "reasons": [{"code": "ready", "text": "airborne in Hold"}],
            "autopilot": autopilot,
            "vehicle": vehicle,
            "goal": goal,
            "loops": {"control": LOOP, "trajectory": LOOP, "garbage": {"collections": 5, "longest_ms": 0.4}},
            "counters": {"resets": 0, "refused": {"stale": 2}},
        }

    async def _vehicle(self, name, params, caller):
        self.calls.append((name, params))
        if self.state == "standby" and name not in ("arm", "takeoff"):
            raise ProtocolError(ErrorCode.WRONG_STATE, "the vehicle is in standby")
        return dict(DONE[name])

    async def vehicle_arm(self, params, caller):
        return await self._vehicle("arm", params, caller)

    async def vehicle_disarm(self, params, caller):
        return await self._vehicle("disarm", params, caller)

    async def vehicle_takeoff(self, params, caller):
        if params.altitude_m == 99.0:
            await self.release.wait()
        return await self._vehicle("takeoff", params, caller)

    async def vehicle_engage(self, params, caller):
        return await self._vehicle("engage", params, caller)

    async def vehicle_hold(self, params, caller):
        self.releases += 1
        if self.active is not None:
            self.end(self.active, "canceled", reason="vehicle.hold")
        return await self._vehicle("hold", params, caller)

    async def vehicle_land(self, params, caller):
        return await self._vehicle("land", params, caller)

    async def vehicle_return(self, params, caller):
        return await self._vehicle("return", params, caller)

    async def goal_submit(self, params, caller, goal_id):
        if params.waypoint is not None and params.waypoint.position is not None:
            down = params.waypoint.position[2]
            if params.waypoint.frame == "local_ned" and -down > CEILING_M:
                reason = f"a height of {-down:g} m is above the fence's ceiling of {CEILING_M:g} m"
                raise ProtocolError(ErrorCode.REFUSED, reason, "waypoint.position[2]")
            if down == -13.0:
                raise RuntimeError("a mistake of the daemon's")
        self.calls.append(("submit", params))
        preempted = self.active
        if preempted is not None:
            self.end(preempted, "preempted", by=goal_id)
        self.active, self.kind = goal_id, type(params.goal).__name__.lower()
        self.records[goal_id] = self._record(goal_id)
        if self.auto == "instant":
            self.end(goal_id, "succeeded")
        elif self.auto is not None:
            task = asyncio.get_running_loop().create_task(self._fly(goal_id))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        return {"goal_id": goal_id, "preempted": preempted}

    async def _fly(self, goal_id):
        for step in range(self.steps):
            await asyncio.sleep(self.step_s)
            if self.active == goal_id:
                self.feedback(goal_id, 1.0 - step / self.steps)
        if self.active == goal_id:
            self.end(goal_id, self.auto, reason=None if self.auto == "succeeded" else "timeout")

    def _record(self, goal_id, **known):
        keys = ("outcome", "by", "reason", "error_m", "error_deg", "duration_s")
        return {"goal_id": goal_id, "state": "active"} | dict.fromkeys(keys) | known

    @staticmethod
    def wait_until(condition):
        """Wait in another thread than the daemon's until something is so."""
        for _ in range(3000):
            if condition():
                return
            threading.Event().wait(0.01)
        raise AssertionError("it never came")

    def feedback(self, goal_id, left=0.5):
        feedback = {"goal_id": goal_id, "distance_m": 10.0 * left, "angle_deg": 2.0, "progress": 1.0 - left}
        self.hub.goal_feedback(feedback | {"eta_s": 5.0 * left})

    def end(self, goal_id, outcome="succeeded", by=None, reason=None):
        done = {"outcome": outcome, "by": by, "reason": reason, "error_m": 0.12, "error_deg": 0.5, "duration_s": 4.2}
        self.records[goal_id] = self._record(goal_id, **done) | {"state": "done"}
        if self.active == goal_id:
            self.active = None
        self.hub.goal_result(self.records[goal_id])

    async def goal_update(self, params, caller):
        self._known(params.goal_id)
        self.calls.append(("update", params))
        return {"goal_id": params.goal_id}

    async def goal_cancel(self, params, caller):
        goal_id = params.goal_id or self.active
        if goal_id is None:
            raise ProtocolError(ErrorCode.WRONG_STATE, "no goal is active")
        self._known(goal_id)
        asyncio.get_running_loop().call_soon(self.end, goal_id, "canceled")
        return {"goal_id": goal_id}

    async def goal_get(self, params, caller):
        self._known(params.goal_id)
        return self.records[params.goal_id]

    def _known(self, goal_id):
        if goal_id not in self.records:
            raise ProtocolError(ErrorCode.UNKNOWN_GOAL, f"there is no goal {goal_id}", "goal_id")

    async def config_get(self, params, caller):
        self._setting(params.path)
        return self.setting

    async def config_set(self, params, caller):
        self._setting(params.path)
        if not self.setting["min"] <= params.value <= self.setting["max"]:
            raise ProtocolError(ErrorCode.REFUSED, f"{params.value:g} is not within 0.1 to 25 m/s", "value")
        self.setting["value"] = params.value
        return self.setting

    def _setting(self, path):
        if path != self.setting["path"]:
            raise ProtocolError(ErrorCode.REFUSED, f"there is no setting {path}", "path")

    def reference_set(self, params, caller):
        self._known(params.goal_id)
        self.references.append(params)

    def estimator_pose(self, params, caller):
        raise ProtocolError(ErrorCode.WRONG_STATE, "the estimator is not configured to take a pose")


class ObserverServer(GoalServer):
    """A server that finds no operator among its peers: the tests' own user always is one."""

    def opened(self, session: Session) -> bool:
        session.caller = replace(session.caller, operator=False)
        return super().opened(session)


@asynccontextmanager
async def serving(path: Path, *, observers=False, prefix="g", **fake):
    """A fake daemon that listens at ``path``, inside the running loop."""
    hub = Hub(prefix)
    flight = FakeFlight(hub, **fake)
    server = (ObserverServer if observers else GoalServer)(flight, hub, Operators(), lambda: flight.look())
    await server.start(await listen(path))
    flight.server = server
    try:
        yield flight
    finally:
        await server.stop()


@contextmanager
def serving_in_thread(path: Path, **fake):
    """A fake daemon in a thread of its own, for clients that block."""
    started, holder = threading.Event(), {}

    async def serve():
        async with serving(path, **fake) as flight:
            holder.update(flight=flight, loop=asyncio.get_running_loop(), stop=asyncio.Event())
            started.set()
            await holder["stop"].wait()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    assert started.wait(60.0)
    holder["flight"].loop = holder["loop"]
    try:
        yield holder["flight"]
    finally:
        holder["loop"].call_soon_threadsafe(holder["stop"].set)
        thread.join(60.0)
