"""What became of each goal: the newest hundred, by id."""

from collections import OrderedDict
from dataclasses import dataclass

from daemon.goals.results import Outcome

KEPT = 100


@dataclass(slots=True)
class GoalEntry:
    """One accepted goal; ``outcome`` None while it is active. Errors at its end in metres and degrees."""

    goal_id: str
    kind: str
    accepted_s: float
    outcome: Outcome | None = None
    by: str | None = None
    reason: str | None = None
    error_m: float | None = None
    error_deg: float | None = None
    duration_s: float | None = None


class GoalBook:
    """Keeps entries; an ended goal does not change any more."""

    def __init__(self) -> None:
        self._entries: OrderedDict[str, GoalEntry] = OrderedDict()

    def open(self, goal_id: str, kind: str, now_s: float) -> GoalEntry:
        """Enter a goal that was accepted."""
        entry = GoalEntry(goal_id, kind, now_s)
        self._entries[goal_id] = entry
        while len(self._entries) > KEPT:
            self._entries.popitem(last=False)
        return entry

    def find(self, goal_id: str) -> GoalEntry | None:
        """The entry, or None when the goal is unknown or forgotten."""
        return self._entries.get(goal_id)
