"""The command `flightd`: what each command is called, and the module that has it."""

import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from daemon.cli.common import Exit, fail, missing, say

COMMANDS = {
    "status": "vehicle",
    "arm": "vehicle",
    "takeoff": "vehicle",
    "engage": "vehicle",
    "hold": "vehicle",
    "land": "vehicle",
    "return": "vehicle",
    "disarm": "vehicle",
    "goto": "goals",
    "path": "goals",
    "cancel": "goals",
    "fly": "shapes",
    "watch": "watch",
    "config": "settings",
    "doctor": "doctor",
    "protocol": "protocol",
    "run": "daemon_commands",
    "check-config": "daemon_commands",
    "sim": "sim",
    "demo": "demo",
    "bench": "bench",
    "tune": "tune",
    "report": "report",
    "replay": "replay",
}
HELP = """Flight control for PX4 drones: waypoint goals in, attitude-rate setpoints out."""
EPILOG = """Examples:

flightd demo

flightd run --connection udpin://0.0.0.0:14540

flightd takeoff 5

flightd goto 10 0 -5 --yaw 90

flightd land"""


class Commands(TyperGroup):
    """Says what to install where a command needs a package that was left out."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Exit(Exit.INTERRUPTED) from None
        except ModuleNotFoundError as error:
            if (text := missing(error)) is None:
                raise
            fail(Exit.REFUSED, text, "--json" in sys.argv)


def build(command: str | None) -> typer.Typer:
    """Make the application; for a known command only that command's module is imported, so that it starts fast."""
    app = typer.Typer(
        cls=Commands, name="flightd", no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None
    )
    app.callback(help=HELP, epilog=EPILOG)(_options)
    modules = [COMMANDS[command]] if command in COMMANDS else list(dict.fromkeys(COMMANDS.values()))
    for module in modules:
        import_module(f"daemon.cli.{module}").register(app)
    return app


def _version(wanted: bool) -> None:
    if wanted:
        from daemon.goals.dispatch import product_version

        say(f"flightd {product_version()}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """What may stand before a command."""
