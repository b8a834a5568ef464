"""What is told of the vehicle, the goal and the loops: the protocol's shapes, made from the tasks' cells."""

import asyncio
from math import degrees, isfinite

from daemon.estimation import estimator
from daemon.goals import results
from daemon.loops.goal_book import GoalEntry
from daemon.loops.goal_order import Progress
from daemon.loops.grid import GridReport
from daemon.loops.vehicle import Vehicle
from daemon.safety.reasons import REASONS
from daemon.safety.supervisor import State


class Reports:
    """Reads the vehicle's cells; changes nothing."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def status(self) -> results.Status:
        """Result of status.get."""
        record = self._vehicle.control.record.value
        state = record.supervision.state if record else State.DISCONNECTED
        return {
            "state": state.value,
            "reasons": self.reasons(record.supervision.reason if record else "start"),
            "autopilot": self.autopilot(),
            "vehicle": self.vehicle(),
            "goal": self.goal(),
            "loops": self.loops(),
            "counters": self.counters(),
        }

    def reasons(self, reason: str) -> list[results.Reason]:
        """The supervisor's reason, then what the health task warns of."""
        said: list[results.Reason] = [{"code": reason, "text": REASONS.get(reason, reason.replace("_", " "))}]
        return said + [{"code": name, "text": text} for name, text in self._vehicle.health.warnings.items()]

    def autopilot(self) -> results.AutopilotReport:
        """What the autopilot says of itself."""
        status = self._vehicle.autopilot.status.value
        battery, clock = status.battery_fraction, self._vehicle.autopilot.clock.value
        return {
            "connected": status.connected,
            "mode": status.mode.value,
            "intended_mode": status.intended_mode.value,
            "armed": status.armed,
            "landed": status.landed.name.lower(),
            "battery_pct": None if battery is None else round(100.0 * battery, 1),
            "round_trip_ms": None if clock is None else round(1e3 * clock.round_trip_s, 1),
        }

    def vehicle(self) -> results.VehicleReport | None:
        """The estimate, or None."""
        record = self._vehicle.control.record.value
        if record is None or record.estimate.newest is None:
            return None
        newest = record.estimate.newest
        variance = newest.position_variance_m2
        return {
            "position_ned_m": list(newest.position_ned_m),
            "velocity_ned_m_s": list(newest.velocity_ned_m_s),
            "attitude_wb": list(newest.attitude_wb),
            "rates_frd_rad_s": list(newest.rates_frd_rad_s),
            "age_s": round(asyncio.get_running_loop().time() - newest.time_s, 4),
            "covariance_m2": variance if isfinite(variance) else None,
        }

    def loops(self) -> results.LoopReports:
        """Statistics of both tasks and of the garbage collector."""
        garbage = self._vehicle.garbage.report
        return {
            "control": _loop_report(self._vehicle.control.grid.statistics.report()),
            "trajectory": _loop_report(self._vehicle.trajectory.grid.statistics.report()),
            "garbage": {"collections": garbage.collections, "longest_ms": round(1e3 * garbage.longest_s, 3)},
        }

    def counters(self) -> results.Counters:
        """Resets and refused inputs."""
        now_s = asyncio.get_running_loop().time()
        record = self._vehicle.control.record.value
        refused = estimator.refusals(
            self._vehicle.control.state.estimator, now_s, parameters=self._vehicle.parameters.value.estimator
        )
        return {
            "resets": record.estimate.shift.count if record else 0,
            "refused": {name: round(count) for name, count in refused.items() if count >= 0.5},
        }

    def goal(self) -> results.GoalProgress | None:
        """How far the active goal is, or None; nothing is known of one that waits for the vehicle to be engaged."""
        progress, order = self._vehicle.trajectory.progress, self._vehicle.trajectory.order
        if progress is not None:
            return {"kind": progress.kind, **goal_feedback(progress)}
        if order is None:
            return None
        return {
            "goal_id": order.goal_id,
            "kind": order.kind,
            "distance_m": None,
            "angle_deg": None,
            "progress": 0.0,
            "eta_s": None,
        }


def goal_feedback(progress: Progress) -> results.GoalFeedback:
    """Payload of goal.feedback."""
    return {
        "goal_id": progress.goal_id,
        "distance_m": round(progress.distance_m, 4),
        "angle_deg": round(degrees(progress.angle_rad), 3),
        "progress": round(progress.progress, 4),
        "eta_s": round(progress.eta_s, 2) if isfinite(progress.eta_s) else None,
    }


def goal_record(entry: GoalEntry) -> results.GoalRecord:
    """Result of goal.get and payload of goal.result."""
    return {
        "goal_id": entry.goal_id,
        "state": "active" if entry.outcome is None else "done",
        "outcome": entry.outcome,
        "by": entry.by,
        "reason": entry.reason,
        "error_m": entry.error_m,
        "error_deg": entry.error_deg,
        "duration_s": entry.duration_s,
    }


def _loop_report(report: GridReport) -> results.LoopReport:
    return {
        "rate_hz": round(report.rate_hz, 2),
        "period_p99_ms": round(1e3 * report.period_p99_s, 3),
        "late": report.late,
        "missed": report.missed,
    }
