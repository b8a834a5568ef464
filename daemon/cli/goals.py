"""Commands that submit and cancel goals."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from daemon.cli.common import JsonOption, NumbersCommand, SocketOption, examples, number, run, say, say_json
from daemon.cli.flying import fly
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


Coordinate = Annotated[float, typer.Argument(parser=number, metavar="NUMBER")]
FrameOption = Annotated[FrameName, typer.Option("--frame", help="Frame of the position.")]
ModeOption = Annotated[ModeName, typer.Option("--mode", help="Which parts of the pose count.")]
YawOption = Annotated[float | None, typer.Option("--yaw", parser=number, metavar="DEG", help="Heading.")]
HoldOption = Annotated[float, typer.Option("--hold", parser=number, metavar="S", help="Stay before it succeeds.")]
TimeoutOption = Annotated[float | None, typer.Option("--timeout", parser=number, metavar="S", help="Abort after.")]
SpeedOption = Annotated[float | None, typer.Option("--speed", parser=number, metavar="M/S", help="Fly no faster.")]


def limits_of(speed: float | None) -> dict[str, float] | None:
    """Limits of a goal, or none."""
    return None if speed is None else {"speed_m_s": speed}


def goto(
    north: Annotated[float, typer.Argument(parser=number, metavar="N", help="North, m (or x, or latitude).")],
    east: Annotated[float, typer.Argument(parser=number, metavar="E", help="East, m (or y, or longitude).")],
    down: Annotated[float, typer.Argument(parser=number, metavar="D", help="Down, m (or z, or altitude).")],
    yaw: YawOption = None,
    frame: FrameOption = FrameName.LOCAL_NED,
    mode: ModeOption = ModeName.FULL_POSE,
    hold: HoldOption = 0.0,
    timeout: TimeoutOption = None,
    speed: SpeedOption = None,
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Fly to a position and wait until the vehicle is there. Ctrl-C cancels the goal: the vehicle brakes and holds."""
    waypoint: dict[str, Any] = {"frame": str(frame), "mode": str(mode), "hold_s": hold}
    if yaw is not None:
        waypoint["yaw_deg"] = yaw

    async def submit(flight: Any) -> Goal:
        return await flight.goto(  # type: ignore[no-any-return]
            north, east, down, limits=limits_of(speed), timeout_s=timeout, **waypoint
        )

    fly(submit, socket, as_json)


def cancel(
    goal_id: Annotated[str | None, typer.Argument(help="Goal to cancel (default: the active one).")] = None,
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
        "flightd goto 10 0 -5", "flightd goto 10 0 -5 --yaw 90 --hold 3", "flightd goto 5 0 0 --frame body_frd"
    )
    app.command(cls=NumbersCommand, epilog=goto_examples)(goto)
    app.command(epilog=examples("flightd cancel"))(cancel)
