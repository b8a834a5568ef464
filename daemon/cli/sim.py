"""`flightd sim`: a simulated PX4 quadrotor in a process of its own."""

import asyncio
import contextlib
import signal
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from daemon.sim.mavlink_server import MavlinkServer

sim_app = typer.Typer(invoke_without_command=True, no_args_is_help=False)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.add_typer(sim_app, name="sim")


@sim_app.callback()
def sim(
    context: typer.Context,
    port: Annotated[
        int, typer.Option(help="UDP port of 127.0.0.1 that the vehicle sends to.", min=1, max=65535)
    ] = 14540,
    seed: Annotated[int, typer.Option(help="Seed of noise and faults.")] = 0,
    vehicles: Annotated[int, typer.Option(help="Vehicles; ports and system ids count up.", min=1, max=50)] = 1,
    airframe: Annotated[str, typer.Option(help="Name (sih, x500) or path of a YAML file.")] = "sih",
    speed: Annotated[float, typer.Option(help="Simulated seconds a second.", min=0.01, max=50.0)] = 1.0,
    noise: Annotated[bool, typer.Option(help="Sensor and estimator noise as recorded from PX4.")] = True,
) -> None:
    """Simulate a PX4 quadrotor that speaks MAVLink over UDP on this machine, until Ctrl-C.

    Example: flightd sim & flightd run --connection udpin://127.0.0.1:14540
    """
    if context.invoked_subcommand is not None:
        return
    try:
        from daemon.sim.airframe_files import load
        from daemon.sim.mavlink_server import MavlinkServer
    except ModuleNotFoundError as error:
        typer.echo(f"the simulator needs {error.name}: pip install 'flightd[sim]'", err=True)
        raise typer.Exit(2) from None
    from daemon.sim.px4 import SimulatedPx4

    try:
        frame = load(airframe)
    except ValueError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2) from None
    fleet = [
        SimulatedPx4(airframe=frame, seed=seed + index, system_id=1 + index, noise=noise) for index in range(vehicles)
    ]
    for index in range(vehicles):
        typer.echo(f"simulated PX4 {1 + index} sends to udp 127.0.0.1:{port + index}")
    asyncio.run(_until_stopped(MavlinkServer(fleet, port=port, speed=speed)))


async def _until_stopped(server: "MavlinkServer") -> None:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(server.run())
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
