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

from daemon.cli.common import Exit, PlainCommand, examples, fail, say, say_json

if TYPE_CHECKING:
    from daemon.sim.mavlink_server import MavlinkServer

_LAST_PORT = 65535

sim_app = typer.Typer(invoke_without_command=True, no_args_is_help=False, rich_markup_mode=None)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.add_typer(sim_app, name="sim", short_help="Simulate PX4 quadrotors.")


@sim_app.callback(
    epilog=examples(
        "flightd sim",
        "flightd sim --vehicles 3 --airframe x500 --port 15540",
        "flightd sim --fault 'gps_loss at_s=30 duration_s=10' --fault 'wind north_m_s=5 turbulence_m_s=1'",
        "flightd sim --scenario bad_day.yaml",
        "flightd sim fault gps_loss duration_s=10",
        exits="0 stopped, 2 refused",
    )
)
def sim(
    context: typer.Context,
    port: Annotated[
        int, typer.Option(metavar="PORT", help="UDP port of 127.0.0.1 that the vehicle sends to.", min=1, max=65535)
    ] = 14540,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of noise and faults.", min=0)] = 0,
    vehicles: Annotated[
        int, typer.Option(metavar="N", help="Vehicles; ports and system ids count up.", min=1, max=50)
    ] = 1,
    airframe: Annotated[str, typer.Option(metavar="NAME", help="Name (sih, x500) or path of a YAML file.")] = "sih",
    speed: Annotated[
        float, typer.Option(metavar="FACTOR", help="Simulated seconds a second.", min=0.01, max=50.0)
    ] = 1.0,
    control: Annotated[Path | None, typer.Option(metavar="PATH", help="Socket for `flightd sim fault`.")] = None,
    noise: Annotated[bool, typer.Option(help="Sensor and estimator noise as recorded from PX4.")] = True,
    scenario: Annotated[
        Path | None, typer.Option(metavar="FILE", help="YAML list of faults with at_s: docs/simulator.md.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FAULT",
            help="One fault: its name and key=value words; at_s and vehicle say when and whom. Repeatable.",
        ),
    ] = None,
) -> None:
    """Simulate PX4 quadrotors that speak MAVLink over UDP on this machine, until Ctrl-C.

    In another terminal: flightd run --config sim. Faults come from a scenario file, from --fault, or while it runs
    from `flightd sim fault`; `flightd sim fault list` names them.
    """
    if context.invoked_subcommand is not None:
        return
    from daemon.sim import scenario as scenarios
    from daemon.sim.airframe_files import load
    from daemon.sim.fault_requests import fault_requests
    from daemon.sim.mavlink_server import MavlinkServer
    from daemon.sim.px4 import SimulatedPx4

    if port + vehicles - 1 > _LAST_PORT:
        fail(Exit.REFUSED, f"--port {port}: {vehicles} vehicles need ports up to {port + vehicles - 1}", False)
    try:
        frame = load(airframe)
        fleet = [
            SimulatedPx4(airframe=frame, seed=seed + index, system_id=1 + index, noise=noise)
            for index in range(vehicles)
        ]
        planned = scenarios.load(scenario) if scenario is not None else ()
        scenarios.schedule(fleet, [*planned, *(scenarios.from_option(text) for text in fault or [])])
    except ValueError as error:
        fail(Exit.REFUSED, str(error), False)
    path = control or control_path(port)
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        fail(Exit.REFUSED, f"--control {path}: {error.strerror}", False)
    for index in range(vehicles):
        say(f"simulated PX4 {1 + index} sends to udp 127.0.0.1:{port + index}")
    server = MavlinkServer(fleet, port=port, speed=speed, control_path=path, on_request=fault_requests(fleet))
    try:
        asyncio.run(_until_stopped(server))
    except OSError as error:  # a second simulator, or no socket to be had
        fail(Exit.REFUSED, error.strerror or f"--control {path}: {error}", False)
    say(_summary(server))


def _summary(server: "MavlinkServer") -> str:
    return (
        f"{server.steps} steps of 4 ms; {server.late_steps} late (at most {server.latest_s * 1e3:.0f} ms) and made up "
        f"for, {server.lost_steps} lost"
    )


def control_path(port: int) -> Path:
    """Where the simulator that sends to a port takes faults."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or f"/tmp/flightd-{os.getuid()}"
    return Path(folder) / f"flightd-sim-{port}.sock"


@sim_app.command(
    name="fault",
    cls=PlainCommand,
    short_help="Make something fail now.",
    epilog=examples(
        "flightd sim fault list",
        "flightd sim fault gps_loss duration_s=10",
        "flightd sim fault link direction=down loss=0.2 jitter_s=0.05 --vehicle 2",
        "flightd sim fault clear fault=gps_loss",
        "flightd sim fault clear",
        exits="0 done, 2 refused, 5 no simulator",
    ),
)
def run_time_fault(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of a fault, or `list`, or `clear`.")],
    settings: Annotated[
        list[str] | None, typer.Argument(metavar="KEY=VALUE...", help="Its settings, as key=value.")
    ] = None,
    port: Annotated[int, typer.Option(metavar="PORT", help="Port of the simulator.")] = 14540,
    vehicle: Annotated[int | None, typer.Option(metavar="N", help="System id; all vehicles without it.")] = None,
    control: Annotated[
        Path | None, typer.Option(metavar="PATH", readable=False, help="The simulator's control socket.")
    ] = None,
) -> None:
    """Make something fail in a running simulator now, or name the faults that there are and those at work.

    The answer is JSON. The faults and their settings are in docs/simulator.md.
    """
    from daemon.sim.scenario import settings_of

    try:
        values = settings_of(settings or [])
    except ValueError as error:
        fail(Exit.REFUSED, str(error), False)
    request: dict[str, Any] = {"list": True}
    if name == "clear":
        request = {"clear": values.pop("fault", None)}
    elif name != "list":
        request, values = {"inject": values | {"fault": name}}, {}
    if values:
        fail(Exit.REFUSED, f"{name} has no {', '.join(values)}", False)
    if vehicle is not None:
        request["vehicle"] = vehicle
    answer = _asked(control or control_path(port), request)
    if "error" in answer:
        fail(Exit.REFUSED, answer["error"], False)
    say_json(answer)


def _asked(path: Path, request: dict[str, Any]) -> dict[str, Any]:
    try:
        with socket.socket(socket.AF_UNIX) as channel:
            channel.connect(str(path))
            channel.sendall(json.dumps(request).encode() + b"\n")
            answer: dict[str, Any] = json.loads(channel.makefile().readline())
    except OSError as error:
        fail(Exit.NO_DAEMON, f"no simulator listens at {path}: {error.strerror}; start one with `flightd sim`", False)
    return answer


async def _until_stopped(server: "MavlinkServer") -> None:
    loop = asyncio.get_running_loop()
    task = asyncio.ensure_future(server.run())
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
