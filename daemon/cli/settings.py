"""`flightd config`: read and change settings of the running daemon."""

import json
from typing import Annotated

import typer

from daemon.cli.common import (
    ANSWER_EXITS,
    JsonOption,
    NumbersCommand,
    PlainCommand,
    SocketOption,
    ask,
    examples,
    run,
    say,
    say_json,
)
from daemon.cli.common import MINUS as HIDDEN_MINUS
from daemon.goals.results import Setting, SettingValue

PathArgument = Annotated[str, typer.Argument(metavar="PATH", help="Dotted path, such as guidance.limits.speed_m_s.")]


def get(path: PathArgument, as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Show a setting, its range and its unit."""
    _show(ask(lambda flight: flight.get_config(path), socket, as_json), as_json)


def change(
    path: PathArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="A number, true, false, a list of numbers, or a word.")],
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Change a gain or a limit, within its range, until the daemon restarts; docs/settings.md says which can be."""
    wanted = parse_value(value)
    _show(run(lambda flight: flight.set_config(path, wanted), socket, as_json), as_json)


def parse_value(text: str) -> SettingValue:
    """What a word of the command line means: JSON if it is, else the word itself."""
    plain = text.replace(HIDDEN_MINUS, "-")
    try:
        found = json.loads(plain)
    except ValueError:
        return plain
    return found if isinstance(found, bool | int | float | list) else plain


def _show(setting: Setting, as_json: bool) -> None:
    if as_json:
        say_json(dict(setting))
        return
    unit = f" {setting['unit']}" if setting["unit"] else ""
    bounds = ""
    if setting["min"] is not None or setting["max"] is not None:
        bounds = f" ({_bound(setting['min'])} to {_bound(setting['max'])}{unit})"
    fixed = "" if setting["settable"] else ", fixed while the daemon runs"
    say(f"{setting['path']} = {json.dumps(setting['value'])}{unit}{bounds}{fixed}")


def _bound(value: float | None) -> str:
    return "any" if value is None else f"{value:g}"


def register(app: typer.Typer) -> None:
    """Add the commands."""
    settings = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Read and change settings.")
    settings.command(
        cls=PlainCommand, epilog=examples("flightd config get guidance.limits.speed_m_s", exits=ANSWER_EXITS)
    )(get)
    set_examples = examples("flightd config set guidance.limits.speed_m_s 3", exits=ANSWER_EXITS)
    settings.command("set", short_help="Change a setting until the restart.", cls=NumbersCommand, epilog=set_examples)(
        change
    )
    app.add_typer(settings, name="config")
