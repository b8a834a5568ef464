"""The trajectory task: owns the goal, publishes the reference window, says when the goal is reached.

It runs at 10 Hz and at once when a goal comes, the vehicle changes hands or the estimate jumps. A new plan starts from
the reference that is being flown, so position, velocity and acceleration go on without a step; from the vehicle when
that reference has gone on without it (``following``).
"""

import asyncio
from collections.abc import Callable

from daemon import frames
from daemon.goals.results import Outcome
from daemon.guidance import planner
from daemon.guidance.brake import brake
from daemon.guidance.goals import StreamGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import JoinedPlan, Plan
from daemon.guidance.stream import StreamSample, completed, follow
from daemon.latest import Latest
from daemon.loops.active_goal import ActiveGoal
from daemon.loops.following import Following, start_of
from daemon.loops.goal_book import GoalBook
from daemon.loops.goal_order import GoalListener, GoalOrder, Progress
from daemon.loops.grid import Grid
from daemon.loops.stopping import stopping
from daemon.messages import (
    WINDOW_SPACING_S,
    AutopilotStatus,
    EstimatedState,
    FrameShift,
    GlobalPosition,
    Reference,
    ReferenceWindow,
    RequestKind,
    VehicleRequest,
)
from daemon.pipeline import Inputs, Record
from daemon.safety.geofence import Geofence
from daemon.safety.supervisor import FLYING, State

