"""What subscribers and the log hear: telemetry at their rates, and events as they happen."""

from math import degrees

from daemon import logs
from daemon.goals.hub import Hub
from daemon.guidance.plan import Plan
from daemon.journal import Journal
from daemon.loops.vehicle import Vehicle
from daemon.messages import Vec3
from daemon.pipeline import Inputs, Record
from daemon.reports import Reports
from daemon.safety.reasons import REASONS
from daemon.safety.supervisor import State

PLAN_POINTS = 100

log = logs.get("vehicle")


class Telemetry:
    """A listener of the control task. Each topic is made only when somebody is due to get it."""

    def __init__(self, vehicle: Vehicle, reports: Reports, hub: Hub, journal: Journal) -> None:
        self._vehicle = vehicle
        self._reports = reports
        self._hub = hub
        self._journal = journal
        self._state: State | None = None
        self._refused: str | None = None
        self._plan: Plan | None = None
        vehicle.control.listeners.append(self.on_tick)

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
        plan = self._vehicle.trajectory.plan.value
        if plan is not None and (plan is not self._plan or hub.wants("plan")):
            self._publish_plan(plan, record)
        self._plan = plan

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
        reason = record.supervision.reason
        reasons = [{"code": reason, "text": REASONS.get(reason, reason)}]
        reasons += [{"code": name, "text": text} for name, text in self._vehicle.health.warnings.items()]
        self._hub.publish(
            "health",
            {
                "time_s": record.now_s,
                "state": record.supervision.state.value,
                "reasons": reasons,
                "autopilot": self._reports.autopilot(),
                "counters": self._reports.counters(),
            },
        )

    def _publish_plan(self, plan: Plan, record: Record) -> None:
        outline = plan.outline(PLAN_POINTS)
        spacing_s = outline[1].time_s - outline[0].time_s if len(outline) > 1 else 0.0
        self._journal.plan(
            {
                "time_s": record.now_s,
                "goal_id": self._vehicle.trajectory.goal_id,
                "spacing_s": spacing_s,
                "positions_ned_m": [list(reference.position_ned_m) for reference in outline],
            },
        )

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
                self._journal.event(event.name, event.cause or event.name.replace("_", " "))
                continue
            kinds = sorted(reset.kinds)
            text = (
                f"{', '.join(kinds) or 'nothing'}: position {_m(reset.position_ned_m)} m, "
                f"velocity {_m(reset.velocity_ned_m_s)} m/s, heading {degrees(reset.yaw_rad):.1f} deg"
            )
            log.warning(event.name, kinds=kinds, cause=event.cause, text=text)
            self._journal.event(event.name, text)


def _m(v: Vec3) -> str:
    return f"({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f})"
