"""`flightd sim`: a simulated PX4 quadrotor in a process of its own."""

import asyncio
import contextlib
import json
import os
import signal
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    control: Annotated[Path | None, typer.Option(help="Socket for `flightd sim fault`.")] = None,
    noise: Annotated[bool, typer.Option(help="Sensor and estimator noise as recorded from PX4.")] = True,
) -> None:
    """Simulate a PX4 quadrotor that speaks MAVLink over UDP on this machine, until Ctrl-C.

    Example: flightd sim, and in another terminal: flightd run --config sim
    """
    if context.invoked_subcommand is not None:
        return
    try:
        from daemon.sim.airframe_files import load
        from daemon.sim.mavlink_server import MavlinkServer
    except ModuleNotFoundError as error:
        typer.echo(f"the simulator needs {error.name}: pip install 'flightd[sim]'", err=True)
        raise typer.Exit(2) from None
    from daemon.sim.fault_requests import fault_requests
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
    path = control or control_path(port)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    server = MavlinkServer(fleet, port=port, speed=speed, control_path=path, on_request=fault_requests(fleet))
    asyncio.run(_until_stopped(server))


def control_path(port: int) -> Path:
    """Where the simulator that sends to a port takes faults."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or f"/tmp/flightd-{os.getuid()}"
    return Path(folder) / f"flightd-sim-{port}.sock"


@sim_app.command()
def fault(
    name: Annotated[str, typer.Argument(help="Name of a fault, or `list`, or `clear`.")],
    settings: Annotated[list[str] | None, typer.Argument(help="Its settings, as key=value.")] = None,
    port: Annotated[int, typer.Option(help="Port of the simulator.")] = 14540,
    vehicle: Annotated[int | None, typer.Option(help="System id; all vehicles without it.")] = None,
    control: Annotated[Path | None, typer.Option(help="The simulator's control socket.")] = None,
) -> None:
    """Make something fail in a running simulator.

    Examples: flightd sim fault gps_loss duration_s=10, flightd sim fault clear, flightd sim fault list
    """
    values = {key: _value(text) for key, _, text in (setting.partition("=") for setting in settings or [])}
    request: dict[str, Any] = {"list": True}
    if name == "clear":
        request = {"clear": values.get("fault")}
    elif name != "list":
        request = {"inject": {"fault": name, **values}}
    if vehicle is not None:
        request["vehicle"] = vehicle
    answer = _asked(control or control_path(port), request)
    typer.echo(json.dumps(answer), err="error" in answer)
    raise typer.Exit(2 if "error" in answer else 0)


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _asked(path: Path, request: dict[str, Any]) -> dict[str, Any]:
    try:
        with socket.socket(socket.AF_UNIX) as channel:
            channel.connect(str(path))
            channel.sendall(json.dumps(request).encode() + b"\n")
            answer: dict[str, Any] = json.loads(channel.makefile().readline())
    except OSError as error:
        typer.echo(f"no simulator listens at {path}: {error.strerror}; start one with `flightd sim`", err=True)
        raise typer.Exit(5) from None
    return answer


async def _until_stopped(server: "MavlinkServer") -> None:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(server.run())
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
