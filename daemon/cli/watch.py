"""`flightd watch`: a live view in the terminal; lines when the output is not a terminal."""

import asyncio
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import typer

from daemon.cli.common import (
    Exit,
    JsonOption,
    SocketOption,
    examples,
    fail,
    on_interrupt,
    run,
    say,
    say_json,
)
from daemon.cli.flying import reason_in_words
from daemon.cli.output import lost, on_terminal
from daemon.goals.client import FlightClient
from daemon.goals.listeners import Telemetry
from daemon.goals.results import (
    EventTelemetry,
    GoalFeedback,
    GoalRecord,
    HealthTelemetry,
    LoopReports,
    ReferenceTelemetry,
    StateTelemetry,
)

if TYPE_CHECKING:
    from rich.console import RenderableType

TOPICS = ("state", "reference", "goal", "health", "loops", "events")
RATE_HZ = 5.0
RECENT = 8
RECONNECT_S = 60.0
WATCH_EXITS = "0 after Ctrl-C, 5 no daemon, 6 not permitted, 130 nobody reads the output"


@dataclass(slots=True)
class Picture:
    """The newest of each topic."""

    state: StateTelemetry | None = None
    reference: ReferenceTelemetry | None = None
    health: HealthTelemetry | None = None
    loops: LoopReports | None = None
    feedback: GoalFeedback | None = None
    recent: deque[str] = field(default_factory=lambda: deque(maxlen=RECENT))

    def take(self, message: Telemetry) -> None:
        """Keep what a message tells."""
        data: Any = message.data
        match message.topic:
            case "state":
                self.state = data
            case "reference":
                self.reference = data
            case "health":
                self.health = data
            case "loops":
                self.loops = data
            case "events":
                self.recent.append(event_line(data))
            case _ if data["notification"] == "goal.result":
                self.feedback = None
                self.recent.append(result_line(data))
            case _:
                self.feedback = data


def event_line(event: EventTelemetry) -> str:
    """An event for people."""
    return f"{event['time_s']:.1f}  {event['code']}: {event['text']}"


def result_line(record: GoalRecord) -> str:
    """A goal's end for people."""
    reason = f": {reason_in_words(record['reason'])}" if record["reason"] else ""
    return f"{record['goal_id']} {record['outcome']}{reason}"


def rows(picture: Picture) -> list[tuple[str, str]]:
    """The live view as names and texts."""
    found: list[tuple[str, str]] = []
    health, state, reference, goal = picture.health, picture.state, picture.reference, picture.feedback
    if health is not None:
        autopilot = health["autopilot"]
        found.append(("state", health["state"]))
        found += [("", reason["text"]) for reason in health["reasons"]]
        armed = "armed" if autopilot["armed"] else "disarmed"
        found.append(("autopilot", f"{autopilot['mode']}, {armed}, {autopilot['landed']}"))
    if state is not None:
        found.append(("position", _vector(state["position_ned_m"]) + " m"))
        found.append(("velocity", _vector(state["velocity_ned_m_s"]) + " m/s"))
        found.append(("age", f"{1e3 * state['age_s']:.0f} ms"))
    if state is not None and reference is not None:
        off = [a - b for a, b in zip(state["position_ned_m"], reference["position_ned_m"], strict=True)]
        found.append(("error", _vector(off) + " m"))
    if goal is not None:
        distance = f", {goal['distance_m']:.1f} m" if goal["distance_m"] is not None else ""
        eta = f", {goal['eta_s']:.0f} s to go" if goal["eta_s"] is not None else ""
        found.append(("goal", f"{goal['goal_id']}: {goal['progress']:.0%}{distance}{eta}"))
    if picture.loops is not None:
        for name, loop in (("control", picture.loops["control"]), ("trajectory", picture.loops["trajectory"])):
            text = f"{loop['rate_hz']:.1f} Hz, p99 {loop['period_p99_ms']:.2f} ms, {loop['missed']} missed"
            found.append((name, text))
    return found + [("events" if index == 0 else "", line) for index, line in enumerate(picture.recent)]


def _vector(vector: list[float]) -> str:
    return "N {:8.2f}  E {:8.2f}  D {:8.2f}".format(*vector)


def _render(picture: Picture) -> "RenderableType":
    from rich.table import Table

    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column()
    for name, text in rows(picture):
        table.add_row(name, text)
    return table


async def _live(flight: FlightClient) -> None:
    from rich.live import Live

    picture = Picture()
    with Live(_render(picture), refresh_per_second=RATE_HZ) as live:
        async for message in flight.telemetry(*TOPICS, rate_hz=RATE_HZ):
            picture.take(message)
            live.update(_render(picture))


async def _lines(flight: FlightClient, as_json: bool) -> None:
    topics = TOPICS if as_json else ("goal", "events")
    async for message in flight.telemetry(*topics, rate_hz=RATE_HZ):
        if as_json:
            say_json({"topic": message.topic, **message.data})
        elif message.topic == "events":
            say(event_line(message.data))
        elif message.data["notification"] == "goal.result":
            say(result_line(message.data))
        if lost():
            return


def watch(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Watch the vehicle, the goal, the loops and the events until Ctrl-C."""

    async def work(flight: FlightClient) -> None:
        task = asyncio.ensure_future(_lines(flight, as_json) if as_json or not on_terminal() else _live(flight))
        stopped = asyncio.Event()
        on_interrupt(stopped.set)
        stopping = asyncio.ensure_future(stopped.wait())
        await asyncio.wait([task, stopping], return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
        task.cancel()  # the end of the connection is no error of its

    if lost():
        fail(Exit.INTERRUPTED, "nobody reads the output", as_json=False)
    run(work, socket, as_json, RECONNECT_S)
    if lost():
        raise typer.Exit(Exit.INTERRUPTED)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        short_help="Watch it live, until Ctrl-C.",
        epilog=examples("flightd watch", "flightd watch --json | jq .topic", exits=WATCH_EXITS),
    )(watch)
