"""Figures of a flight: what the report, the demo and the replay's comparison are made of.

Arrays have one row a tick; what was not there in a tick is NaN. Times in seconds from the first tick.
"""

from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np

from daemon import frames
from daemon.recording.flight import Flight, Table
from daemon.safety import supervisor

Array = np.ndarray[Any, np.dtype[np.float64]]
KINDS = ("waypoint", "path", "trajectory", "stream")
OURS = frozenset(state.value for state in supervisor.OURS)


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Quantities over the ticks: positions and velocities NED, angles in degrees, rates in deg/s, the rest SI."""

    time_s: Array
    position_m: Array
    velocity_m_s: Array
    reference_m: Array
    error_m: Array
    yaw_error_deg: Array
    rpy_deg: Array
    desired_rpy_deg: Array
    tilt_deg: Array
    rates_deg_s: Array
    rate_setpoint_deg_s: Array
    thrust: Array
    hover_thrust: Array
    disturbance_m_s2: Array
    age_ms: Array
    period_ms: Array
    states: list[str]

    @property
    def distance_m(self) -> Array:
        """Length of the position error."""
        return np.asarray(np.linalg.norm(self.error_m, axis=1))

    @property
    def tracking(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Ticks in which the control law flew."""
        return np.isfinite(self.distance_m)


@dataclass(frozen=True, slots=True)
class GoalSummary:
    """One goal: when, how it ended, and the largest errors and tilt while it was flown; None where unknown."""

    goal_id: str
    kind: str
    begin_s: float
    end_s: float | None
    outcome: str | None
    reason: str | None
    final_error_m: float | None
    final_error_deg: float | None
    largest_error_m: float | None
    largest_tilt_deg: float | None
    target_ned_m: tuple[float, float, float] | None


def traces(flight: Flight) -> Traces:
    """All traces of a flight."""
    t = flight.ticks
    setpoint = t["has_setpoint"] & t["has_control"]
    attitude = _column(t, "estimate_newest", "attitude_wb")
    predicted = _column(t, "predicted", "attitude_wb")
    rpy = _rpy_deg(attitude)
    desired = _rpy_deg(_column(t, "control", "desired_wb"))
    reference_yaw = np.degrees(_column(t, "reference", "yaw_rad"))
    return Traces(
        time_s=t["now_s"] - t["now_s"][0],
        position_m=_column(t, "estimate_newest", "position_ned_m"),
        velocity_m_s=_column(t, "estimate_newest", "velocity_ned_m_s"),
        reference_m=_column(t, "reference", "position_ned_m"),
        error_m=_where(setpoint, t["control_position_error_ned_m"]),
        yaw_error_deg=_where(setpoint, _wrap_deg(_rpy_deg(predicted)[:, 2] - reference_yaw)),
        rpy_deg=rpy,
        desired_rpy_deg=desired,
        tilt_deg=np.array([degrees(frames.tilt_of(tuple(q))) for q in attitude]),
        rates_deg_s=np.degrees(_column(t, "estimate_newest", "rates_frd_rad_s")),
        rate_setpoint_deg_s=np.degrees(_column(t, "setpoint", "rates_frd_rad_s")),
        thrust=_column(t, "setpoint", "thrust"),
        hover_thrust=_column(t, "control", "hover_thrust"),
        disturbance_m_s2=_column(t, "control", "disturbance_ned_m_s2"),
        age_ms=np.where(np.isfinite(t["estimate_age_s"]), t["estimate_age_s"], np.nan) * 1e3,
        period_ms=t["dt_s"] * 1e3,
        states=t.names("supervision_state"),
    )


def goals(flight: Flight, found: Traces) -> list[GoalSummary]:
    """The goals of a flight in the order of their submission."""
    zero_s = float(flight.ticks["now_s"][0])
    ended = {note["goal_id"]: note for note in flight.goals if note["what"] == "ended"}
    plans = {note["goal_id"]: note for note in flight.plans}
    summaries = []
    for note in flight.goals:
        if note["what"] != "submitted":
            continue
        end = ended.get(note["goal_id"], {})
        begin_s, end_s = note["time_s"] - zero_s, end["time_s"] - zero_s if end else None
        during = found.tracking & (found.time_s >= begin_s) & (found.time_s <= (end_s or np.inf))
        path = plans.get(note["goal_id"], {}).get("positions_ned_m")
        summaries.append(
            GoalSummary(
                goal_id=note["goal_id"],
                kind=next((kind for kind in KINDS if kind in note), ""),
                begin_s=begin_s,
                end_s=end_s,
                outcome=end.get("outcome"),
                reason=end.get("reason"),
                final_error_m=end.get("error_m"),
                final_error_deg=end.get("error_deg"),
                largest_error_m=_largest(found.distance_m[during]),
                largest_tilt_deg=_largest(found.tilt_deg[during]),
                target_ned_m=tuple(path[-1]) if path else None,
            )
        )
    return summaries


