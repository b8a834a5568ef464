"""Faults as data: each says what happens to a simulated PX4 when it begins and when it ends.

Everywhere a fault is a mapping: ``{fault: gps_loss, duration_s: 10}``. Faults that pass by themselves or cannot end
have no ``end``.
"""

from collections.abc import Callable
from dataclasses import fields
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
    "SpoiltTelemetry",
    "SteadyWind",
    "StoppedTelemetry",
    "WindGust",
    "checked",
    "from_mapping",
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


def from_mapping(data: dict[str, Any]) -> Fault:
    """A fault from its mapping. Raises ValueError that names the offending key."""
    name = data.get("fault")
    kind = FAULTS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise ValueError(f"fault: {name!r} is none of {', '.join(FAULTS)}")
    known = {f.name: f for f in fields(kind)}
    arguments: dict[str, Any] = {}
    for key, value in data.items():
        if key == "fault":
            continue
        if key not in known:
            raise ValueError(f"{name}.{key}: unknown; known: {', '.join(known)}")
        arguments[key] = checked(f"{name}.{key}", str(known[key].type), value, *_RANGES.get(key, ()))
    try:
        return kind(**arguments)
    except ValueError as error:
        raise ValueError(f"{name}.{error}") from error


def checked(path: str, annotation: str, value: Any, low: float = -inf, high: float = inf) -> Any:
    """The value as the type that an annotation names, within a range. Raises ValueError that names the path."""
    kind = _kind(annotation)
    known, cast = _KINDS[kind]
    if kind == "a list of words" and isinstance(value, str):
        value = [value]
    if not known(value):
        raise ValueError(f"{path}: {value!r} is not {kind}")
    if kind.endswith("number") and not low <= value <= high:
        raise ValueError(f"{path}: {value!r} is not in {low:g} to {high:g}")
    return cast(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


# what a value is called: whether it is one, and what it becomes
_KINDS: dict[str, tuple[Callable[[Any], bool], Callable[[Any], Any]]] = {
    "a list of words": (lambda v: isinstance(v, list) and all(isinstance(item, str) for item in v), tuple),
    "true or false": (lambda v: isinstance(v, bool), bool),
    "a word": (lambda v: isinstance(v, str), str),
    "a whole number": (lambda v: isinstance(v, int) and not isinstance(v, bool), int),
    "a number": (_is_number, float),
}


def _kind(annotation: str) -> str:
    words = {"tuple": "a list of words", "bool": "true or false", "str": "a word", "int": "a whole number"}
    return next((kind for word, kind in words.items() if word in annotation), "a number")
