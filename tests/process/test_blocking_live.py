"""A daemon that has flown nothing yet flies everything: nothing on its loop waits, no module is loaded late."""

import asyncio
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from support.air import HEIGHT_M, PATIENCE_S, Air, air, take
from support.processes import events_of, troubled_daemon
from support.standstill import StoodStillError, where_it_runs

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import RequestError
from daemon.goals.hub import TOPICS

CORNERS = [[3.0, 0.0, -HEIGHT_M], [3.0, 3.0, -HEIGHT_M - 1.0], [0.0, 3.0, -HEIGHT_M]]
CENTER = {"center": [0.0, 0.0, -HEIGHT_M], "speed_m_s": 2.0}
TRAJECTORIES: tuple[dict[str, Any], ...] = (
    {"kind": "circle", "radius_m": 2.0, **CENTER},
    {"kind": "lemniscate", "size_m": [3.0, 1.5], **CENTER},
    {"kind": "polynomial", "jerk_m_s3": [1.0, 0.0, 0.0], "duration_s": 2.0},
    {"kind": "hold", "duration_s": 0.5},
)


async def every_kind(flight: FlightClient, seen: Air) -> None:
    async def ended(goal: Any) -> None:
        async with asyncio.timeout(PATIENCE_S):
            await goal.result()

    await ended(await flight.goto(3.0, 0.0, -HEIGHT_M, yaw_deg=40.0))
    await ended(await flight.goto(0.0, 2.0, HEIGHT_M, frame="local_enu"))
    await ended(await flight.goto(2.0, 0.0, 0.0, frame="body_frd"))
    here = seen.px4.truth.position_ned_m
    for through in ("stop", "fly_by"):
        await ended(await flight.path([list(here), *CORNERS], through=through))
    for trajectory in TRAJECTORIES:
        goal = await flight.fly(trajectory)
        await seen.passes(1.5)
        with suppress(RequestError):  # the short ones are over
            await flight.cancel(goal.goal_id)
        await ended(goal)
    stream = await flight.stream()
    for _ in range(10):
        await flight.send_reference(stream.goal_id, seen.px4.truth.position_ned_m, (0.0, 0.0, 0.0))
        await asyncio.sleep(0.05)
    await ended(stream)
    await flight.set_config("guidance.limits.speed_m_s", 4.0)
    await flight.hold()


async def listens(flight: FlightClient) -> None:
    async for _ in flight.telemetry(*TOPICS, rate_hz=20.0):
        pass


def waits(log_file: Path) -> list[str]:
    return [str(event["call"]) for event in events_of(log_file) if event.get("event") == "blocking_call"]


async def fly_everything(folder: Path) -> None:
    async with air() as seen, troubled_daemon(folder, seen.connection) as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            await take(flight, seen)
            listening = asyncio.ensure_future(listens(flight))
            try:
                await every_kind(flight, seen)
            finally:
                listening.cancel()
                await asyncio.gather(listening, return_exceptions=True)


async def everything_is_flown(folder: Path) -> None:
    log_file = folder / "flightd.log"
    try:
        await fly_everything(folder)
    except RequestError:
        if "control_stalled" in log_file.read_text():
            raise StoodStillError from None
        raise
    finally:
        if found := waits(log_file):
            pytest.fail(str(found))


async def test_nothing_waits_on_the_loop_whatever_is_flown(tmp_path: Path) -> None:
    await where_it_runs(everything_is_flown, tmp_path)


async def test_a_call_that_waits_is_found_in_the_process(tmp_path: Path) -> None:
    async with air() as seen, troubled_daemon(tmp_path, seen.connection, "reads_file") as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            await take(flight, seen)
            child.process.send_signal(signal.SIGUSR1)
            await seen.passes(1.0)
    assert any("open" in call and "config.py" in call for call in waits(child.log_file))
