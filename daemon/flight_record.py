"""Ties the recorder to a vehicle: ticks, goals and plans go into the flight record as they happen."""

from typing import Any

from daemon.guidance.plan import Plan
from daemon.loops.goal_book import GoalEntry
from daemon.loops.trajectory_task import GoalOrder, Progress
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record
from daemon.recording.recorder import Recorder

PLAN_POINTS = 60


class FlightRecord:
    """A listener of the control task and of the trajectory task."""

    def __init__(self, vehicle: Vehicle, recorder: Recorder) -> None:
        self._vehicle = vehicle
        self._recorder = recorder
        self._order: GoalOrder | None = None
        self._plan: Plan | None = None
        vehicle.control.listeners.append(self.on_tick)
        vehicle.trajectory.listeners.append(self)

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """Hand over the tick; note a goal that is new, and a plan that is."""
        self._recorder.tick(self._vehicle.control.state, inputs, record)
        self._note_order()
        plan = self._vehicle.trajectory.plan.value
        if plan is not self._plan:
            self._plan = plan
            if plan is not None:
                self._recorder.plan(_payload(plan, self._vehicle.trajectory.goal_id))

    def goal_progress(self, progress: Progress) -> None:
        """See ``GoalListener``: the record has every tick already."""

    def goal_ended(self, entry: GoalEntry) -> None:
        """See ``GoalListener``."""
        self._note_order()
        result: dict[str, Any] = {
            "kind": entry.kind,
            "outcome": entry.outcome,
            "by": entry.by,
            "reason": entry.reason,
            "error_m": entry.error_m,
            "error_deg": entry.error_deg,
            "duration_s": entry.duration_s,
        }
        self._recorder.goal("ended", entry.goal_id, result)

    def _note_order(self) -> None:
        order, known = self._vehicle.trajectory.order, self._order
        if order is not known and order is not None:
            what = "updated" if known is not None and known.goal_id == order.goal_id else "submitted"
            self._recorder.goal(what, order.goal_id, {"kind": order.kind, "timeout_s": order.timeout_s})
        self._order = order or known


def _payload(plan: Plan, goal_id: str | None) -> dict[str, Any]:
    outline = plan.outline(PLAN_POINTS)
    return {
        "goal_id": goal_id,
        "spacing_s": outline[1].time_s - outline[0].time_s,
        "positions_ned_m": [list(reference.position_ned_m) for reference in outline],
    }
