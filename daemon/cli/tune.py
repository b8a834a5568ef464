"""`flightd tune`: measures a hovering vehicle by small pulses and writes the gains that follow."""

import asyncio
import tempfile
from contextlib import AsyncExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daemon.cli.common import (
    Exit,
    JsonOption,
    examples,
    fail,
    missing,
    needs,
    note,
    on_interrupt,
    say,
    say_json,
    writable,
)
from daemon.cli.daemon_commands import ConfigFiles
from daemon.cli.demo_children import Child, ChildError, free_udp_port

if TYPE_CHECKING:
    from daemon.settings import Config
    from daemon.tuning.experiment import Recording
    from daemon.tuning.measurement import Measured
    from daemon.tuning.proposal import Proposal

_TAKEOFF_M = 5.0


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        name="tune",
        short_help="Measure hover thrust and lags.",
        epilog=examples(
            "flightd tune --simulate --airframe x500",
            "flightd tune --connection udpin://0.0.0.0:14540 --airframe mine --out tuned",
            exits="0 measured, 1 stopped in flight, 2 refused, or the data is too poor, 130 interrupted",
        ),
    )(tune)


def tune(
    connection: Annotated[
        str | None, typer.Option(metavar="URL", help="MAVSDK's URL of the autopilot; no other daemon may have it.")
    ] = None,
    airframe: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="What the files are called; with --simulate what is flown: sih, x500 or a YAML file."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the YAML file and the picture.")] = Path(
        "tuned"
    ),
    simulate: Annotated[bool, typer.Option("--simulate", help="Start `flightd sim` and measure that.")] = False,
    takeoff: Annotated[
        bool, typer.Option("--takeoff", help=f"Take off to {_TAKEOFF_M:g} m if it is on the ground, and land after.")
    ] = False,
    config: ConfigFiles = None,
    as_json: JsonOption = False,
) -> None:
    """Measure hover thrust and the lags of rates and thrust on a hovering vehicle, and propose gains.

    Calm air and 5 m of room on every side are needed, and the vehicle in Hold. While the control law holds the place,
    pulses of 35 deg/s on each axis and of 15 % of thrust are flown for a minute. They end at once when the vehicle is
    2 m off, tilts by 20 deg, or when anybody else takes it.
    """
    from daemon import logs
    from daemon.autopilot.port import LinkError
    from daemon.config import ConfigError, load
    from daemon.endpoint import EndpointInUseError
    from daemon.loops.turns import NotPossibleError
    from daemon.sim import airframe_files
    from daemon.tuning.experiment import StoppedError
    from daemon.tuning.measurement import PoorDataError, measure
    from daemon.tuning.proposal import propose

    logs.configure("error")
    if simulate and connection is not None:
        fail(Exit.REFUSED, "--simulate has a connection of its own", as_json)
    if simulate:
        needs("pymavlink")
    try:
        loaded = load(config or [], {} if connection is None else {"link": {"connection": connection}})
        name = Path(airframe or ("sih" if simulate else "airframe")).stem
        takeoff_m = _TAKEOFF_M if takeoff or simulate else None
        simulated = airframe or "sih" if simulate else None
        if simulated is not None:
            airframe_files.load(simulated)
        writable(out, as_json)  # before anything flies
        measured = measure(asyncio.run(_flown(loaded, simulated, takeoff_m)))
        proposal = propose(measured, loaded)
        files = _write(out, name, measured, proposal, config or [])
    except PoorDataError as error:
        fail(
            Exit.REFUSED,
            "the data is too poor for a proposal:\n" + "\n".join(error.faults),
            as_json,
            faults=error.faults,
        )
    except (ConfigError, ValueError, NotPossibleError, EndpointInUseError) as error:
        fail(Exit.REFUSED, str(error), as_json)
    except (StoppedError, LinkError, ChildError, OSError) as error:
        fail(Exit.ABORTED, str(error), as_json)
    except (asyncio.CancelledError, KeyboardInterrupt):
        fail(Exit.INTERRUPTED, "interrupted; if it was engaged, the vehicle was handed back to Hold", as_json)
    from daemon.tuning import result

    if as_json:
        say_json(result.as_dict(measured, proposal) | {"files": [str(file) for file in files]})
    else:
        for line in [*result.lines(measured, proposal), *(f"written   {file}" for file in files)]:
            say(line)


async def _flown(config: "Config", simulated: str | None, takeoff_m: float | None) -> "Recording":
    """The measuring flight, on a simulator of its own if asked for; Ctrl-C ends it and hands the vehicle back."""
    from daemon.tuning.live import record

    connection = config.link.connection
    children: list[asyncio.Task[None]] = []
    async with AsyncExitStack() as stack:
        if simulated is not None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="flightd-")))
            port = free_udp_port()
            connection = f"udpin://127.0.0.1:{port}"
            arguments = ["sim", "--port", str(port), "--airframe", simulated, "--control", str(folder / "sim.sock")]
            simulator = await Child.start("the simulated PX4", arguments, folder / "sim.log")
            stack.push_async_callback(simulator.stop)
            children.append(asyncio.create_task(simulator.ended()))
            stack.callback(children[0].cancel)
        flight = asyncio.create_task(record(connection, config, takeoff_m=takeoff_m, tell=note))
        on_interrupt(flight.cancel)
        await asyncio.wait({flight, *children}, return_when=asyncio.FIRST_COMPLETED)
        if not flight.done():
            flight.cancel()
            await asyncio.gather(flight, return_exceptions=True)
            children[0].result()
        return flight.result()


def _write(out: Path, name: str, measured: "Measured", proposal: "Proposal", configs: list[Path]) -> list[Path]:
    """The YAML file, loaded once to see that it can be, and the picture where there is matplotlib."""
    from daemon.config import load
    from daemon.tuning.proposal import as_yaml

    settings = out / f"{name}.yaml"
    settings.write_text(as_yaml(proposal, name))
    load([*configs, settings])
    try:
        from daemon.tuning.picture import picture
    except ModuleNotFoundError as error:
        note(f"no picture: {missing(error)}")
        return [settings]
    drawn = out / f"{name}.png"
    drawn.write_bytes(picture(measured, proposal, name))
    return [settings, drawn]
