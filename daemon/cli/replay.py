"""`flightd replay`: a flight record through the flow again."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Column, Table

from daemon import config, parameters
from daemon.cli.common import Exit, JsonOption, PlainCommand, fail, say, say_json
from daemon.cli.report import RECORDS
from daemon.config import ConfigError
from daemon.pipeline import Parameters
from daemon.recording.codec import RecordError
from daemon.recording.files import in_order
from daemon.recording.replay import Comparison, compare
from daemon.settings import Config

SHOWN = 25
EPILOG = "Exit codes: 0 identical (or compared with --config), 1 different, 2 cannot be replayed."


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="replay", cls=PlainCommand, short_help="Fly a record through the flow again.", epilog=EPILOG)(
        replay
    )


def replay(
    records: Annotated[list[Path], typer.Argument(metavar="FLIGHT.mcap...", help=RECORDS)],
    configs: Annotated[
        list[Path] | None,
        typer.Option(
            "--config", metavar="FILE", help="Fly with this configuration instead; may be given several times."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Feed a flight's inputs through the flow again and compare what comes out, to the last bit.

    The inputs are those that were flown: with --config it shows what the flow would have answered to them.
    """
    try:
        changed = config.load(configs) if configs else None
        found = compare(in_order(records), None if changed is None else lambda recorded: _with(recorded, changed))
    except (RecordError, ConfigError) as error:
        fail(Exit.REFUSED, str(error), as_json)
    if as_json:
        say_json({"identical": found.identical, **asdict(found)})
    else:
        _show(found)
    raise typer.Exit(Exit.SUCCEEDED if found.identical or configs else Exit.ABORTED)


def _with(recorded: Parameters, changed: Config) -> Parameters:
    """The parameters of another configuration, about the recorded fence and with the hover thrust that was known."""
    made = parameters.pipeline_parameters(changed, recorded.bounds.fence, recorded.control.hover_thrust)
    return replace(made, fence_shift=recorded.fence_shift)


def _show(found: Comparison) -> None:
    skipped = f" ({found.skipped} more had no beginning to replay from)" if found.skipped else ""
    if found.identical:
        say(f"identical to the last bit: {found.ticks} ticks{skipped}")
        return
    say(f"{len(found.differences) or 'no'} fields differ in {found.ticks} ticks{skipped}")
    if found.unknown:
        say(f"fields that only one side has: {', '.join(found.unknown)}")
    if not found.differences:
        return
    made = Table(Column("field", overflow="fold"), "ticks", "first at, s", "largest difference")
    for difference in sorted(found.differences, key=lambda d: -d.ticks)[:SHOWN]:
        made.add_row(difference.field, f"{difference.ticks}", f"{difference.first_s:.2f}", f"{difference.largest:.3g}")
    Console().print(made)
