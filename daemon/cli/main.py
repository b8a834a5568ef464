"""The command `flightd`: what each command is called, and the module that has it."""

import sys
from importlib import import_module

import typer

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


def build(command: str | None) -> typer.Typer:
    """Make the application; for a known command only that command's module is imported, so that it starts fast."""
    app = typer.Typer(name="flightd", no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.callback(help=HELP, epilog=EPILOG)(_nothing)
    modules = [COMMANDS[command]] if command in COMMANDS else list(dict.fromkeys(COMMANDS.values()))
    for module in modules:
        import_module(f"daemon.cli.{module}").register(app)
    return app


def _nothing() -> None:
    """Without a command there is nothing to do."""


def main() -> None:
    """Run the command line."""
    build(sys.argv[1] if len(sys.argv) > 1 else None)(prog_name="flightd")


if __name__ == "__main__":
    main()
