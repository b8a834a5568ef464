"""What the commands share: options, exit codes, output, and running against the daemon."""

import asyncio
import json
import re
import signal
import sys
import tempfile
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AsyncExitStack, suppress
from enum import IntEnum
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from types import MappingProxyType
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
    WrongStateError,
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
# Exit codes of the help pages.
_EVERYWHERE = "5 no daemon, or it does not answer, 6 not permitted, 130 interrupted"
ANSWER_EXITS = f"0 done, 2 refused, {_EVERYWHERE}"
REQUEST_EXITS = f"0 done, 1 timed out, 2 refused, 3 overtaken by a newer request, {_EVERYWHERE}"
GOAL_EXITS = f"0 succeeded, 1 aborted, 2 refused, 3 preempted, 4 canceled, {_EVERYWHERE}"
MINUS = "\N{MINUS SIGN}"
NEGATIVE_NUMBER = re.compile(r"\A-(?=\.?\d)")
TYPE = re.compile(r" <\S+>\Z")


class PlainCommand(TyperCommand):
    """A command whose help page shows its arguments as people type them."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """``N E D`` and ``[FILE...]``, whatever typer puts around them."""
        pieces = [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]
        return [re.sub(r"\}?\.\.\.(\]?)\}?\.\.\.$", r"...\1", piece) for piece in pieces]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Without the type that typer puts behind an argument's name."""
        write = formatter.write_dl
        formatter.write_dl = lambda rows, **more: write([(TYPE.sub("", name), text) for name, text in rows], **more)
        super().format_options(ctx, formatter)


class NumbersCommand(PlainCommand):
    """A command that takes negative numbers as what they are, not as options: ``flightd goto 10 0 -5``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Hide the sign of negative numbers from the option parser; `number` reads it."""
        hidden = [NEGATIVE_NUMBER.sub(MINUS, arg, count=1) if _negative(arg) else arg for arg in args]
        try:
            return super().parse_args(ctx, hidden)
        except typer.BadParameter as error:
            plain = error.message.replace(MINUS, "-")
            error.message = plain.removeprefix("Value error, ")  # pydantic's, by which typer checks choices
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


def examples(*lines: str, exits: str = "") -> str:
    """Epilog of a help page."""
    return "\n\n".join(["Examples:", *lines, *([f"Exit codes: {exits}."] if exits else [])])


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


def writable(folder: Path, as_json: bool = False) -> None:
    """Make a folder for what a command writes in the end; leave now where nothing can be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"something")
    except OSError as error:
        fail(Exit.REFUSED, not_written(error, folder), as_json)


def not_written(error: OSError, folder: Path) -> str:
    """What hindered writing into a folder, as a sentence."""
    return f"cannot write into {folder}: {error.strerror}"


def needs(*packages: str) -> None:
    """Leave now where a package that is used later, or by another process, is not there."""
    for package in packages:
        if find_spec(package) is None:
            raise ModuleNotFoundError(name=package)


EXTRAS = {"pymavlink": "sim", "matplotlib": "report"}


def missing(error: ModuleNotFoundError) -> str | None:
    """What to install where a package of an extra is missing; None when the module is another one."""
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        return None
    return f"this needs {package}: in a clone of flightd, {sys.executable} -m pip install '.[{EXTRAS[package]}]'"


class SilentDaemonError(NoDaemonError):
    """A daemon is there and does not answer."""


ANSWER_S = 5.0
GOES_ON = "interrupted; what was asked for goes on (`flightd hold` ends it)"

# What to do next where a request was not possible in a state of the daemon's.
UNCONNECTED = {"disconnected": "check the cable, or that the simulator runs; `flightd doctor` tells more"}
UNENGAGED = UNCONNECTED | {
    "standby": "`flightd takeoff 5` takes off",
    "ready": "to be taken the vehicle has to be in the air and in Hold; `flightd hold` asks for Hold",
    "pilot": "`flightd engage` takes the vehicle when it is in Hold",
    "fault": "`flightd engage` takes the vehicle when it is in Hold",
}


def run(
    work: Callable[[FlightClient], Awaitable[T]],
    socket: Path | None,
    as_json: bool,
    reconnect_s: float = 0.0,
    next_steps: Mapping[str, str] = MappingProxyType({}),
    interrupted: Callable[[], str] = lambda: GOES_ON,
) -> T:
    """Do work with a client; errors of the daemon become a sentence and an exit code.

    ``next_steps``: what to do, by the daemon's state, when the work is not possible in it. ``interrupted``: what to say
    after a Ctrl-C.
    """

    async def session() -> T:
        async with AsyncExitStack() as stack:
            flight = await connected(stack, socket, reconnect_s)
            listening = asyncio.create_task(_tell_of_silence(flight))
            stack.callback(listening.cancel)
            try:
                return await work(flight)
            except WrongStateError as error:
                step = await _next_step(flight, {} if superseded(error) else next_steps)
                raise WrongStateError(error.code, f"{error}{step}", error.field, error.reason) from None

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
        code = Exit.PREEMPTED if superseded(error) else Exit.REFUSED
        fail(code, str(error), as_json, code=int(error.code), field=error.field)
    except ConnectionLostError as error:
        fail(Exit.NO_DAEMON, str(error), as_json)
    except FlightError as error:
        fail(Exit.ABORTED, str(error), as_json)
    except KeyboardInterrupt:
        fail(Exit.INTERRUPTED, interrupted(), as_json)


async def connected(stack: AsyncExitStack, socket: Path | None, reconnect_s: float) -> FlightClient:
    """A client that is connected until the stack ends. Raises ``FlightError``."""
    flight = FlightClient(socket, reconnect_s=reconnect_s)
    return await answered(stack.enter_async_context(flight), flight)


async def answered(question: Awaitable[T], flight: FlightClient) -> T:
    """What the daemon answers to a question that it answers at once. Raises ``SilentDaemonError``."""
    try:
        return await asyncio.wait_for(question, ANSWER_S)
    except TimeoutError:
        hint = "it is stopped or overloaded; its log and `systemctl status flightd` tell more"
        raise SilentDaemonError(f"the daemon at {flight.socket_path} does not answer: {hint}") from None


def ask(
    question: Callable[[FlightClient], Awaitable[T]], socket: Path | None, as_json: bool, reconnect_s: float = 0.0
) -> T:
    """The answer to a question that the daemon answers at once; as `run`."""
    return run(lambda flight: answered(question(flight), flight), socket, as_json, reconnect_s)


async def _tell_of_silence(flight: FlightClient) -> None:
    """Ask the daemon from time to time whether it is there, and say so when it does not answer."""
    text = "the daemon does not answer yet; Ctrl-C ends the waiting"
    with suppress(FlightError):
        while True:
            telling = asyncio.get_running_loop().call_later(ANSWER_S, note, text)
            try:
                await flight.info()
            finally:
                telling.cancel()
            await asyncio.sleep(ANSWER_S)


def superseded(error: RequestError) -> bool:
    """Tell whether a newer request came in between."""
    return isinstance(error, WrongStateError) and error.reason.startswith("superseded by")


async def _next_step(flight: FlightClient, next_steps: Mapping[str, str]) -> str:
    """A line for the daemon's state, or nothing."""
    if next_steps:
        with suppress(FlightError):
            state = (await answered(flight.status(), flight))["state"]
            return f"\n{next_steps[state]}" if state in next_steps else ""
    return ""


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
