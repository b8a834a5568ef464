"""The trajectory task: owns the goal, publishes the reference window, says when the goal is reached.

It runs at 10 Hz and at once when a goal comes, the vehicle changes hands or the estimate jumps. A new plan starts from
the reference that is being flown, so position, velocity and acceleration go on without a step; from the vehicle when
that reference has gone on without it (``following``).
"""

import asyncio
from collections.abc import Callable

from daemon import frames
from daemon.goals.results import Outcome
from daemon.guidance.goals import StreamGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.stream import StreamSample, completed, follow
from daemon.latest import Latest
from daemon.loops.active_goal import ActiveGoal
from daemon.loops.flown_plan import FlownPlan
from daemon.loops.following import Following, start_of
from daemon.loops.goal_book import GoalBook
from daemon.loops.goal_order import GoalListener, GoalOrder, Progress
from daemon.loops.grid import Grid
from daemon.loops.window_writer import WindowWriter
from daemon.messages import AutopilotStatus, EstimatedState, ReferenceWindow, RequestKind, VehicleRequest
from daemon.pipeline import Inputs, Record
from daemon.safety.geofence import Geofence
from daemon.safety.supervisor import FLYING, State

WAITING = frozenset({State.READY, State.ENGAGING, State.PILOT, State.FAULT})


