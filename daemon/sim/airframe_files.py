"""Airframes from YAML files: those that come with the simulator by name, others by path."""

from pathlib import Path
from typing import Any

from daemon import yaml_text
from daemon.sim.airframe import Airframe, Battery, RateGains, Rotor

DIRECTORY = Path(__file__).parent / "airframes"


def names() -> list[str]:
    """The airframes that come with the simulator."""
    return sorted(path.stem for path in DIRECTORY.glob("*.yaml"))


def load(name_or_path: str | Path) -> Airframe:
    """An airframe by name (``sih``, ``x500``) or by the path of a YAML file. Raises ValueError naming what is wrong."""
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = DIRECTORY / f"{name_or_path}.yaml"
    if not path.is_file():
        raise ValueError(f"airframe {name_or_path}: no such airframe; known: {', '.join(names())}")
    try:
        return from_mapping(yaml_text.parsed(path.read_text(encoding="utf-8")))
    except (TypeError, KeyError, ValueError) as error:
        raise ValueError(f"airframe {path}: {error}") from error


def from_mapping(data: Any) -> Airframe:
    """An airframe from the mapping that a file holds. Raises TypeError, KeyError or ValueError."""
    if not isinstance(data, dict):
        raise ValueError("keys such as those of the airframes that come with flightd are expected")
    fields = {key: _tuple_of(value) for key, value in data.items()}
    fields["rotors"] = tuple(Rotor(**rotor) for rotor in data["rotors"])
    fields["rate_gains"] = RateGains(**{k: _tuple_of(v) for k, v in data["rate_gains"].items()})
    fields["battery"] = Battery(**data.get("battery", {}))
    airframe = Airframe(**fields)
    if not (airframe.mass_kg > 0.0 and airframe.rotor_max_thrust_n > 0.0 and min(airframe.inertia_kg_m2) > 0.0):
        raise ValueError("mass_kg, inertia_kg_m2 and rotor_max_thrust_n must be positive")
    if airframe.hover_thrust >= 1.0:
        raise ValueError("the rotors cannot carry mass_kg")
    return airframe


def _tuple_of(value: Any) -> Any:
    return (
        tuple(float(v) for v in value)
        if isinstance(value, list) and value and not isinstance(value[0], dict)
        else value
    )
