"""`flightd report`: a flight record as one page."""

from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.common import Exit, JsonOption, PlainCommand, fail, not_written, say, say_json
from daemon.recording.codec import RecordError
from daemon.recording.files import in_order

RECORDS = "Flight record (.mcap); the parts of one flight in order."


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        name="report",
        cls=PlainCommand,
        short_help="Write a page about a flight.",
        epilog="Example:\n\nflightd report ~/.local/state/flightd/20261122T101500Z-part1.mcap",
    )(report)


def report(
    records: Annotated[list[Path], typer.Argument(metavar="FLIGHT.mcap...", help=RECORDS)],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the page and its pictures.")] = Path(
        "flight-report"
    ),
    as_json: JsonOption = False,
) -> None:
    """Write a page about a flight: summary, path, errors, attitude, rates, thrust, timing, goals, events."""
    from daemon.recording.report import write_report

    try:
        page = write_report(in_order(records), out)
    except RecordError as error:
        fail(Exit.REFUSED, str(error), as_json)
    except OSError as error:
        fail(Exit.REFUSED, not_written(error, out), as_json)
    if as_json:
        say_json({"report": str(page), "picture": str(out / "flight.png")})
    else:
        say(f"{page}")