def spans(time_s: Array, names: list[str]) -> list[tuple[float, float, str]]:
    """Begin, end and name of each stretch of equal names."""
    found: list[tuple[float, float, str]] = []
    begin = 0
    for i in range(1, len(names) + 1):
        if i == len(names) or names[i] != names[begin]:
            found.append((float(time_s[begin]), float(time_s[min(i, len(names) - 1)]), names[begin]))
            begin = i
    return found


def summary(flight: Flight, found: Traces, ended: list[GoalSummary]) -> list[str]:
    """The flight in sentences. Raises ``RecordError``."""
    ours = found.period_ms[[state in OURS for state in found.states]].sum() / 1e3
    moved = np.nansum(np.linalg.norm(np.diff(found.position_m, axis=0), axis=1))
    speed = _largest(np.linalg.norm(found.velocity_m_s, axis=1)) or 0.0
    lines = [
        f"The record covers {found.time_s[-1]:.1f} s, {ours:.1f} s of them under the daemon's control; "
        f"the vehicle moved {moved:.1f} m at up to {speed:.1f} m/s and tilted up to "
        f"{_largest(found.tilt_deg) or 0.0:.0f}°."
    ]
    if ended:
        outcomes = [goal.outcome or "active" for goal in ended]
        counted = ", ".join(f"{outcomes.count(name)} {name}" for name in dict.fromkeys(outcomes))
        lines.append(f"{len(ended)} goal{'s' if len(ended) > 1 else ''}: {counted}.")
    if found.tracking.any():
        error = found.distance_m[found.tracking]
        yaw = np.abs(found.yaw_error_deg[found.tracking])
        lines.append(
            f"It kept to its reference within {error.max():.2f} m (RMS {np.sqrt((error**2).mean()):.3f} m) "
            f"and {np.nanmax(yaw):.1f}° of heading (RMS {np.sqrt(np.nanmean(yaw**2)):.2f}°)."
        )
        hover = found.hover_thrust[found.tracking]
        wind = np.linalg.norm(found.disturbance_m_s2[found.tracking], axis=1)
        lines.append(
            f"Hover thrust was estimated at {hover[-1]:.3f} (from {hover[0]:.3f}); the unknown acceleration (wind, "
            f"payload) was {wind.mean():.2f} m/s² on average and {wind.max():.2f} m/s² at most."
        )
    lines.append(_timing(found, 1e3 / flight.control_rate_hz))
    resets = int(flight.ticks["has_estimate_reset"].sum())
    refused = sum(bool(reason) for reason in flight.ticks.text("estimate_refused"))
    lines.append(
        f"{resets or 'No'} reset{'' if resets == 1 else 's'} of the autopilot's estimate, "
        f"{refused or 'no'} refused sample{'' if refused == 1 else 's'}."
    )
    return lines


def _timing(found: Traces, period_ms: float) -> str:
    p50, p99 = np.percentile(found.period_ms, (50, 99))
    missed = int(np.maximum(0.0, np.round(found.period_ms / period_ms) - 1).sum())
    text = (
        f"The control period was {p50:.2f} ms (p99 {p99:.2f} ms, longest {found.period_ms.max():.1f} ms), "
        f"{missed or 'no'} tick{'' if missed == 1 else 's'} missed"
    )
    ages = found.age_ms[np.isfinite(found.age_ms)]
    if not len(ages):
        return f"{text}; there was no state."
    a50, a99 = np.percentile(ages, (50, 99))
    return f"{text}; the state was {a50:.1f} ms old in the median (p99 {a99:.1f} ms)."


def _column(table: Table, group: str, name: str) -> Array:
    return _where(table[f"has_{group}"], table[f"{group}_{name}"])


def _where(present: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> Array:
    return np.asarray(np.where(present[:, None] if values.ndim > 1 else present, values, np.nan))


def _rpy_deg(attitude: Array) -> Array:
    return np.asarray(
        np.degrees(np.array([frames.to_rpy((q[0], q[1], q[2], q[3])) for q in attitude.tolist()]).reshape(-1, 3))
    )


def _wrap_deg(angle: Array) -> Array:
    return np.asarray((angle + 180.0) % 360.0 - 180.0)


def _largest(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else None
