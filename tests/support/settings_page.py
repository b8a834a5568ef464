"""docs/settings.md, from the settings themselves: `PYTHONPATH=tests python -m support.settings_page` writes it anew."""

import re
from collections.abc import Iterator
from inspect import getdoc
from itertools import groupby
from json import dumps
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from daemon.config import default_path, describe, load, value_at
from daemon.parameters import geofence, pipeline_parameters
from daemon.settings import Config

PAGE = Path(__file__).parents[2] / "docs" / "settings.md"
_LINE = re.compile(r"( *)(\w+):(?:.*?# (.*))?")
_HEAD = """# Settings

`config/default.yaml` holds every key. Write what differs into a file of your own: with the service
`/etc/flightd/flightd.yaml`, else any file that `--config` names; files stack, the last one wins.
`flightd check-config FILE` checks without starting. Of several numbers each is within the range.

*In flight*: `flightd config set KEY VALUE` changes it until the daemon restarts; all others need a restart.

This page is written by `PYTHONPATH=tests python -m support.settings_page`.
"""
_COLUMNS = ["| key | default | range | in flight | |", "|---|---|---|---|---|"]
_LASTING = {
    "estimator.position_variance_max_m2": None,
    "safety.attitude_disagreement_deg": "attitude_disagreement_for_s",
    "safety.tilt_max_deg": "tilt_for_s",
    "safety.speed_max_m_s": "speed_for_s",
    "safety.battery_min_pct": "battery_for_s",
}


def meanings() -> dict[str, str]:
    """What each key's comment in the default file says, by dotted path."""
    found: dict[str, str] = {}
    sections: list[str] = []
    for match in filter(None, map(_LINE.match, default_path().read_text().splitlines())):
        indent, key, comment = match.groups()
        path = [*sections[: len(indent) // 2], key]
        if comment is None:
            sections = path
        else:
            found[".".join(path)] = comment
    return found


def page() -> str:
    """The whole page."""
    told = meanings()
    parts = [_HEAD.rstrip()]
    for section, paths in groupby(told, lambda path: path.rpartition(".")[0]):
        parts.append("\n".join([f"## {section}\n", *_COLUMNS, *(_row(path, told[path]) for path in paths)]))
    rules = "\n".join(f"- {rule}" for rule in _rules(Config))
    return "\n\n".join([*parts, f"## Keys that bind each other\n\n{rules}", _lasting()]) + "\n"


def _row(path: str, meaning: str) -> str:
    setting, value = describe(path), value_at(load([]), path)
    unit, _, rest = meaning.partition(", ")
    if unit in ("-", setting["unit"]):  # the range has it
        meaning = rest
    default = "empty" if value in ("", []) else f"`{value}`" if isinstance(value, str) else f"`{dumps(value)}`"
    in_flight = "yes" if setting["settable"] else ""
    return f"| `{path.rpartition('.')[2]}` | {default} | {_range(path, setting)} | {in_flight} | {meaning} |"


def _range(path: str, setting: dict[str, Any]) -> str:
    if setting["min"] is not None:
        return f"{setting['min']:.9g} to {setting['max']:.9g} {setting['unit'] or ''}".strip()
    model: Any = Config
    for name in path.split("."):
        model = getattr(model, "annotation", model).model_fields[name]
    if get_origin(model.annotation) is Literal:
        return ", ".join(get_args(model.annotation))
    return "true, false" if model.annotation is bool else ""


def _rules(model: type[BaseModel]) -> Iterator[str]:
    """The docstrings of the validators that look at several keys, the inner sections first."""
    for field in model.model_fields.values():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _rules(field.annotation)
    for validator in model.__pydantic_decorators__.model_validators.values():
        yield " ".join((getdoc(validator.func) or "").split())


def _lasting() -> str:
    config = load([])
    bounds = pipeline_parameters(config, geofence(config, (0.0, 0.0, 0.0))).bounds
    rows = []
    for path, name in _LASTING.items():
        rows.append(f"| `{path}` | {f'{getattr(bounds, name):g} s' if name else 'at once'} |")
    return "\n".join(
        [
            "## How long a bound has to be exceeded\n",
            "A bound acts when it was exceeded without a break for this long, and until the value is back below",
            f"{100.0 * bounds.hysteresis:g} % of it (of the battery: until it is not).",
            "What happens then: [safety.md](safety.md).\n",
            "| bound | for |",
            "|---|---|",
            *rows,
            f"| the samples differ from their prediction (no key) | {bounds.innovation_for_s:g} s |",
        ]
    )


if __name__ == "__main__":
    PAGE.write_text(page())
