"""The client library for asyncio; `daemon.goals.blocking` has the same for programs without a loop.

async with FlightClient() as flight:
    goal = await flight.goto(10, 0, -5, yaw_deg=90)
    async for feedback in goal:
        print(feedback.distance_m)
    result = await goal
"""

import os
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self, cast

from daemon.goals.client_errors import (
    ConnectionLostError,
    FlightError,
    InvalidRequestError,
    NoDaemonError,
    RequestError,
    UnknownGoalError,
)
from daemon.goals.connection import Connection
from daemon.goals.errors import ErrorCode
from daemon.goals.goal import Goal, Result, feedback_from, result_from
from daemon.goals.listeners import Listeners, Telemetry
from daemon.goals.results import GoalRecord, Setting, SettingValue, Status, SystemInfo, VehicleDone
from daemon.goals.sockets import client_path

READ_TRIES = 3
FORGOTTEN = "the daemon does not know it any more: it was restarted, or newer goals took its place"


class FlightClient:
    """A connection to the daemon. Requests that are not done raise `RequestError` (see `client_errors`).

    ``reconnect_s``: how long it tries to come back when the daemon goes away; goals and telemetry go on then. Meanwhile
    calls wait; after it they raise `NoDaemonError`.
    """

    def __init__(self, socket: str | Path | None = None, *, reconnect_s: float = 10.0) -> None:
        self.socket_path = client_path(Path(socket) if socket is not None else None, os.environ)
        self._connection = Connection(self.socket_path, reconnect_s, self._take, self._restore, self._lose)
        self._goals: dict[str, Goal] = {}
        self._listeners = Listeners()
        self._submitting = 0
        self._early: list[tuple[str, dict[str, Any]]] = []

    async def __aenter__(self) -> Self:
        await self._connection.open()
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Disconnect; goals go on."""
        await self._connection.close()
        self._lose(NoDaemonError("the connection was closed"))

    async def call(self, method: str, /, **params: Any) -> dict[str, Any]:
        """Result of any method of the protocol; parameters that are None are left out."""
        return await self._connection.call(method, _given(params))

    # -- reading

    async def _read(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask again when the daemon went away in between: reading twice does no harm."""
        for _ in range(READ_TRIES - 1):
            with suppress(ConnectionLostError):
                return await self.call(method, **params)
        return await self.call(method, **params)

    async def info(self) -> SystemInfo:
        """What the daemon is."""
        return cast(SystemInfo, await self._read("system.info"))

    async def status(self) -> Status:
        """How the vehicle, the goal and the loops are."""
        return cast(Status, await self._read("status.get"))

    async def goal_record(self, goal_id: str) -> GoalRecord:
        """How a goal is or how it ended. Raises `UnknownGoalError`."""
        return cast(GoalRecord, await self._read("goal.get", goal_id=goal_id))

    async def get_config(self, path: str) -> Setting:
        """A setting by its dotted path."""
        return cast(Setting, await self._read("config.get", path=path))

    async def set_config(self, path: str, value: SettingValue) -> Setting:
        """Change a setting until the daemon restarts."""
        return cast(Setting, await self.call("config.set", path=path, value=value))

    async def telemetry(self, *topics: str, rate_hz: float = 10.0) -> AsyncIterator[Telemetry]:
        """Notifications of the topics, from now on; one that is not taken in time is dropped for newer ones."""
        if not topics:
            reason = "name one at least"
            raise InvalidRequestError(ErrorCode.INVALID_PARAMS, f"topics: {reason}", "topics", reason)
        listener = self._listeners.add(topics, rate_hz)  # first: what comes with the reply counts too
        try:
            for params in self._listeners.subscriptions(listener.topics):
                await self._read("telemetry.subscribe", **params)
            while True:
                yield await listener.get()
        finally:
            unused = self._listeners.remove(listener)
            unused -= {"goal"} if self._goals else set()  # after a reconnection they end by it
            with suppress(FlightError):
                if unused:
                    await self._connection.call("telemetry.unsubscribe", {"topics": sorted(unused)})

    # -- the vehicle

    async def arm(self) -> VehicleDone:
        """Arm."""
        return await self._vehicle("arm")

    async def disarm(self) -> VehicleDone:
        """Disarm; refused unless landed."""
        return await self._vehicle("disarm")

    async def takeoff(self, altitude_m: float) -> VehicleDone:
        """Take off, and return when the vehicle is in the air and holds."""
        return await self._vehicle("takeoff", altitude_m=altitude_m)

    async def engage(self) -> VehicleDone:
        """Take the vehicle from Hold."""
        return await self._vehicle("engage")

    async def hold(self) -> VehicleDone:
        """Release the vehicle to the autopilot's Hold."""
        return await self._vehicle("hold")

    async def land(self) -> VehicleDone:
        """Land here, and return when disarmed."""
        return await self._vehicle("land")

    async def return_to_launch(self) -> VehicleDone:
        """Return to launch, and return from this call when disarmed."""
        return await self._vehicle("return")

    async def _vehicle(self, name: str, **params: Any) -> VehicleDone:
        return cast(VehicleDone, await self.call(f"vehicle.{name}", **params))

    # -- goals

    async def goto(
        self,
        north: float,
        east: float,
        down: float,
        *,
        limits: dict[str, float] | None = None,
        timeout_s: float | None = None,
        **waypoint: Any,
    ) -> Goal:
        """Fly to a position: metres in ``frame`` (default local NED), or latitude, longitude, altitude in ``global``.

        ``waypoint``: ``frame``, ``yaw_deg``, ``orientation``, ``mode``, ``convergence``, ``threshold``, ``hold_s``.
        """
        goal = {"waypoint": _waypoint(north, east, down, waypoint)}
        return await self.submit(goal, limits=limits, timeout_s=timeout_s)

    async def path(
        self,
        waypoints: Sequence[Sequence[float] | dict[str, Any]],
        *,
        through: str = "stop",
        limits: dict[str, float] | None = None,
        timeout_s: float | None = None,
    ) -> Goal:
        """Fly along waypoints, each a position or a waypoint as a dictionary."""
        points = [dict(point) if isinstance(point, dict) else {"position": list(point)} for point in waypoints]
        goal = {"path": {"waypoints": points, "through": through}}
        return await self.submit(goal, limits=limits, timeout_s=timeout_s)

    async def fly(
        self,
        trajectory: dict[str, Any],
        *,
        limits: dict[str, float] | None = None,
        timeout_s: float | None = None,
    ) -> Goal:
        """Fly a circle, a lemniscate, a polynomial or a hold: ``trajectory`` as in the protocol."""
        return await self.submit({"trajectory": trajectory}, limits=limits, timeout_s=timeout_s)

    async def stream(self, *, stream_timeout_s: float = 0.5, timeout_s: float | None = None) -> Goal:
        """Begin to be the planner: send references with `send_reference`."""
        return await self.submit({"stream": {"timeout_s": stream_timeout_s}}, timeout_s=timeout_s)

    async def submit(
        self, goal: dict[str, Any], *, limits: dict[str, float] | None = None, timeout_s: float | None = None
    ) -> Goal:
        """Submit a goal as the protocol has it; it preempts the one being flown."""
        self._submitting += 1
        try:
            reply = await self.call("goal.submit", **goal, limits=limits, timeout_s=timeout_s)
            handle = Goal(self, reply["goal_id"], reply["preempted"])
            self._goals[handle.goal_id] = handle
        finally:
            self._submitting -= 1
            early, self._early = self._early, []
            for method, params in early:
                self._take_goal(method, params)
        return handle

    async def update(self, goal_id: str, north: float, east: float, down: float, **waypoint: Any) -> None:
        """Move the active goal without ending it."""
        await self.call("goal.update", goal_id=goal_id, waypoint=_waypoint(north, east, down, waypoint))

    async def cancel(self, goal_id: str | None = None) -> str:
        """Cancel a goal, or the active one; returns its id at once."""
        return str((await self.call("goal.cancel", goal_id=goal_id))["goal_id"])

    async def send_reference(
        self, goal_id: str, position: Sequence[float], velocity: Sequence[float], **more: Any
    ) -> None:
        """Send the next reference of a stream goal, local NED; ``more`` as in reference.set."""
        params = _given({"goal_id": goal_id, "position": list(position), "velocity": list(velocity), **more})
        await self._connection.notify("reference.set", params)

    async def send_pose(self, position: Sequence[float], orientation: Sequence[float], **more: Any) -> None:
        """Feed a pose from outside to the estimator; ``more`` as in estimator.pose."""
        params = _given({"position": list(position), "orientation": list(orientation), **more})
        await self._connection.notify("estimator.pose", params)

    # -- what comes by itself

    def _take(self, method: str, params: dict[str, Any]) -> None:
        topic = method.removeprefix("telemetry.") if method.startswith("telemetry.") else "goal"
        data = {**params, "notification": method} if topic == "goal" else params
        self._listeners.tell(topic, data)
        if topic == "goal":
            self._take_goal(method, params)

    def _take_goal(self, method: str, params: dict[str, Any]) -> None:
        goal = self._goals.get(params["goal_id"])
        if goal is None:
            if self._submitting:
                self._early.append((method, params))
        elif method == "goal.feedback":
            goal.take_feedback(feedback_from(params))
        else:
            self._end(goal, result_from(params))

    def _end(self, goal: Goal, result: Result) -> None:
        self._goals.pop(goal.goal_id, None)
        goal.take_result(result)

    async def _restore(self) -> None:
        """After the daemon came back: get the telemetry again, and find out what became of the goals."""
        with suppress(FlightError):
            wanted = self._listeners.topics
            for params in self._listeners.subscriptions(wanted):
                await self._connection.call("telemetry.subscribe", params)
            if self._goals and "goal" not in wanted:
                await self._connection.call("telemetry.subscribe", {"topics": ["goal"], "rate_hz": 10.0})
            for goal in list(self._goals.values()):
                await self._look_up(goal)

    async def _look_up(self, goal: Goal) -> None:
        try:
            record = await self.goal_record(goal.goal_id)
        except UnknownGoalError:
            self._end(goal, Result(goal.goal_id, "aborted", reason=FORGOTTEN))
            return
        except RequestError as error:
            self._goals.pop(goal.goal_id, None)
            goal.fail(error)
            return
        if record["state"] == "done":
            self._end(goal, result_from(dict(record)))

    def _lose(self, error: NoDaemonError) -> None:
        for goal in self._goals.values():
            goal.fail(error)
        self._goals.clear()
        self._listeners.lose(error)


def _given(params: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in params.items() if value is not None}


def _waypoint(north: float, east: float, down: float, waypoint: dict[str, Any]) -> dict[str, Any]:
    return _given({"position": [north, east, down], **waypoint})
