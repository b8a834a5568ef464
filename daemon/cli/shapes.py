"""`flightd fly`: circles, lemniscates and holds."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from daemon.cli.common import GOAL_EXITS, JsonOption, NumbersCommand, SocketOption, examples, number
from daemon.cli.flying import fly
from daemon.cli.goals import Down, East, FrameName, FrameOption, North, TimeoutOption
from daemon.goals.client import FlightClient
from daemon.goals.goal import Goal

SPEED_M_S = 1.0


class Direction(StrEnum):
    """Sense of a turn, seen along the axis."""

    CW = "cw"
    CCW = "ccw"


class HeadingName(StrEnum):
    """Where the vehicle looks."""

    FIXED = "fixed"
    TARGET = "target"
    VELOCITY = "velocity"


SpeedOption = Annotated[float, typer.Option("--speed", parser=number, metavar="M/S", help="Speed along the shape.")]
TurnsOption = Annotated[float, typer.Option("--turns", parser=number, metavar="N", help="How many times around.")]
DirectionOption = Annotated[
    Direction,
    typer.Option(
        "--direction", metavar="SENSE", help="cw or ccw, seen along the axis: from above, but from below in local_enu."
    ),
]
HeadingOption = Annotated[
    HeadingName, typer.Option("--heading", metavar="WHERE", help=f"Where the vehicle looks: {', '.join(HeadingName)}.")
]


def circle(
    north: North,
    east: East,
    down: Down,
    radius: Annotated[float, typer.Option(parser=number, metavar="M", help="Radius.")],
    speed: SpeedOption = SPEED_M_S,
    turns: TurnsOption = 1.0,
    direction: DirectionOption = Direction.CW,
    heading: HeadingOption = HeadingName.FIXED,
    frame: FrameOption = FrameName.LOCAL_NED,
    timeout: TimeoutOption = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Fly a horizontal circle about a centre."""
    shape = {"kind": "circle", "center": [north, east, down], "radius_m": radius, "speed_m_s": speed, "turns": turns}
    shape |= {"direction": str(direction), "heading": str(heading), "frame": str(frame)}
    _fly(shape, timeout, socket, as_json)


def lemniscate(
    north: North,
    east: East,
    down: Down,
    length: Annotated[float, typer.Option(parser=number, metavar="M", help="Semi-axis along north.")],
    width: Annotated[float, typer.Option(parser=number, metavar="M", help="Semi-axis along east.")],
    speed: SpeedOption = SPEED_M_S,
    turns: TurnsOption = 1.0,
    direction: DirectionOption = Direction.CW,
    heading: HeadingOption = HeadingName.FIXED,
    frame: FrameOption = FrameName.LOCAL_NED,
    timeout: TimeoutOption = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Fly a figure of eight about a centre; the speed is its peak."""
    shape = {"kind": "lemniscate", "center": [north, east, down], "size_m": [length, width], "speed_m_s": speed}
    shape |= {"turns": turns, "direction": str(direction), "heading": str(heading), "frame": str(frame)}
    _fly(shape, timeout, socket, as_json)


def stay(
    seconds: Annotated[float, typer.Argument(parser=number, metavar="S", help="How long.")],
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Stay in place for a time, under the daemon's control."""
    _fly({"kind": "hold", "duration_s": seconds}, None, socket, as_json)


def _fly(shape: dict[str, Any], timeout_s: float | None, socket: Path | None, as_json: bool) -> None:
    async def submit(flight: FlightClient) -> Goal:
        return await flight.fly(shape, timeout_s=timeout_s)

    fly(submit, socket, as_json)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    shapes = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Fly a shape.")
    shapes.command(
        cls=NumbersCommand, epilog=examples("flightd fly circle 0 0 -5 --radius 3 --speed 2", exits=GOAL_EXITS)
    )(circle)
    eight = examples("flightd fly lemniscate 0 0 -5 --length 8 --width 4 --turns 2", exits=GOAL_EXITS)
    shapes.command(cls=NumbersCommand, epilog=eight)(lemniscate)
    shapes.command("hold", cls=NumbersCommand, epilog=examples("flightd fly hold 10", exits=GOAL_EXITS))(stay)
    app.add_typer(shapes, name="fly")
