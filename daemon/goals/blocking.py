"""The client library for programs without an event loop: the same calls, each waits until it is done.

with BlockingFlightClient() as flight:
    goal = flight.goto(10, 0, -5, yaw_deg=90)
    for feedback in goal:
        print(feedback.distance_m)
    result = goal.wait()
"""

import asyncio
import threading
from collections.abc import AsyncIterator, Coroutine, Iterator, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import NoDaemonError
from daemon.goals.connection import NOT_CONNECTED
from daemon.goals.goal import Feedback, Goal, Result
from daemon.goals.listeners import Telemetry
from daemon.goals.results import GoalRecord, Setting, SettingValue, Status, SystemInfo, VehicleDone

T = TypeVar("T")


class BlockingGoal:
    """Iterate for its feedback until it ends, `wait` for its `Result`."""

    def __init__(self, client: "BlockingFlightClient", goal: Goal) -> None:
        self._client = client
        self._goal = goal
        self.goal_id = goal.goal_id
        self.preempted = goal.preempted

    @property
    def done(self) -> bool:
        """Tell whether the goal has ended."""
        return self._goal.done

    def wait(self, timeout_s: float | None = None) -> Result:
        """Wait until the goal ends. Raises `TimeoutError` after ``timeout_s``; the goal goes on then."""

        async def ended() -> Result:
            return await asyncio.wait_for(self._goal.result(), timeout_s)

        return self._client.do(ended())

    def cancel(self) -> None:
        """Cancel: the vehicle brakes and holds; the result with ``canceled`` follows."""
        self._client.do(self._goal.cancel())

    def move(self, north: float, east: float, down: float, **waypoint: Any) -> None:
        """Move the goal without ending it."""
        self._client.do(self._goal.move(north, east, down, **waypoint))

    def __iter__(self) -> Iterator[Feedback]:
        return self._client.iterate(aiter(self._goal))


class BlockingFlightClient:
    """As `FlightClient`, on an event loop in a thread of its own; may be used from several threads."""

    def __init__(self, socket: str | Path | None = None, *, reconnect_s: float = 10.0) -> None:
        self._client = FlightClient(socket, reconnect_s=reconnect_s)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="flight-client", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        try:
            self.do(self._client.__aenter__())
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.do(self._client.close())
        self.do(self._loop.shutdown_asyncgens())
        self._stop()

    def _stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def do(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the client's loop and wait for what it returns.

        Raises `NoDaemonError` outside of the ``with`` block.
        """
        if not self._thread.is_alive():
            work.close()
            raise NoDaemonError(NOT_CONNECTED)
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise

    def iterate(self, stream: AsyncIterator[T]) -> Iterator[T]:
        """Iterate over what the client's loop brings."""

        async def following() -> tuple[T] | None:
            async for item in stream:
                return (item,)
            return None

        while (found := self.do(following())) is not None:
            yield found[0]

    def call(self, method: str, /, **params: Any) -> dict[str, Any]:
        """Result of any method of the protocol; parameters that are None are left out."""
        return self.do(self._client.call(method, **params))

    def info(self) -> SystemInfo:
        """What the daemon is."""
        return self.do(self._client.info())

    def status(self) -> Status:
        """How the vehicle, the goal and the loops are."""
        return self.do(self._client.status())

    def goal_record(self, goal_id: str) -> GoalRecord:
        """How a goal is or how it ended."""
        return self.do(self._client.goal_record(goal_id))

    def get_config(self, path: str) -> Setting:
        """A setting by its dotted path."""
        return self.do(self._client.get_config(path))

    def set_config(self, path: str, value: SettingValue) -> Setting:
        """Change a setting until the daemon restarts."""
        return self.do(self._client.set_config(path, value))

    def telemetry(self, *topics: str, rate_hz: float = 10.0) -> Iterator[Telemetry]:
        """Notifications of the topics, from the first one asked for on."""
        return self.iterate(self._client.telemetry(*topics, rate_hz=rate_hz))

    def arm(self) -> VehicleDone:
        """Arm."""
        return self.do(self._client.arm())

    def disarm(self) -> VehicleDone:
        """Disarm; refused unless landed."""
        return self.do(self._client.disarm())

    def takeoff(self, altitude_m: float) -> VehicleDone:
        """Take off, and return when the vehicle is in the air and holds."""
        return self.do(self._client.takeoff(altitude_m))

    def engage(self) -> VehicleDone:
        """Take the vehicle from Hold."""
        return self.do(self._client.engage())

    def hold(self) -> VehicleDone:
        """Release the vehicle to the autopilot's Hold."""
        return self.do(self._client.hold())

    def land(self) -> VehicleDone:
        """Land here, and return when disarmed."""
        return self.do(self._client.land())

    def return_to_launch(self) -> VehicleDone:
        """Return to launch, and return from this call when disarmed."""
        return self.do(self._client.return_to_launch())

    def goto(self, north: float, east: float, down: float, **more: Any) -> BlockingGoal:
        """Fly to a position; takes what `FlightClient.goto` takes."""
        return BlockingGoal(self, self.do(self._client.goto(north, east, down, **more)))

    def path(self, waypoints: Sequence[Sequence[float] | dict[str, Any]], **more: Any) -> BlockingGoal:
        """Fly along waypoints; takes what `FlightClient.path` takes."""
        return BlockingGoal(self, self.do(self._client.path(waypoints, **more)))

    def fly(self, trajectory: dict[str, Any], **more: Any) -> BlockingGoal:
        """Fly a circle, a lemniscate, a polynomial or a hold."""
        return BlockingGoal(self, self.do(self._client.fly(trajectory, **more)))

    def stream(self, **more: Any) -> BlockingGoal:
        """Begin to be the planner: send references with `send_reference`; takes what `FlightClient.stream` takes."""
        return BlockingGoal(self, self.do(self._client.stream(**more)))

    def submit(self, goal: dict[str, Any], **more: Any) -> BlockingGoal:
        """Submit a goal as the protocol has it; takes what `FlightClient.submit` takes."""
        return BlockingGoal(self, self.do(self._client.submit(goal, **more)))

    def update(self, goal_id: str, north: float, east: float, down: float, **waypoint: Any) -> None:
        """Move the active goal without ending it."""
        self.do(self._client.update(goal_id, north, east, down, **waypoint))

    def send_reference(self, goal_id: str, position: Sequence[float], velocity: Sequence[float], **more: Any) -> None:
        """Send the next reference of a stream goal, local NED; ``more`` as in reference.set."""
        self.do(self._client.send_reference(goal_id, position, velocity, **more))

    def send_pose(self, position: Sequence[float], orientation: Sequence[float], **more: Any) -> None:
        """Feed a pose from outside to the estimator; ``more`` as in estimator.pose."""
        self.do(self._client.send_pose(position, orientation, **more))

    def cancel(self, goal_id: str | None = None) -> str:
        """Cancel a goal, or the active one; returns its id at once."""
        return self.do(self._client.cancel(goal_id))
