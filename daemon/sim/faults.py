"""Faults as data: each says what happens to a simulated PX4 when it begins and when it ends.

In files and at run time a fault is a mapping: ``{fault: gps_loss, duration_s: 10}``; a scenario is a list of them with
``at_s`` (simulated seconds from the start). Faults that pass by themselves or cannot end have no ``end``.
"""

from dataclasses import dataclass, field, fields
from math import inf, isfinite
from typing import Any

from daemon.sim.fault import Fault
from daemon.sim.faults_link import (
    ClockStep,
    FrozenTelemetry,
    Link,
    NanTelemetry,
    NoAcks,
    Reboot,
    SpoiltTelemetry,
    StoppedTelemetry,
)
from daemon.sim.faults_vehicle import (
    ArmingRefused,
    BatteryLow,
    EkfReset,
    GpsLoss,
    KillSwitch,
    ModesRefused,
    MotorEfficiency,
    Payload,
    PilotTakesOver,
    SteadyWind,
    WindGust,
)

__all__ = [
    "FAULTS",
    "ArmingRefused",
    "BatteryLow",
    "ClockStep",
    "EkfReset",
    "Fault",
    "FrozenTelemetry",
    "GpsLoss",
    "KillSwitch",
    "Link",
    "ModesRefused",
    "MotorEfficiency",
    "NanTelemetry",
    "NoAcks",
    "Payload",
    "PilotTakesOver",
    "Reboot",
    "ScheduledFault",
    "SpoiltTelemetry",
    "SteadyWind",
    "StoppedTelemetry",
    "WindGust",
    "from_mapping",
    "scenario",
]

_RANGES = {
    "delay_s": (0.0, 60.0),
    "duration_s": (0.0, inf),
    "efficiency": (0.0, 1.5),
    "forward": (-1.0, 1.0),
    "fraction": (0.0, 1.0),
    "jitter_s": (0.0, 60.0),
    "loss": (0.0, 1.0),
    "mass_kg": (0.0, 100.0),
    "reordering": (0.0, 1.0),
    "right": (-1.0, 1.0),
    "throttle": (0.0, 1.0),
    "turbulence_m_s": (0.0, 50.0),
    "yaw": (-1.0, 1.0),
}

FAULTS: dict[str, type[Fault]] = {
    "arming_refused": ArmingRefused,
    "battery_low": BatteryLow,
    "clock_step": ClockStep,
    "ekf_reset": EkfReset,
    "frozen_telemetry": FrozenTelemetry,
    "gps_loss": GpsLoss,
    "gust": WindGust,
    "kill_switch": KillSwitch,
    "link": Link,
    "modes_refused": ModesRefused,
    "motor_efficiency": MotorEfficiency,
    "nan_telemetry": NanTelemetry,
    "no_acks": NoAcks,
    "payload": Payload,
    "pilot": PilotTakesOver,
    "reboot": Reboot,
    "stopped_telemetry": StoppedTelemetry,
    "wind": SteadyWind,
}


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault of a scenario, ``at_s`` simulated seconds after the start."""

    at_s: float
    fault: Fault = field(default_factory=Fault)


def from_mapping(data: dict[str, Any]) -> Fault:
    """A fault from its mapping. Raises ValueError that names the offending key."""
    name = data.get("fault")
    kind = FAULTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise ValueError(f"fault: {name!r} is none of {', '.join(FAULTS)}")
    known = {f.name: f for f in fields(kind)}
    arguments: dict[str, Any] = {}
    for key, value in data.items():
        if key in ("fault", "at_s"):
            continue
        if key not in known:
            raise ValueError(f"{name}.{key}: unknown; known: {', '.join(known)}")
        arguments[key] = _checked(f"{name}.{key}", str(known[key].type), value)
        low, high = _RANGES.get(key, (-inf, inf))
        if key in _RANGES and not low <= value <= high:
            raise ValueError(f"{name}.{key}: {value!r} is not in {low:g} to {high:g}")
    try:
        return kind(**arguments)
    except ValueError as error:
        raise ValueError(f"{name}.{error}") from error


def scenario(items: list[dict[str, Any]]) -> tuple[ScheduledFault, ...]:
    """A scenario in the order of time. Raises ValueError that names the offending item and key."""
    planned = []
    for index, item in enumerate(items):
        try:
            at_s = _checked("at_s", "float", item.get("at_s"))
            planned.append(ScheduledFault(at_s, from_mapping(item)))
        except ValueError as error:
            raise ValueError(f"[{index}].{error}") from error
    return tuple(sorted(planned, key=lambda entry: entry.at_s))


def _checked(path: str, annotation: str, value: Any) -> Any:
    """The value as the field's type, or ValueError."""
    if "tuple" in annotation:
        items = [value] if isinstance(value, str) else value
        if isinstance(items, list) and all(isinstance(item, str) for item in items):
            return tuple(items)
    elif "bool" in annotation:
        if isinstance(value, bool):
            return value
    elif "str" in annotation:
        if isinstance(value, str):
            return value
    elif "int" in annotation.split(" ") or annotation == "<class 'int'>":
        if isinstance(value, int) and not isinstance(value, bool):
            return value
    elif isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value):
        return float(value)
    raise ValueError(f"{path}: {value!r} is not of type {annotation}")
