"""Configuration: YAML files stacked on the defaults, each value checked down to its range.

A bad key, type or range is refused with the key's path, the value and the allowed range; a refused file changes
nothing.
"""

import re
import reprlib
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from daemon import yaml_text
from daemon.settings import Config


class ConfigError(Exception):
    """The configuration cannot be used: one line a fault, each with file or path, value and what is allowed."""

    def __init__(self, faults: list[str]) -> None:
        self.faults = faults
        super().__init__("\n".join(faults))


def default_path() -> Path:
    """The file that holds every key: beside the checkout's package, or inside an installed one."""
    checkout = Path(__file__).resolve().parent.parent / "config" / "default.yaml"
    return checkout if checkout.exists() else Path(__file__).resolve().parent / "_data" / "config" / "default.yaml"


def load(files: list[Path], overrides: dict[str, Any] | None = None) -> Config:
    """The defaults, then each file over them, then the overrides (nested like the files). Raises ``ConfigError``.

    A bare name such as ``sim`` means the file that is shipped under it.
    """
    values: dict[str, Any] = {}
    for file in [default_path(), *files]:
        values = _stacked(values, _read(_shipped(file) or file))
    return validated(_stacked(values, overrides or {}))


def _shipped(file: Path) -> Path | None:
    """The shipped file of a bare name, or None."""
    if file.suffix or len(file.parts) != 1 or file.exists():
        return None
    shipped = default_path().with_name(f"{file.name}.yaml")
    return shipped if shipped.exists() else None


def _shipped_names(file: Path) -> str:
    """What a bare name that names nothing may have been meant to be."""
    names = sorted(path.stem for path in default_path().parent.glob("*.yaml") if path.stem != "default")
    return "" if file.suffix or len(file.parts) != 1 else f"; {', '.join(names)} come with flightd"


def validated(values: dict[str, Any]) -> Config:
    """The configuration of nested values. Raises ``ConfigError``."""
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise ConfigError([_sentence(fault) for fault in error.errors()]) from None


def _read(file: Path) -> dict[str, Any]:
    try:
        values = yaml_text.parsed(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigError([f"{file}: {error.strerror}{_shipped_names(file)}"]) from None
    except UnicodeDecodeError:
        raise ConfigError([f"{file}: not YAML: not all of it is UTF-8"]) from None
    except ValueError as error:
        raise ConfigError([f"{file}: {error}"]) from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError([f"{file}: holds {type(values).__name__}, not sections of keys"])
    return values


def _stacked(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    result = dict(below)
    for key, value in above.items():
        old = result.get(key)
        result[key] = _stacked(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return result


_WANTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "model_type": "a section of keys",
}


def _sentence(fault: Any) -> str:
    kind, value, context = fault["type"], fault.get("input"), fault.get("ctx") or {}
    path = ".".join(str(part) for part in fault["loc"]) or "configuration"
    if kind in ("extra_forbidden", "invalid_key"):
        return f"{path}: there is no such key{meant(path)}"
    if kind == "missing":
        return f"{path}: is missing"
    if kind == "too_long":
        return f"{path}: must have at most {context['max_length']} items, not {len(value)}"
    wanted = context["expected"] if kind == "literal_error" else _WANTED.get(kind)
    if wanted is not None:
        return f"{path}: must be {wanted}, not {_written(value)}{_yaml_hint(kind, value)}"
    return f"{path}: {unacceptable(fault) or fault['msg'][0].lower() + fault['msg'][1:]}"


def _written(value: Any) -> str:
    """A value as YAML has it."""
    if value is None:
        return "empty (leave out what does not differ)"
    return str(value).lower() if isinstance(value, bool) else reprlib.repr(value)


def _yaml_hint(kind: str, value: Any) -> str:
    """What YAML made of a word that was meant otherwise."""
    if kind == "literal_error" and isinstance(value, bool):
        return " (YAML reads a bare off or on so: write it in quotes)"
    power = re.fullmatch(r"([-+]?\d+)(\.\d*)?[eE]([-+]?\d+)", value) if isinstance(value, str) else None
    if kind != "float_type" or power is None:
        return ""
    return f" (YAML reads it as text: write {power[1]}{power[2] or '.0'}e{int(power[3]):+d})"


def unacceptable(fault: Any) -> str | None:
    """What is wrong with a value of the right type, from pydantic's words for it; None if its type is wrong."""
    if fault["type"] in ("greater_than_equal", "less_than_equal"):
        low, high, unit = _range(".".join(fault["loc"]))
        return f"{fault['input']:g} is not within {low:g} to {high:g} {unit}".rstrip()
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    return None


def _range(path: str) -> tuple[float, float, str]:
    setting = describe(path)
    return (
        float("-inf") if setting["min"] is None else setting["min"],
        float("inf") if setting["max"] is None else setting["max"],
        setting["unit"] or "",
    )


def describe(path: str) -> dict[str, Any]:
    """Range, unit and whether it may be set in flight, of the setting at a dotted path. Raises ``KeyError``."""
    model: type[BaseModel] = Config
    *sections, key = path.split(".")
    for name in sections:
        model = _section(model.model_fields[name]) or _no_section(path)
    field = model.model_fields[key]
    if _section(field) is not None:
        raise KeyError(path)
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    bounds = {name: getattr(m, name) for m in field.metadata for name in ("ge", "le") if hasattr(m, name)}
    return {
        "min": bounds.get("ge", extra.get("low")),
        "max": bounds.get("le", extra.get("high")),
        "unit": extra.get("unit"),
        "settable": bool(extra.get("settable", False)),
    }


def keys_of(path: str) -> list[str]:
    """Keys of the section at a dotted path; none when there is no such section."""
    model: type[BaseModel] = Config
    for name in path.split("."):
        section = _section(model.model_fields[name]) if name in model.model_fields else None
        if section is None:
            return []
        model = section
    return list(model.model_fields)


def meant(path: str) -> str:
    """What a dotted path that is no setting may have meant, as the end of a sentence; empty when none is like it."""
    above, _, name = path.rpartition(".")
    known = list(_paths(Config))
    if path in known:  # its dots are within one key
        return "; write its sections as sections, one below the other"
    siblings = [other.rpartition(".")[2] for other in known if other.rpartition(".")[0] == above]
    like = [f"{above}.{other}".lstrip(".") for other in get_close_matches(name, siblings, 1)]
    like = like or [other for other in known if other.rpartition(".")[2] == name]
    return f"; did you mean {' or '.join(like)}?" if like else ""


def _paths(model: type[BaseModel], above: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"{above}{name}"
        if (section := _section(field)) is not None:
            yield from _paths(section, f"{above}{name}.")


def _section(field: FieldInfo) -> type[BaseModel] | None:
    annotation = field.annotation
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def _no_section(path: str) -> NoReturn:
    raise KeyError(path)


def value_at(config: Config, path: str) -> Any:
    """The value at a dotted path, as the files write it. Raises ``KeyError``."""
    value: Any = config.model_dump(mode="json")
    for key in path.split("."):
        if not isinstance(value, dict):
            raise KeyError(path)
        value = value[key]
    if isinstance(value, dict):
        raise KeyError(path)
    return value


def with_value(config: Config, path: str, value: Any) -> Config:
    """The configuration with one value changed. Raises pydantic's ``ValidationError``."""
    change: Any = value
    for key in reversed(path.split(".")):
        change = {key: change}
    return Config.model_validate(_stacked(config.model_dump(mode="json"), change))