ORIGIN_MOVED_M = 0.1  # less is the rounding of what is told
PLANNING_S = 0.5  # a path planned beside the loop starts this far ahead; twice as far when that was too near
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
        self.window: Latest[ReferenceWindow | None] = Latest(None)
        self.plan: Latest[Plan | None] = Latest(None)
        self.book = GoalBook()
        self.progress: Progress | None = None
        self.listeners: list[GoalListener] = []
        self.grid = grid
        self._record = record
        self._request = request
        self._status = status
        self._limits = limits
        self._parameters = parameters
        self._fence = fence
        self._count = round(window_s / WINDOW_SPACING_S)
        self._active: ActiveGoal | None = None
        self._rest: Plan | None = None
        self._sampled: Plan | None = None
        self._shift = FrameShift()
        self._origin: GlobalPosition | None = None
        self._failure: Exception | None = None
        self._woken = False
        self._state: State | None = None
        self._outside = False
        self._following = Following()

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
        self._follow_frame(record.estimate.shift)
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
        self._follow_frame(record.estimate.shift)
        if self._following.given_up(record, self._parameters().deviation_max_m):
            self._give_up_goal()
        self._give_up_without_origin()
        start = start_of(record)
        plan = self._current_plan(start)
        if self._active is not None and record.estimate.newest is not None:
            self._judge(self._active, plan, record.estimate.newest, _speed_m_s(record), now_s)
            plan = self._current_plan(start)
        self.plan.set(plan)
        samples = self._samples(plan, record.reference.time_s)
        self.window.set(ReferenceWindow(self.goal_id, samples, record.estimate.shift))

    def _give_up_goal(self) -> None:
        """The goal's reference has gone on without the vehicle; a place that is held stays what it is."""
        if self._active is not None and not self._active.canceled:
            self._end("aborted", reason="not_followed")

    def _give_up_without_origin(self) -> None:
        """A goal on the globe cannot be made anew while nobody knows where the local frame lies."""
        active = self._active
        if active is None or active.canceled or active.plan is not None or active.order.resolve is None:
            return
        if self._status.value.global_origin is None:
            self._end("aborted", reason="origin_unknown")

    def _samples(self, plan: Plan, from_s: float) -> tuple[Reference, ...]:
        """The references from ``from_s`` on; those of the last window serve again while the plan is the same."""
        window = self.window.value
        known = window.samples if window is not None and plan is self._sampled else ()
        kept = tuple(reference for reference in known if reference.time_s > from_s - WINDOW_SPACING_S)
        self._sampled = plan
        start_s = kept[-1].time_s + WINDOW_SPACING_S if kept else from_s
        return (*kept, *plan.window(start_s, self._count - len(kept)))

    def _give_up(self, record: Record) -> None:
        """The vehicle is not ours (any more): its goal ends, unless it waits for the engage that comes with it."""
        self._rest = None
        self.plan.set(None)
        self.window.set(None)
        self._shift = record.estimate.shift
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

    def _follow_frame(self, shift: FrameShift) -> None:
        """Plans keep their physical place; a goal that was given on the globe is made anew from the origin.

        That is told apart from the estimate, and may come later than the jump which belongs to it.
        """
        origin = self._status.value.global_origin
        if origin is not None and (self._origin is None or _distance_m(origin, self._origin) > ORIGIN_MOVED_M):
            self._origin = origin
            if self._active is not None and self._active.order.resolve and not self._active.canceled:
                self._active.plan = None
        if shift.count == self._shift.count:
            return
        jumped = shift.since(self._shift)
        self._shift = shift
        if self._rest is not None:
            self._rest = self._rest.shifted(*jumped, shift.time_s)
        active = self._active
        if active is not None and active.plan is not None:
            anew = active.order.resolve and not active.canceled
            active.plan = None if anew else active.plan.shifted(*jumped, shift.time_s)

    def _current_plan(self, flown: Reference) -> Plan:
        active = self._active
        if active is None or (active.plan is None and active.ahead is not None and not active.canceled):
            if self._rest is None:
                self._rest = self._stopping(flown)
            return self._rest
        if active.plan is None and active.order.plans_long and not active.canceled:
            self._plan_ahead(active, flown)
            return self._current_plan(flown)
        if active.plan is None:
            self._rest = None
            active.plan = self._stopping(flown) if active.canceled else self._planning(active.order)(flown)
        return active.plan

    def _stopping(self, flown: Reference) -> Plan:
        return stopping(flown, self.plan.value, self._limits(), self._fence())

    def _planning(self, order: GoalOrder) -> Callable[[Reference], Plan]:
        """What plans the goal, where the local frame of now has it, from a reference on."""
        goal = order.resolve(self._status.value) if order.resolve else order.goal
        return lambda start: planner.plan(start, goal, order.limits, self._parameters())

    def _plan_ahead(self, active: ActiveGoal, flown: Reference) -> None:
        """Plan beside the loop, from where the plan that is being flown, or a brake, will be then."""
        record = self._record.value
        goes_on = record is not None and flown is record.reference
        before = (self.plan.value if goes_on else None) or brake(flown, self._limits())
        self._rest = before
        needed = before.remaining(flown.time_s)
        beside = self._plan_beside(active, needed, self._planning(active.order))
        active.ahead = asyncio.get_running_loop().create_task(beside)

    async def _plan_beside(self, active: ActiveGoal, before: Plan, planned: Callable[[Reference], Plan]) -> None:
        loop, frame = asyncio.get_running_loop(), (self._shift.count, self._origin)
        lead_s = PLANNING_S
        while self._active is active and active.plan is None:
            start = before.sample(loop.time() + lead_s)
            try:
                plan = await loop.run_in_executor(None, planned, start)
            except Exception as error:  # noqa: BLE001 - comes out of run() at the next tick of the grid
                self._failure = error
                return
            if self._active is not active or active.canceled or (self._shift.count, self._origin) != frame:
                break
            if loop.time() < start.time_s:
                active.plan = JoinedPlan(before, plan)
            lead_s *= 2.0
        active.ahead = None
        self.wake()

    def _judge(self, active: ActiveGoal, plan: Plan, state: EstimatedState, speed_m_s: float, now_s: float) -> None:
        self.progress, verdict = active.judge(plan, state, speed_m_s, now_s)
        if verdict is not None:
            self._end(verdict.outcome, reason=verdict.reason)
            self._rest = plan if verdict.stays else None

    def _end(self, outcome: Outcome, *, by: str | None = None, reason: str | None = None) -> None:
        active, self._active, self.progress = self._active, None, None
        self._rest = None
        if active is None:
            return
        entry = active.entry
        entry.outcome, entry.by, entry.reason = outcome, by, reason
        entry.duration_s = asyncio.get_running_loop().time() - entry.accepted_s
        for listener in self.listeners:
            listener.goal_ended(entry)


def _distance_m(a: GlobalPosition, b: GlobalPosition) -> float:
    return frames.norm(frames.ned_from_global(a, b))


def _speed_m_s(record: Record) -> float:
    """Speed of the vehicle, without the drift of the measured velocity: PX4's is off by up to 0.4 m/s at rest."""
    assert record.estimate.newest is not None
    velocity = record.estimate.newest.velocity_ned_m_s
    if record.control is not None:
        velocity = frames.subtract(velocity, record.control.velocity_bias_ned_m_s)
    return frames.norm(velocity)
