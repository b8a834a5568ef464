"""Commands that start the daemon or check its configuration."""

from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.common import Exit, JsonOption, PlainCommand, examples, fail, say, say_json

ConfigFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="YAML file over the defaults, or the name of one that comes with flightd: sim, sitl, x500. Repeatable.",
    ),
]


RUN_EXITS = "0 stopped, 1 failed, 2 the configuration is bad, 3 another daemon has the socket or the connection"


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(
        name="run", short_help="Run the daemon.", epilog=examples("flightd run --config sitl", exits=RUN_EXITS)
    )(run)
    app.command(
        name="check-config",
        cls=PlainCommand,
        short_help="Check configuration files.",
        epilog=examples("flightd check-config /etc/flightd/flightd.yaml", exits="0 they can be used, 2 they cannot"),
    )(check_config)


def run(
    config: ConfigFiles = None,
    connection: Annotated[
        str | None, typer.Option(metavar="URL", help="MAVSDK's URL of the autopilot, such as udpin://127.0.0.1:14540.")
    ] = None,
    socket: Annotated[
        Path | None, typer.Option(metavar="PATH", readable=False, help="Path of the goal socket.")
    ] = None,
) -> None:
    """Run the daemon until SIGTERM or Ctrl-C; it waits for an autopilot and takes goals on its socket."""
    from daemon import app

    raise typer.Exit(app.run(config or [], connection, socket))


def check_config(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FILE...", help="YAML files, or names of those that come with flightd, stacked over the defaults."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check configuration files without starting anything."""
    from daemon.config import ConfigError, load

    try:
        config = load(files or [])
    except ConfigError as error:
        fail(Exit.REFUSED, str(error), as_json, faults=error.faults)
    if as_json:
        say_json({"hash": config.hash()})
    else:
        say(f"configuration is good (hash {config.hash()})")
