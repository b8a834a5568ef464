"""Commands to the vehicle, and its status."""

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.common import (
    ANSWER_EXITS,
    REQUEST_EXITS,
    UNCONNECTED,
    UNENGAGED,
    JsonOption,
    NumbersCommand,
    SocketOption,
    ask,
    examples,
    number,
    run,
    say,
    say_json,
)
from daemon.goals.client import FlightClient
from daemon.goals.results import Status, VehicleDone


def _do(
    request: Callable[[FlightClient], Awaitable[VehicleDone]],
    socket: Path | None,
    as_json: bool,
    next_steps: Mapping[str, str] = UNCONNECTED,
) -> None:
    done = run(request, socket, as_json, next_steps=next_steps)
    if as_json:
        say_json(dict(done))
    else:
        armed = "armed" if done["armed"] else "disarmed"
        say(f"{done['state']}: mode {done['mode']}, {armed}, {done['landed']}")


def status(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Show how the vehicle, the goal and the loops are."""
    found = ask(lambda flight: flight.status(), socket, as_json)
    if as_json:
        say_json(dict(found))
    else:
        for line in status_lines(found):
            say(line)


def status_lines(status: Status) -> list[str]:
    """Status for people."""
    autopilot, vehicle, goal = status["autopilot"], status["vehicle"], status["goal"]
    lines = [f"state      {status['state']}"]
    lines += [f"           {reason['text']}" for reason in status["reasons"]]
    if autopilot["connected"]:
        battery = f", battery {autopilot['battery_pct']:.0f} %" if autopilot["battery_pct"] is not None else ""
        armed = "armed" if autopilot["armed"] else "disarmed"
        way_ms = autopilot["round_trip_ms"]
        link = f", {way_ms:.0f} ms there and back" if way_ms is not None else ""
        lines.append(f"autopilot  {autopilot['mode']}, {armed}, {autopilot['landed']}{battery}{link}")
    else:
        lines.append("autopilot  not connected")
    if vehicle is not None:
        north, east, down = vehicle["position_ned_m"]
        speed = sum(v * v for v in vehicle["velocity_ned_m_s"]) ** 0.5
        lines.append(f"position   N {north:.2f}  E {east:.2f}  D {down:.2f} m, {speed:.2f} m/s")
    if goal is not None:
        distance = f", {goal['distance_m']:.1f} m" if goal["distance_m"] is not None else ""
        eta = f", {goal['eta_s']:.0f} s to go" if goal["eta_s"] is not None else ""
        lines.append(f"goal       {goal['goal_id']} ({goal['kind']}) {goal['progress']:.0%}{distance}{eta}")
    for name, loop in (("control", status["loops"]["control"]), ("trajectory", status["loops"]["trajectory"])):
        text = f"{loop['rate_hz']:.1f} Hz, p99 {loop['period_p99_ms']:.2f} ms, {loop['missed']} missed"
        lines.append(f"{name:<10} {text}")
    return lines


def arm(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Arm."""
    _do(lambda flight: flight.arm(), socket, as_json)


def disarm(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Disarm; refused unless landed."""
    _do(lambda flight: flight.disarm(), socket, as_json)


def takeoff(
    altitude: Annotated[float, typer.Argument(parser=number, metavar="ALT", help="Metres above the take-off point.")],
    as_json: JsonOption = False,
    socket: SocketOption = None,
) -> None:
    """Arm if needed, take off, and wait until the vehicle holds in the air."""
    _do(lambda flight: flight.takeoff(altitude), socket, as_json)


def engage(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Take the vehicle from the autopilot's Hold."""
    _do(lambda flight: flight.engage(), socket, as_json, UNENGAGED)


def hold(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Release the vehicle to the autopilot's Hold; this ends a goal."""
    _do(lambda flight: flight.hold(), socket, as_json)


def land(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Land here and wait until the vehicle is disarmed."""
    _do(lambda flight: flight.land(), socket, as_json)


def return_(as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Return to launch and wait until the vehicle is disarmed."""
    _do(lambda flight: flight.return_to_launch(), socket, as_json)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(epilog=examples("flightd status", "flightd status --json", exits=ANSWER_EXITS))(status)
    app.command(epilog=examples("flightd arm", exits=REQUEST_EXITS))(arm)
    app.command(epilog=examples("flightd disarm", exits=REQUEST_EXITS))(disarm)
    app.command(
        cls=NumbersCommand,
        short_help="Take off and hold in the air.",
        epilog=examples("flightd takeoff 5", exits=REQUEST_EXITS),
    )(takeoff)
    app.command(epilog=examples("flightd engage", exits=REQUEST_EXITS))(engage)
    app.command(short_help="Release the vehicle to Hold.", epilog=examples("flightd hold", exits=REQUEST_EXITS))(hold)
    app.command(epilog=examples("flightd land", exits=REQUEST_EXITS))(land)
    app.command("return", epilog=examples("flightd return", exits=REQUEST_EXITS))(return_)
