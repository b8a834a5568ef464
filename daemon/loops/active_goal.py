"""The goal that is being flown: how far it is, and whether it has ended."""

import asyncio
from dataclasses import dataclass
from math import degrees

from daemon import frames
from daemon.goals.results import Outcome
from daemon.guidance.convergence import Tolerance, converged
from daemon.guidance.goals import Goal, PathGoal, StreamGoal, WaypointGoal
from daemon.guidance.plan import Plan
from daemon.guidance.stream import StreamSample
from daemon.guidance.waypoint_modes import Pose, PoseError, WaypointMode, pose_error
from daemon.loops.goal_book import GoalEntry
from daemon.loops.goal_order import GoalOrder, Progress
from daemon.messages import EstimatedState

REST_SPEED_M_S = 0.3


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a goal ended. ``stays``: its plan goes on as the place to hold."""

    outcome: Outcome
    reason: str | None = None
    stays: bool = False


@dataclass(slots=True)
class ActiveGoal:
    """``plan`` None: to be planned from the flown reference; ``ahead``: a plan is being made beside the loop."""

    order: GoalOrder
    entry: GoalEntry
    plan: Plan | None = None
    ahead: "asyncio.Task[None] | None" = None
    canceled: bool = False
    streamed: StreamSample | None = None
    flying_since_s: float | None = None
    within_since_s: float | None = None
    reached_s: float | None = None

    @property
    def flies(self) -> bool:
        """Whether it has not ended."""
        return self.entry.outcome is None

    def judge(
        self, plan: Plan, state: EstimatedState, speed_m_s: float, now_s: float
    ) -> tuple[Progress | None, Verdict | None]:
        """Progress of now, and the verdict when it has ended; ``speed_m_s`` is that of the vehicle.

        There is no progress while the goal is being planned: ``plan`` is the one before.
        """
        order = self.order
        self.flying_since_s = now_s if self.flying_since_s is None else self.flying_since_s
        mode = order.goal.mode if isinstance(order.goal, WaypointGoal) else WaypointMode.FULL_POSE
        target = plan.target
        error = pose_error(
            mode,
            Pose(state.position_ned_m, frames.from_yaw(frames.yaw_of(state.attitude_wb))),
            Pose(target.position_ned_m, frames.from_yaw(target.yaw_rad)),
        )
        verdict = self._verdict(plan, error, speed_m_s, now_s, self.flying_since_s)
        if self.plan is None:
            return None, verdict
        self.entry.error_m, self.entry.error_deg = error.position_m, degrees(error.angle_rad)
        eta_s = max(0.0, plan.end_s - now_s) + self._hold_left_s(now_s)
        progress = Progress(order.goal_id, order.kind, error.position_m, error.angle_rad, plan.progress(now_s), eta_s)
        return progress, verdict

    @property
    def _last(self) -> Goal:
        """What is converged to and held: a goal, or the last waypoint of a path."""
        goal = self.order.goal
        return goal.waypoints[-1] if isinstance(goal, PathGoal) else goal

    def _hold_left_s(self, now_s: float) -> float:
        """What is left of the hold, which begins when the goal is reached."""
        if self.canceled or not isinstance(self._last, WaypointGoal):
            return 0.0
        held_s = 0.0 if self.reached_s is None else now_s - self.reached_s
        return max(0.0, self._last.hold_s - held_s)

    def _verdict(
        self, plan: Plan, error: PoseError, speed_m_s: float, now_s: float, flying_since_s: float
    ) -> Verdict | None:
        order = self.order
        if self.canceled:
            rests = now_s >= plan.end_s and speed_m_s < REST_SPEED_M_S
            return Verdict("canceled", stays=True) if rests else None
        if order.timeout_s is not None and now_s - self.entry.accepted_s >= order.timeout_s:
            return Verdict("aborted", "timeout")
        if isinstance(order.goal, StreamGoal):
            heard_s = self.streamed.stamp_s if self.streamed else flying_since_s
            return Verdict("aborted", "stream_timeout") if now_s - heard_s > order.goal.timeout_s else None
        if self.ahead is None and self._reached(plan, error, speed_m_s, now_s):
            return Verdict("succeeded", stays=True)
        return None

    def _reached(self, plan: Plan, error: PoseError, speed_m_s: float, now_s: float) -> bool:
        goal, last = self.order.goal, self._last
        if self.reached_s is None:
            if not isinstance(goal, WaypointGoal) and now_s < plan.end_s:
                return False
            criterion = last.convergence if isinstance(last, WaypointGoal) else Tolerance()
            self.within_since_s, reached = converged(criterion, self.within_since_s, error, speed_m_s, now_s)
            if not reached:
                return False
            self.reached_s = now_s
        return self._hold_left_s(now_s) <= 0.0