class TrajectoryTask:
    """Writes ``window``; everything else it reads. ``submit``, ``update`` and ``cancel`` are the mailbox."""

    def __init__(
        self,
        grid: Grid,
        record: Latest[Record | None],
        request: Latest[VehicleRequest | None],
        status: Latest[AutopilotStatus],
        limits: Callable[[], MotionLimits],
        parameters: Callable[[], GuidanceParameters],
        fence: Callable[[], Geofence],
        window_s: float,
    ) -> None:
        self.book = GoalBook()
        self.progress: Progress | None = None
        self.listeners: list[GoalListener] = []
        self.grid = grid
        self._record = record
        self._request = request
        self._status = status
        self._parameters = parameters
        self._active: ActiveGoal | None = None
        self._plans = FlownPlan(record, status, limits, parameters, fence, self.wake, self._fail)
        self._writer = WindowWriter(window_s, limits, fence)
        self._failure: Exception | None = None
        self._woken = False
        self._state: State | None = None
        self._outside = False
        self._following = Following()

    @property
    def window(self) -> Latest[ReferenceWindow | None]:
        """What the control task flies."""
        return self._writer.window

    @property
    def plan(self) -> Latest[Plan | None]:
        """The plan that the window is of."""
        return self._plans.plan

    @property
    def goal_id(self) -> str | None:
        """The active goal."""
        return self._active.order.goal_id if self._active else None

    @property
    def order(self) -> GoalOrder | None:
        """The active goal's order."""
        return self._active.order if self._active else None

    @property
    def streamed(self) -> StreamSample | None:
        """The newest reference of the active goal, if that is a stream."""
        return self._active.streamed if self._active else None

    @property
    def canceled(self) -> bool:
        """Whether the active goal brakes because it was canceled."""
        return self._active is not None and self._active.canceled

    async def run(self) -> None:
        """Tick until cancelled."""
        await self.grid.run(self._on_grid)

    def submit(self, order: GoalOrder) -> str | None:
        """Take a goal; the one that was active ends ``preempted``, and its id is returned."""
        now_s = asyncio.get_running_loop().time()
        preempted = self.goal_id
        self._end("preempted", by=order.goal_id)
        self._active = ActiveGoal(order, self.book.open(order.goal_id, order.kind, now_s))
        self.wake()
        return preempted

    def update(self, order: GoalOrder) -> None:
        """Move the active goal without ending it."""
        if self._active is None:
            return
        self._active.order = order
        self._active.plan = None
        self._active.within_since_s = self._active.reached_s = None
        self.wake()

    def cancel(self) -> None:
        """Brake; the result ``canceled`` follows when the vehicle is at rest."""
        if self._active is not None and not self._active.canceled:
            self._active.canceled = True
            self._active.plan = None
            self.wake()

    def abort(self, goal_id: str, reason: str) -> None:
        """End a goal that cannot be flown; the vehicle brakes and holds."""
        if self.goal_id == goal_id:
            self._end("aborted", reason=reason)
            self.wake()

    def stream(self, sample: StreamSample, allow: Callable[[Plan], None] = lambda _plan: None) -> None:
        """Take the next reference of the active stream goal; the window follows it at once.

        ``allow`` raises when the plan that follows it and brakes at its time-out may not be flown: nothing changes.
        """
        active = self._active
        record = self._record.value
        if active is None or record is None or record.reference is None or active.canceled:
            return
        goal = active.order.goal
        if not isinstance(goal, StreamGoal):
            return
        sample = completed(sample, active.streamed, active.order.limits)
        self._plans.follow_frame(active, record.estimate.shift)
        plan = follow(start_of(record), sample, goal.timeout_s, active.order.limits, self._parameters())
        allow(plan)
        active.streamed, active.plan = sample, plan
        self.wake()

    def wake(self) -> None:
        """Tick at the next pass of the loop."""
        if not self._woken:
            self._woken = True
            asyncio.get_running_loop().call_soon(self._on_wake)

    def on_control_tick(self, _inputs: Inputs, record: Record) -> None:
        """A listener of the control task: act at once when the vehicle changed hands or the estimate jumped.

        A goal ends when the vehicle crosses the fence outwards, whatever drove it there: the reference brakes inside.
        """
        outside, self._outside = self._outside, record.conditions.fence_crossed
        if self._outside and not outside and self._active is not None:
            self.abort(self._active.order.goal_id, "geofence")
        if record.supervision.state is not self._state or record.estimate.reset is not None:
            self._state = record.supervision.state
            self.wake()

    def _on_wake(self) -> None:
        self._woken = False
        try:
            self.tick(asyncio.get_running_loop().time())
        except Exception as error:  # noqa: BLE001 - comes out of run() at the next tick of the grid
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._failure = error

    def _on_grid(self, now_s: float, _dt_s: float) -> None:
        if self._failure is not None:
            raise self._failure
        self.tick(now_s)
        if self.progress is not None:
            for listener in self.listeners:
                listener.goal_progress(self.progress)

    def tick(self, now_s: float) -> None:
        """Read, plan, publish."""
        record = self._record.value
        if record is None:
            return
        if record.supervision.state not in FLYING or record.reference is None:
            self._give_up(record)
            return
        self._plans.follow_frame(self._active, record.estimate.shift)
        if self._following.given_up(record, self._parameters().deviation_max_m):
            self._give_up_goal()
        if self._writer.ran_out(record.reference.time_s):
            self._stop_where_flown()
        self._give_up_without_origin()
        start = start_of(record)
        plan = self._plans.current(self._active, start)
        if self._active is not None and record.estimate.newest is not None:
            self._judge(self._active, plan, record.estimate.newest, _speed_m_s(record), now_s)
            plan = self._plans.current(self._active, start)
        self.plan.set(plan)
        self._writer.write(self.goal_id, plan, record.reference.time_s, record.estimate.shift)

    def _give_up_goal(self) -> None:
        """The goal's reference has gone on without the vehicle; a place that is held stays what it is."""
        if self._active is not None and not self._active.canceled:
            self._end("aborted", reason="not_followed")

    def _stop_where_flown(self) -> None:
        """No window came for so long that the control task has braked: the plans have gone on without it."""
        active = self._active
        if active is not None and (active.plan is not None or active.ahead is not None):
            self._give_up_goal()
        self._plans.restart(self._active)

    def _give_up_without_origin(self) -> None:
        """A goal on the globe cannot be made anew while nobody knows where the local frame lies."""
        active = self._active
        if active is None or active.canceled or active.plan is not None or active.order.resolve is None:
            return
        if self._status.value.global_origin is None:
            self._end("aborted", reason="origin_unknown")

    def _give_up(self, record: Record) -> None:
        """The vehicle is not ours (any more): its goal ends, unless it waits for the engage that comes with it."""
        self._plans.give_up(record.estimate.shift)
        self._writer.clear()
        if self._active is None:
            return
        reason, request = record.supervision.reason, self._request.value
        if self._active.flying_since_s is not None:
            reason = record.supervision.left
        elif record.supervision.state in WAITING:
            if request is None or request.kind is RequestKind.ENGAGE:
                return
            reason = "requested"
        if reason == "requested" and request is not None:
            self._end("canceled", reason=f"vehicle.{request.kind.value}")
        else:
            self._end("aborted", reason=reason)

    def _judge(self, active: ActiveGoal, plan: Plan, state: EstimatedState, speed_m_s: float, now_s: float) -> None:
        self.progress, verdict = active.judge(plan, state, speed_m_s, now_s)
        if verdict is not None:
            self._end(verdict.outcome, reason=verdict.reason)
            self._plans.rest(plan if verdict.stays else None)

    def _end(self, outcome: Outcome, *, by: str | None = None, reason: str | None = None) -> None:
        active, self._active, self.progress = self._active, None, None
        self._plans.rest(None)
        if active is None:
            return
        entry = active.entry
        entry.outcome, entry.by, entry.reason = outcome, by, reason
        entry.duration_s = asyncio.get_running_loop().time() - entry.accepted_s
        for listener in self.listeners:
            listener.goal_ended(entry)


def _speed_m_s(record: Record) -> float:
    """Speed of the vehicle, without the drift of the measured velocity: PX4's is off by up to 0.4 m/s at rest."""
    assert record.estimate.newest is not None
    velocity = record.estimate.newest.velocity_ned_m_s
    if record.control is not None:
        velocity = frames.subtract(velocity, record.control.velocity_bias_ned_m_s)
    return frames.norm(velocity)
