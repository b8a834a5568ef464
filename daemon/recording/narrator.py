"""Events that only the record tells, from the ticks: the autopilot's mode, arming, landing, refusals, late ticks.

What subscribers hear as well (the daemon's state, resets) comes to the record the way it comes to them.
"""

from dataclasses import dataclass, replace
from typing import Any

from daemon.recording.topics import Step


@dataclass(frozen=True, slots=True)
class Told:
    """What was told last, so that only changes are told."""

    mode: str = ""
    armed: bool | None = None
    landed: str = ""
    refused: str = ""
    missed: bool = False


def tell(told: Told, step: Step, period_s: float) -> tuple[Told, list[dict[str, Any]]]:
    """The events of a step after what was told before it."""
    record, status = step.record, step.inputs.status
    now = replace(
        told,
        mode=status.mode.value,
        armed=status.armed,
        landed=status.landed.name.lower(),
        refused=record.estimate.refused or "",
        missed=record.dt_s > 2.0 * period_s,
    )
    events: list[dict[str, Any]] = []

    def add(code: str, text: str, **more: Any) -> None:
        events.append({"time_s": record.now_s, "code": code, "text": text, "goal_id": None, "field": None, **more})

    if now.mode != told.mode:
        add("mode", f"autopilot mode {now.mode}")
    if now.armed != told.armed:
        add("armed" if now.armed else "disarmed", "armed" if now.armed else "disarmed")
    if now.landed != told.landed:
        add("landed_state", now.landed.replace("_", " "))
    if now.refused and now.refused != told.refused:
        add("refused", f"telemetry refused: {now.refused.replace('_', ' ')}", field=now.refused)
    if now.missed and not told.missed:
        add("late_tick", f"a tick came {record.dt_s * 1e3:.0f} ms after the one before")
    return now, events
