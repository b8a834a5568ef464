"""What the commands share: options, exit codes, output, and running against the daemon."""

import asyncio
import json
import re
import signal
import sys
from collections.abc import Awaitable, Callable, Mapping
from enum import IntEnum
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from daemon.cli.output import colours
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import (
    ConnectionLostError,
    FlightError,
    NoDaemonError,
    NotPermittedError,
    RequestError,
    RequestTimedOutError,
    SocketNotPermittedError,
)
from daemon.goals.goal import Result

T = TypeVar("T")


class Exit(IntEnum):
    """Exit codes of the commands."""

    SUCCEEDED = 0
    ABORTED = 1
    REFUSED = 2
    PREEMPTED = 3
    CANCELED = 4
    NO_DAEMON = 5
    NOT_PERMITTED = 6
    INTERRUPTED = 130


OUTCOME_EXITS = {
    "succeeded": Exit.SUCCEEDED,
    "aborted": Exit.ABORTED,
    "preempted": Exit.PREEMPTED,
    "canceled": Exit.CANCELED,
}
EXIT_CODES_HELP = (
    "Exit codes: 0 succeeded, 1 aborted, 2 refused, 3 preempted, 4 canceled, 5 no daemon, 6 not permitted, "
    "130 interrupted."
)
MINUS = "\N{MINUS SIGN}"
NEGATIVE_NUMBER = re.compile(r"\A-(?=\.?\d)")


class NumbersCommand(TyperCommand):
    """A command that takes negative numbers as what they are, not as options: ``flightd goto 10 0 -5``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Hide the sign of negative numbers from the option parser; `number` reads it."""
        hidden = [NEGATIVE_NUMBER.sub(MINUS, arg, count=1) if _negative(arg) else arg for arg in args]
        try:
            return super().parse_args(ctx, hidden)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ")  # pydantic's, by which typer checks choices
            raise


def _negative(arg: str) -> bool:
    return NEGATIVE_NUMBER.match(arg) is not None


def number(text: str | float) -> float:
    """A number of the command line (or an option's default)."""
    plain = str(text).replace(MINUS, "-")
    try:
        value = float(plain)
    except ValueError:
        raise typer.BadParameter(f"{plain!r} is not a number") from None
    if not isfinite(value):
        raise typer.BadParameter(f"{plain!r} is not a finite number")
    return value


SocketOption = Annotated[
    Path | None,
    typer.Option(
        "--socket",
        metavar="PATH",
        readable=False,
        help="The daemon's socket (default: $FLIGHTD_SOCKET, else where it usually is).",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]


def examples(*lines: str) -> str:
    """Epilog of a help page."""
    return "Examples:\n\n" + "\n\n".join(lines) + "\n\n" + EXIT_CODES_HELP


def say(text: str) -> None:
    """Print to people."""
    typer.echo(text)


def say_json(value: Mapping[str, Any] | list[Any]) -> None:
    """Print to scripts, one object a line."""
    typer.echo(json.dumps(value))


def note(text: str) -> None:
    """Print beside the result: progress and advice go to stderr."""
    typer.echo(text, err=True)


def fail(exit_code: Exit, text: str, as_json: bool, **details: Any) -> NoReturn:
    """Print what went wrong and leave."""
    if as_json:
        say_json({"error": {"message": text, **details}})
    else:
        typer.secho(text, fg=typer.colors.RED if colours(sys.stderr) else None, err=True)
    raise typer.Exit(int(exit_code))


EXTRAS = {"pymavlink": "sim", "matplotlib": "report"}


def missing(error: ModuleNotFoundError) -> str | None:
    """What to install where a package of an extra is missing; None when the module is another one."""
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        return None
    return f"this needs {package}: in a clone of flightd, {sys.executable} -m pip install '.[{EXTRAS[package]}]'"


ADVICE = {
    "no autopilot": "no autopilot is connected: check the cable and `flightd doctor`",
    "engage": "the vehicle has to be in the air and in Hold: `flightd status` tells how it is",
    "pilot": "a pilot or the autopilot has the vehicle: put it in Hold, then `flightd engage`",
    "disconnected": "no autopilot is connected: check the cable and `flightd doctor`",
    "standby": "the vehicle is on the ground: `flightd takeoff 5` first",
}


def run(
    work: Callable[[FlightClient], Awaitable[T]], socket: Path | None, as_json: bool, reconnect_s: float = 0.0
) -> T:
    """Do work with a client; errors of the daemon become a sentence and an exit code."""

    async def session() -> T:
        async with FlightClient(socket, reconnect_s=reconnect_s) as flight:
            return await work(flight)

    try:
        return asyncio.run(session())
    except SocketNotPermittedError as error:
        fail(Exit.NOT_PERMITTED, str(error), as_json)
    except NoDaemonError as error:
        fail(Exit.NO_DAEMON, str(error), as_json)
    except NotPermittedError as error:
        fail(Exit.NOT_PERMITTED, str(error), as_json, code=int(error.code), field=error.field)
    except RequestTimedOutError as error:
        text = f"{error}; it may still take effect: `flightd status` tells"
        fail(Exit.ABORTED, text, as_json, code=int(error.code), field=error.field)
    except RequestError as error:
        fail(_refusal_exit(error), _with_advice(error), as_json, code=int(error.code), field=error.field)
    except ConnectionLostError as error:
        fail(Exit.NO_DAEMON, str(error), as_json)
    except FlightError as error:
        fail(Exit.ABORTED, str(error), as_json)
    except KeyboardInterrupt:
        fail(Exit.INTERRUPTED, "interrupted; what was asked for goes on (`flightd hold` ends it)", as_json)


def _refusal_exit(error: RequestError) -> Exit:
    return Exit.PREEMPTED if "superseded" in error.reason else Exit.REFUSED


def _with_advice(error: RequestError) -> str:
    text = str(error)
    advice = next((advice for word, advice in ADVICE.items() if word in error.reason.lower()), None)
    return f"{text}\n{advice}" if advice is not None else text


def exit_with(result: Result) -> NoReturn:
    """Leave with the exit code of a goal's outcome."""
    raise typer.Exit(int(OUTCOME_EXITS[result.outcome]))


def on_interrupt(action: Callable[[], object]) -> None:
    """Run ``action`` in the running loop at the first Ctrl-C or SIGTERM; the second is the usual one."""
    loop = asyncio.get_running_loop()

    def first() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)
        action()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, first)
