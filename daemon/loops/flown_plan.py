"""The plan that is flown: the active goal's, or a place to rest in; it keeps its physical place.

A long plan is made beside the loop, from where the plan that is flown until then will be.
"""

import asyncio
from collections.abc import Callable

from daemon import frames
from daemon.guidance import planner
from daemon.guidance.brake import brake
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import JoinedPlan, Plan
from daemon.latest import Latest
from daemon.loops.active_goal import ActiveGoal
from daemon.loops.goal_order import GoalOrder
from daemon.loops.stopping import stopping
from daemon.messages import AutopilotStatus, FrameShift, GlobalPosition, Reference
from daemon.pipeline import Record
from daemon.safety.geofence import Geofence

ORIGIN_MOVED_M = 0.1  # less is the rounding of what is told
PLANNING_S = 0.5  # a path planned beside the loop starts this far ahead; twice as far when that was too near


class FlownPlan:
    """Writes ``plan``, and the plans of the active goal.

    ``wake`` asks for ``current`` when a plan beside the loop is made, ``failed`` hears why none could be.
    """

    def __init__(
        self,
        record: Latest[Record | None],
        status: Latest[AutopilotStatus],
        limits: Callable[[], MotionLimits],
        parameters: Callable[[], GuidanceParameters],
        fence: Callable[[], Geofence],
        wake: Callable[[], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self.plan: Latest[Plan | None] = Latest(None)
        self._record = record
        self._status = status
        self._limits = limits
        self._parameters = parameters
        self._fence = fence
        self._wake = wake
        self._failed = failed
        self._rest: Plan | None = None
        self._shift = FrameShift()
        self._origin: GlobalPosition | None = None

    def rest(self, plan: Plan | None) -> None:
        """Without a goal fly this plan on; None: come to rest, within the fence if that can be."""
        self._rest = plan

    def restart(self, active: ActiveGoal | None) -> None:
        """What was planned so far has not been flown: plan anew, from the flown reference."""
        self._rest = None
        self.plan.set(None)
        if active is not None:
            active.plan = None

    def give_up(self, shift: FrameShift) -> None:
        """Nothing is flown any more; ``shift`` is the frame of now."""
        self._rest = None
        self._shift = shift
        self.plan.set(None)

    def follow_frame(self, active: ActiveGoal | None, shift: FrameShift) -> None:
        """Plans keep their physical place; a goal that was given on the globe is made anew from the origin.

        That is told apart from the estimate, and may come later than the jump which belongs to it.
        """
        origin = self._status.value.global_origin
        if origin is not None and (self._origin is None or _distance_m(origin, self._origin) > ORIGIN_MOVED_M):
            self._origin = origin
            if active is not None and active.order.resolve and not active.canceled:
                active.plan = None
        if shift.count == self._shift.count:
            return
        jumped = shift.since(self._shift)
        self._shift = shift
        if self._rest is not None:
            self._rest = self._rest.shifted(*jumped, shift.time_s)
        if active is not None and active.plan is not None:
            anew = active.order.resolve and not active.canceled
            active.plan = None if anew else active.plan.shifted(*jumped, shift.time_s)

    def current(self, active: ActiveGoal | None, flown: Reference) -> Plan:
        """The plan to fly on from a reference: the one there is, or a new one."""
        if active is None or (active.plan is None and active.ahead is not None and not active.canceled):
            if self._rest is None:
                self._rest = self._stopping(flown)
            return self._rest
        if active.plan is None and active.order.plans_long and not active.canceled:
            self._plan_ahead(active, flown)
            return self.current(active, flown)
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
        while active.flies and active.plan is None:
            start = before.sample(loop.time() + lead_s)
            try:
                plan = await loop.run_in_executor(None, planned, start)
            except Exception as error:  # noqa: BLE001 - comes out of the task's run()
                self._failed(error)
                return
            if not active.flies or active.canceled or (self._shift.count, self._origin) != frame:
                break
            if loop.time() < start.time_s:
                active.plan = JoinedPlan(before, plan)
            lead_s *= 2.0
        active.ahead = None
        self._wake()


def _distance_m(a: GlobalPosition, b: GlobalPosition) -> float:
    return frames.norm(frames.ned_from_global(a, b))
