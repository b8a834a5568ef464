"""Commands that submit and cancel goals."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from daemon.cli.common import (
    ANSWER_EXITS,
    GOAL_EXITS,
    Exit,
    JsonOption,
    NumbersCommand,
    PlainCommand,
    SocketOption,
    examples,
    fail,
    number,
    run,
    say,
    say_json,
)
from daemon.cli.flying import fly
from daemon.goals.client import FlightClient
from daemon.goals.goal import Goal


class FrameName(StrEnum):
    """Frames of a position."""

    LOCAL_NED = "local_ned"
    LOCAL_ENU = "local_enu"
    BODY_FRD = "body_frd"
    GLOBAL = "global"


class ModeName(StrEnum):
    """Which parts of the pose count."""

    FULL_POSE = "full_pose"
    ONLY_POSITION = "only_position"
    FORWARD_HEADING = "forward_heading"
    ONLY_ORIENTATION = "only_orientation"
    POSITION_AND_YAW = "position_and_yaw"
    XY_AND_YAW = "xy_and_yaw"


class Through(StrEnum):
    """How a path meets its waypoints."""

    STOP = "stop"
    FLY_BY = "fly_by"


North = Annotated[float, typer.Argument(parser=number, metavar="N", help="North, m (or x, or latitude).")]
East = Annotated[float, typer.Argument(parser=number, metavar="E", help="East, m (or y, or longitude).")]
Down = Annotated[
    float, typer.Argument(parser=number, metavar="D", help="Down, m: -5 is 5 m above the origin (or z, or altitude).")
]
FrameOption = Annotated[
    FrameName, typer.Option("--frame", metavar="FRAME", help=f"Frame of the position: {', '.join(FrameName)}.")
]
ModeOption = Annotated[
    ModeName, typer.Option("--mode", metavar="MODE", help=f"Which parts of the pose count: {', '.join(ModeName)}.")
]
YawOption = Annotated[
    float | None,
    typer.Option(
        "--yaw",
        parser=number,
        metavar="DEG",
        help="Heading: clockwise from North; in local_enu counter-clockwise from East; in body_frd clockwise from the "
        "heading of now (default: as it is).",
    ),
]
HoldOption = Annotated[
    float, typer.Option("--hold", parser=number, metavar="S", help="Stay there before it counts as done.")
]
TimeoutOption = Annotated[
    float | None, typer.Option("--timeout", parser=number, metavar="S", help="Abort when it takes longer.")
]
SpeedOption = Annotated[
    float | None, typer.Option("--max-speed", parser=number, metavar="M/S", help="Fly no faster than this.")
]


def limits_of(max_speed: float | None) -> dict[str, float] | None:
    """Limits of a goal, or none."""
    return None if max_speed is None else {"speed_m_s": max_speed}


def goto(
    north: North,
    east: East,
    down: Down,
    yaw: YawOption = None,
    frame: FrameOption = FrameName.LOCAL_NED,
    mode: ModeOption = ModeName.FULL_POSE,
    hold: HoldOption = 0.0,
    timeout: TimeoutOption = None,
    max_speed: SpeedOption = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Fly to a position and wait until the vehicle is there. Ctrl-C cancels the goal: the vehicle brakes and holds."""
    waypoint: dict[str, Any] = {"frame": str(frame), "mode": str(mode), "hold_s": hold, "yaw_deg": yaw}

    async def submit(flight: FlightClient) -> Goal:
        return await flight.goto(north, east, down, limits=limits_of(max_speed), timeout_s=timeout, **waypoint)

    fly(submit, socket, as_json)


def path(
    numbers: Annotated[
        list[float],
        typer.Argument(parser=number, metavar="N E D...", help="Waypoints, three numbers each, as for `flightd goto`."),
    ],
    through: Annotated[
        Through, typer.Option(metavar="HOW", help="How to meet them: stop at each, or fly_by in one smooth path.")
    ] = Through.STOP,
    yaw: YawOption = None,
    frame: FrameOption = FrameName.LOCAL_NED,
    timeout: TimeoutOption = None,
    max_speed: SpeedOption = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Fly along waypoints. Ctrl-C cancels the goal: the vehicle brakes and holds."""
    if len(numbers) % 3 != 0:
        fail(Exit.REFUSED, f"each waypoint has three numbers; {len(numbers)} is not a multiple of three", as_json)
    heading = {} if yaw is None else {"yaw_deg": yaw}
    points = [numbers[i : i + 3] for i in range(0, len(numbers), 3)]
    waypoints = [{"position": point, "frame": str(frame), **heading} for point in points]

    async def submit(flight: FlightClient) -> Goal:
        return await flight.path(waypoints, through=str(through), limits=limits_of(max_speed), timeout_s=timeout)

    fly(submit, socket, as_json)


def cancel(
    goal_id: Annotated[
        str | None, typer.Argument(metavar="GOAL", help="Goal to cancel (default: the active one).")
    ] = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Cancel a goal: the vehicle brakes and holds its place."""
    canceled = run(lambda flight: flight.cancel(goal_id), socket, as_json)
    if as_json:
        say_json({"goal_id": canceled})
    else:
        say(f"{canceled} is being canceled")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    goto_examples = examples(
        "flightd goto 10 0 -5",
        "flightd goto 10 0 -5 --yaw 90 --hold 3",
        "flightd goto 5 0 0 --frame body_frd --max-speed 1",
        "flightd goto 47.3977 8.5456 500 --frame global",
        exits=GOAL_EXITS,
    )
    path_examples = examples(
        "flightd path 0 0 -5  10 0 -5  10 10 -5", "flightd path 0 0 -5  10 5 -8 --through fly_by", exits=GOAL_EXITS
    )
    app.command(cls=NumbersCommand, epilog=goto_examples)(goto)
    app.command(cls=NumbersCommand, epilog=path_examples)(path)
    app.command(cls=PlainCommand, epilog=examples("flightd cancel", exits=ANSWER_EXITS))(cancel)
