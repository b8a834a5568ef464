"""`flightd protocol`: the goal protocol for machines."""

import json
from typing import Annotated

import typer

from daemon.cli.common import examples, say


def protocol(
    schemas: Annotated[bool, typer.Option("--schemas", help="JSON Schemas of all messages instead.")] = False,
) -> None:
    """Print the OpenRPC document of the goal socket."""
    from daemon.goals import openrpc

    say(json.dumps(openrpc.schema_document() if schemas else openrpc.document(), indent=1))


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(epilog=examples("flightd protocol > openrpc.json", "flightd protocol --schemas"))(protocol)
