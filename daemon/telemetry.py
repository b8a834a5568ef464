"""What subscribers and the log hear: telemetry at their rates, and events as they happen."""

from math import degrees
from typing import Any

from daemon import logs
from daemon.frames import norm
from daemon.goals.hub import Hub
from daemon.goals.results import ResetReport
from daemon.guidance.goals import Goal, PolynomialGoal
from daemon.guidance.plan import Plan
from daemon.guidance.polynomial import candidates
from daemon.journal import Journal
from daemon.loops.vehicle import Vehicle
from daemon.messages import Vec3
from daemon.pipeline import Inputs, Record
from daemon.reports import Reports
from daemon.safety.reasons import ESTIMATE_EVENTS, REASONS
from daemon.safety.supervisor import State

PLAN_POINTS = 100
CANDIDATE_POINTS = 16

log = logs.get("vehicle")


class Telemetry:
    """A watcher of the control task. Each topic is made only when somebody is due to get it."""

    def __init__(self, vehicle: Vehicle, reports: Reports, hub: Hub, journal: Journal) -> None:
        self._vehicle = vehicle
        self._reports = reports
        self._hub = hub
        self._journal = journal
        self._state: State | None = None
        self._refused: str | None = None
        self._plan: Plan | None = None
        self._drawn: dict[str, Any] = {}
        vehicle.control.watchers.add("telemetry", self.on_tick)

    def on_tick(self, _inputs: Inputs, record: Record) -> None:
        """Publish what is wanted of this tick."""
        self._events(record)
        hub = self._hub
        if hub.wants("state"):
            self._publish_state(record)
        if hub.wants("reference") and record.reference is not None:
            self._publish_reference(record)
        if hub.wants("setpoint") and record.setpoint is not None:
            setpoint = record.setpoint
            hub.publish(
                "setpoint",
                {"time_s": record.now_s, "rates_frd_rad_s": list(setpoint.rates_frd_rad_s), "thrust": setpoint.thrust},
            )
        if hub.wants("loops"):
            hub.publish("loops", self._reports.loops())
        if hub.wants("health"):
            self._publish_health(record)
        self._publish_plan(record)

    def _publish_state(self, record: Record) -> None:
        report = self._reports.vehicle()
        if report is not None:
            self._hub.publish("state", {"time_s": record.now_s, "state": record.supervision.state.value, **report})

    def _publish_reference(self, record: Record) -> None:
        reference = record.reference
        assert reference is not None
        self._hub.publish(
            "reference",
            {
                "time_s": reference.time_s,
                "goal_id": self._vehicle.trajectory.goal_id,
                "position_ned_m": list(reference.position_ned_m),
                "velocity_ned_m_s": list(reference.velocity_ned_m_s),
                "acceleration_ned_m_s2": list(reference.acceleration_ned_m_s2),
                "jerk_ned_m_s3": list(reference.jerk_ned_m_s3),
                "yaw_deg": degrees(reference.yaw_rad),
                "yaw_rate_deg_s": degrees(reference.yaw_rate_rad_s),
            },
        )

    def _publish_health(self, record: Record) -> None:
        self._hub.publish(
            "health",
            {
                "time_s": record.now_s,
                "state": record.supervision.state.value,
                "reasons": self._reports.reasons(record.supervision.reason),
                "autopilot": self._reports.autopilot(),
                "counters": self._reports.counters(),
            },
        )

    def _publish_plan(self, record: Record) -> None:
        """A plan is drawn once, when it is new; it goes out then, and as often as somebody wants it."""
        trajectory = self._vehicle.trajectory
        plan, before = trajectory.plan.value, self._plan
        self._plan = plan
        if plan is None or (plan is before and not self._hub.wants("plan")):
            return
        if plan is not before:
            drawn = _drawn(plan, trajectory.order.goal if trajectory.order else None)
            self._drawn = {"goal_id": trajectory.goal_id, **drawn}
        self._journal.plan({"time_s": record.now_s, **self._drawn})

    def _events(self, record: Record) -> None:
        supervision = record.supervision
        if supervision.state is not self._state:
            self._state = supervision.state
            text = REASONS.get(supervision.reason, supervision.reason)
            log.info("state", state=supervision.state.value, reason=supervision.reason)
            self._journal.event(f"state.{supervision.state.value}", text)
        for mode in record.modes:
            log.info("mode_asked", mode=mode.value)
        if record.estimate.refused != self._refused and record.estimate.refused is not None:
            log.warning("telemetry_refused", reason=record.estimate.refused)
        self._refused = record.estimate.refused
        for event in record.estimate.events:
            reset = event.reset
            if reset is None:
                log.warning(event.name, cause=event.cause)
                self._journal.event(event.name, ESTIMATE_EVENTS[event.name])
                continue
            kinds = sorted(reset.kinds)
            text = (
                f"{', '.join(kinds) or 'nothing'}: position {_m(reset.position_ned_m)} m, "
                f"velocity {_m(reset.velocity_ned_m_s)} m/s, heading {degrees(reset.yaw_rad):.1f} deg"
            )
            log.warning(event.name, kinds=kinds, cause=event.cause, text=text)
            report: ResetReport = {
                "kinds": kinds,
                "position_ned_m": list(reset.position_ned_m),
                "velocity_ned_m_s": list(reset.velocity_ned_m_s),
                "yaw_deg": degrees(reset.yaw_rad),
                "counter_steps": event.counter_steps,
                "truth_returned": reset.truth_returned,
            }
            self._journal.event(event.name, text, reset=report)


def _drawn(plan: Plan, goal: Goal | None) -> dict[str, Any]:
    """The path, and the primitives that a polynomial's was chosen from (while it, not a brake, is flown)."""
    outline = plan.outline(PLAN_POINTS)
    start = outline[0]
    chosen_from: list[list[list[float]]] = []
    if isinstance(goal, PolynomialGoal) and start.jerk_ned_m_s3 == goal.jerk_ned_m_s3:
        primitives = candidates(start, norm(goal.jerk_ned_m_s3), goal.duration_s)
        chosen_from = [[list(r.position_ned_m) for r in one.outline(CANDIDATE_POINTS)] for one in primitives]
    return {
        "start_s": start.time_s,
        "spacing_s": outline[1].time_s - start.time_s if len(outline) > 1 else 0.0,
        "positions_ned_m": [list(reference.position_ned_m) for reference in outline],
        "candidates_ned_m": chosen_from,
    }


def _m(v: Vec3) -> str:
    return f"({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f})"
