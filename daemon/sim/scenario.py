"""Scenarios: faults with the time at which each begins, from a YAML list or from words of a command line.

An entry is a fault's mapping with ``at_s`` (simulated seconds from the start; 0) and, among several vehicles,
``vehicle`` (system id; all of them): ``{at_s: 30, fault: gps_loss, duration_s: 10, vehicle: 2}``.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon import yaml_text
from daemon.sim.fault import Fault
from daemon.sim.faults import checked, from_mapping

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault that begins ``at_s`` simulated seconds after the start; ``vehicle`` None: on all."""

    at_s: float
    fault: Fault
    vehicle: int | None = None
    origin: str = field(default="", compare=False)  # where a person finds it


def scenario(entries: Any) -> tuple[ScheduledFault, ...]:
    """A scenario in the order of time. Raises ValueError that names the offending entry and key."""
    if not isinstance(entries, list):
        raise ValueError("a list of faults is expected")
    planned = []
    for index, entry in enumerate(entries):
        try:
            planned.append(replace(_scheduled(entry), origin=f"[{index}]."))
        except ValueError as error:
            raise ValueError(f"[{index}].{error}") from error
    return tuple(sorted(planned, key=lambda entry: entry.at_s))


def load(path: Path) -> tuple[ScheduledFault, ...]:
    """The scenario that a YAML file holds. Raises ValueError with the file and what is wrong with it."""
    try:
        planned = scenario(yaml_text.parsed(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ValueError(f"scenario {path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"scenario {path}: {error}") from error
    return tuple(replace(entry, origin=f"scenario {path}: {entry.origin}") for entry in planned)


def from_option(text: str) -> ScheduledFault:
    """``"gps_loss at_s=30 duration_s=10"`` as an entry. Raises ValueError with the text and the offending key."""
    name, *settings = text.split() or [""]
    try:
        return replace(_scheduled(settings_of(settings) | {"fault": name}), origin=f"--fault {text!r}: ")
    except ValueError as error:
        raise ValueError(f"--fault {text!r}: {error}") from error


def settings_of(words: Iterable[str]) -> dict[str, Any]:
    """``key=value`` words as a mapping; a value is JSON if it can be read so. Raises ValueError for another word."""
    settings = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not (key and equals):
            raise ValueError(f"{word!r}: key=value is expected")
        settings[key] = _value(value)
    return settings


def schedule(vehicles: "Sequence[SimulatedPx4]", planned: Sequence[ScheduledFault]) -> None:
    """Plan the faults on their vehicles. Raises ValueError when there is no such vehicle or one does not fit."""
    known = {px4.system_id for px4 in vehicles}
    for entry in planned:
        if entry.vehicle is not None and entry.vehicle not in known:
            there = f"there is only {min(known)}" if len(known) == 1 else f"there are {min(known)} to {max(known)}"
            raise ValueError(f"{entry.origin}vehicle: {entry.vehicle}; {there} (--vehicles)")
    for px4 in vehicles:
        px4.faults.schedule(entry for entry in planned if entry.vehicle in (None, px4.system_id))


def _scheduled(entry: Any) -> ScheduledFault:
    if not isinstance(entry, dict):
        raise ValueError(f"{entry!r}: a mapping with the key fault is expected")
    at_s = checked("at_s", "float", entry.get("at_s", 0.0), 0.0, inf)
    vehicle = checked("vehicle", "int", entry["vehicle"], 1, 255) if "vehicle" in entry else None
    fault = from_mapping({key: value for key, value in entry.items() if key not in ("at_s", "vehicle")})
    return ScheduledFault(at_s, fault, vehicle)


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
