"""What goes into the trajectory task and what it tells: orders, progress, and who hears of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from daemon.guidance.goals import Goal, PathGoal, Through
from daemon.guidance.limits import MotionLimits
from daemon.loops.goal_book import GoalEntry
from daemon.messages import AutopilotStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalOrder:
    """A goal as the service hands it over.

    ``resolve`` makes it anew for an autopilot whose origin has moved; ``connection`` submitted it.
    """

    goal_id: str
    kind: str
    goal: Goal
    limits: MotionLimits
    timeout_s: float | None = None
    resolve: Callable[[AutopilotStatus], Goal] | None = None
    connection: int = 0

    @property
    def plans_long(self) -> bool:
        """Whether planning it takes longer than a tick of the task may."""
        return isinstance(self.goal, PathGoal) and self.goal.through is Through.FLY_BY


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the active goal is; angles in radians. ``eta_s``: the way that is left and the hold after it."""

    goal_id: str
    kind: str
    distance_m: float
    angle_rad: float
    progress: float
    eta_s: float


class GoalListener(Protocol):
    """Who is told what becomes of goals."""

    def goal_progress(self, progress: Progress) -> None:
        """At each tick of the task while a goal is active."""

    def goal_ended(self, entry: GoalEntry) -> None:
        """Exactly once for each goal."""
