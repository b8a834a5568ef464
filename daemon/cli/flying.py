"""Follow a goal from its submission to its result: a progress line, Ctrl-C cancels."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Protocol

from daemon.cli.common import GOES_ON, UNENGAGED, exit_with, note, on_interrupt, run, say, say_json
from daemon.cli.output import on_terminal
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError
from daemon.goals.goal import Feedback, Goal, Result
from daemon.safety.reasons import REASONS

RECONNECT_S = 10.0
Submit = Callable[[FlightClient], Awaitable[Goal]]


class Line(Protocol):
    """Where progress is shown."""

    def update(self, text: str) -> None:
        """Show the newest text."""


class Silence:
    """No progress: the output goes to a script or a file."""

    def update(self, text: str) -> None:
        """Show nothing."""


class _Interrupt:
    """The first Ctrl-C: it cancels the goal."""

    def __init__(self) -> None:
        self.came = asyncio.Event()
        self.canceling = False

    def begin(self) -> None:
        """It is here."""
        note("canceling; the vehicle brakes and holds")
        self.came.set()

    def in_words(self) -> str:
        """What a second one leaves behind."""
        return "interrupted; the cancel was sent, `flightd status` tells how it went" if self.canceling else GOES_ON

    async def cancel(self, goal: Goal) -> None:
        """Cancel the goal when it comes."""
        await self.came.wait()
        self.canceling = True
        try:
            await goal.cancel()
        except FlightError as error:
            if not goal.done:
                note(f"could not cancel: {error}; `flightd hold` releases the vehicle")


def fly(submit: Submit, socket: Path | None, as_json: bool) -> None:
    """Submit a goal, show how it goes, leave with the exit code of its outcome."""
    interrupt = _Interrupt()
    result = run(
        lambda flight: _follow(flight, submit, interrupt, as_json),
        socket,
        as_json,
        RECONNECT_S,
        UNENGAGED,
        interrupt.in_words,
    )
    if as_json:
        say_json(asdict(result))
    else:
        say(in_words(result))
    exit_with(result)


async def _follow(flight: FlightClient, submit: Submit, interrupt: _Interrupt, as_json: bool) -> Result:
    on_interrupt(interrupt.begin)  # before the goal exists: an interrupt while it is being submitted counts
    goal = await submit(flight)
    canceling = asyncio.create_task(interrupt.cancel(goal))
    try:
        with _line(as_json) as line:
            async for feedback in goal:
                line.update(progress(goal.goal_id, feedback))
        return await goal
    finally:
        canceling.cancel()


def _line(as_json: bool) -> AbstractContextManager[Line]:
    if as_json or not on_terminal():
        return nullcontext(Silence())
    from rich.console import Console

    return Console().status("accepted", spinner="dots")


def progress(goal_id: str, feedback: Feedback) -> str:
    """One line: distance, heading error and time to go."""
    parts = [f"{goal_id}: {feedback.progress:4.0%}"]
    if feedback.distance_m is not None:
        parts.append(f"{feedback.distance_m:.1f} m")
    if feedback.angle_deg is not None:
        parts.append(f"{feedback.angle_deg:.0f} deg")
    parts.append(f"{feedback.eta_s:.0f} s to go" if feedback.eta_s is not None else "time to go unknown")
    return ", ".join(parts)


def in_words(result: Result) -> str:
    """How a goal ended, as a sentence."""
    text = f"{result.goal_id} {result.outcome}"
    if result.duration_s is not None:
        text += f" after {result.duration_s:.1f} s"
    if result.error_m is not None:
        text += f", {result.error_m:.2f} m"
        text += f" and {result.error_deg:.1f} deg off" if result.error_deg is not None else " off"
    if result.by is not None:
        text += f"; by {result.by}"
    if result.reason is not None:
        text += f": {reason_in_words(result.reason)}"
    if result.outcome == "aborted":
        text += "\n`flightd status` tells how the vehicle is now"
    return text


def reason_in_words(reason: str) -> str:
    """Why a goal ended."""
    return f"{REASONS[reason]} ({reason})" if reason in REASONS else reason
