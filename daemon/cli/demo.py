"""`flightd demo`: a whole flight against the simulated PX4, from start to report, in under a minute."""

import asyncio
import tempfile
from collections.abc import Coroutine
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.table import Table

from daemon.cli import demo_flight
from daemon.cli.common import Exit, JsonOption, fail, needs, say, say_json, writable
from daemon.cli.demo_children import Child, ChildError, free_udp_port
from daemon.cli.demo_flight import Row, Tell
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError, NoDaemonError
from daemon.goals.goal import Result
from daemon.recording import analysis, flight
from daemon.recording.codec import RecordError
from daemon.recording.files import in_order

START_TRIES, START_RETRY_S = 150, 0.1
WHOLE_S = 180.0


class DemoError(Exception):
    """The demo could not be flown; the text says why."""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="demo", short_help="Fly three goals in simulation.")(demo)


def demo(
    as_json: JsonOption = False,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the report, the record and the logs.")] = Path(
        "flight-report"
    ),
    px4: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="Fly the PX4 at this MAVSDK URL, such as udpin://0.0.0.0:14540, not a simulated one."
        ),
    ] = None,
) -> None:
    """Fly three goals against the simulated PX4: the second preempts the first, the third turns; then report.

    Exit code 0 only if each goal ended as it should: the first preempted, the others reached within 0.3 m and 5 deg.
    """
    needs("matplotlib", *(["pymavlink"] if px4 is None else []))
    writable(out, as_json)
    try:
        results, records = asyncio.run(_fly(out.resolve(), px4))
        rows = _evaluate(results, records, out)
    except (DemoError, ChildError, FlightError, RecordError) as error:
        fail(Exit.ABORTED, f"demo: {error}", as_json)
    except OSError as error:
        fail(Exit.ABORTED, f"demo: {error.strerror or error} (what it writes is in {out})", as_json)
    except KeyboardInterrupt:
        fail(Exit.INTERRUPTED, "demo: interrupted; both processes were stopped", as_json)
    good = all(row.good for row in rows)
    if as_json:
        report = {"report": str(out / "report.html"), "picture": str(out / "flight.png"), "record": str(records[0])}
        say_json({"good": good, "goals": [row.as_dict() for row in rows], **report})
    else:
        _show(rows)
        say(f"report   {out / 'report.html'}\npicture  {out / 'flight.png'}\nrecord   {records[0]}")
    raise typer.Exit(Exit.SUCCEEDED if good else Exit.ABORTED)


async def _fly(out: Path, px4: str | None) -> tuple[list[Result], list[Path]]:
    """Start both processes, fly, stop both; returns the results and the files of the flight's record."""
    records = out / "records"
    with tempfile.TemporaryDirectory(prefix="flightd-") as folder, Console(stderr=True).status("starting") as status:
        before = set(records.glob("*.mcap"))

        def tell(text: str, done: bool) -> None:
            status.update(text)
            if done:
                status.console.print(f"[green]✓[/green] {text}", highlight=False)

        try:
            async with asyncio.timeout(WHOLE_S), AsyncExitStack() as stack:
                socket = Path(folder) / "flightd.sock"
                children = await _start(stack, out, records, socket, px4)
                results = await _unless_ended(_session(socket, tell), children)
                tell("stopping", False)
        except TimeoutError:
            raise DemoError(f"took too long: {status.status}; logs are in {out}") from None
    files = in_order(list(set(records.glob("*.mcap")) - before))
    if not files:
        raise DemoError(f"the daemon wrote no flight record into {records}")
    return results, files


async def _start(stack: AsyncExitStack, out: Path, records: Path, socket: Path, px4: str | None) -> list[Child]:
    """The simulated PX4 first and stopped last, then the daemon."""
    children = []
    url = px4
    if url is None:
        port = free_udp_port()
        url = f"udpin://127.0.0.1:{port}"
        children.append(await Child.start("the simulated PX4", ["sim", "--port", str(port)], out / "sim.log"))
        stack.push_async_callback(children[-1].stop)
    overrides = socket.with_name("demo.yaml")
    overrides.write_text(yaml.safe_dump({"recording": {"directory": str(records)}}))
    airframe = "sim" if px4 is None else "sitl"
    arguments = ["run", "--config", airframe, "--config", str(overrides), "--connection", url, "--socket", str(socket)]
    children.append(await Child.start("the daemon", arguments, out / "daemon.log"))
    stack.push_async_callback(children[-1].stop)
    return children


async def _session(socket: Path, tell: Tell) -> list[Result]:
    """Connect as soon as the socket is there, and fly."""
    async with AsyncExitStack() as stack:
        for _ in range(START_TRIES):
            with suppress(NoDaemonError):
                client = await stack.enter_async_context(FlightClient(socket, reconnect_s=0.0))
                break
            await asyncio.sleep(START_RETRY_S)
        else:
            raise DemoError(f"the daemon does not listen on {socket}")
        tell("daemon started", True)
        return await demo_flight.fly(client, tell)


async def _unless_ended(session: Coroutine[Any, Any, list[Result]], children: list[Child]) -> list[Result]:
    """The session's results, unless a process ends before."""
    flown = asyncio.ensure_future(session)
    watched = [asyncio.ensure_future(child.ended()) for child in children]
    try:
        await asyncio.wait({flown, *watched}, return_when=asyncio.FIRST_COMPLETED)
        for ended in watched:
            if ended.done():
                ended.result()
        return await flown
    finally:
        for task in (flown, *watched):
            task.cancel()
        await asyncio.gather(flown, *watched, return_exceptions=True)


def _evaluate(results: list[Result], records: list[Path], out: Path) -> list[Row]:
    """The table, and the report beside it."""
    from daemon.recording.report import write_report

    found = flight.load(records)
    rows = demo_flight.table(results, analysis.goals(found, analysis.traces(found)))
    write_report(records, out)
    return rows


def _show(rows: list[Row]) -> None:
    made = Table("goal", "outcome", "time", "final error", "largest error", "largest tilt", title="Flight")
    for row in rows:
        colour = "green" if row.good else "red"
        made.add_row(
            row.goal,
            f"[{colour}]{row.outcome}[/{colour}]",
            _number(row.duration_s, " s", 1),
            _final_error(row),
            _number(row.largest_error_m, " m", 2),
            _number(row.largest_tilt_deg, "°", 0),
        )
    Console().print(made)


def _final_error(row: Row) -> str:
    """A goal that another one preempted was not to arrive."""
    if row.expected == "preempted":
        return "–"
    return f"{_number(row.final_error_m, ' m', 2)}, {_number(row.final_error_deg, '°', 1)}"


def _number(value: float | None, unit: str, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}{unit}"
