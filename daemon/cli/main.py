"""The command `flightd`."""

import typer

from daemon.cli import daemon_commands, goals, sim, vehicle

app = typer.Typer(
    name="flightd",
    help="Flight control for PX4 drones: waypoint goals in, attitude-rate setpoints out.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

daemon_commands.register(app)
vehicle.register(app)
goals.register(app)
sim.register(app)


def main() -> None:
    """Run the command line."""
    app()


if __name__ == "__main__":
    main()
