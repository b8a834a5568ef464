"""A daemon that stands still in flight, on whatever PX4 listens at $FLIGHTD_PX4_URL: who has the vehicle afterwards."""

import asyncio
import os
import signal
from pathlib import Path

import pytest
from support.processes import troubled_daemon, until

from daemon.goals.client import FlightClient

URL = os.environ.get("FLIGHTD_PX4_URL")
BLOCK_S = 3.0
pytestmark = [pytest.mark.px4, pytest.mark.skipif(not URL, reason="FLIGHTD_PX4_URL names no PX4")]


@pytest.mark.parametrize(
    ("number", "trouble", "modes"),
    [
        (signal.SIGUSR1, "loop_blocked", {"hold"}),
        (signal.SIGUSR1, "interpreter_held", {"return", "land", "hold"}),
        (signal.SIGSTOP, "", {"return", "land", "hold"}),
    ],
    ids=["blocked loop", "held interpreter lock", "stopped process"],
)
async def test_a_daemon_that_stands_still_gives_the_vehicle_away_and_does_not_take_it_back(
    number: signal.Signals, trouble: str, modes: set[str], tmp_path: Path
) -> None:
    assert URL is not None
    async with (
        troubled_daemon(tmp_path, URL, trouble, block_s=BLOCK_S) as daemon,
        FlightClient(daemon.socket) as flight,
    ):
        await until(flight, lambda s: s["state"] == "standby" and s["vehicle"] is not None)
        await flight.takeoff(10)
        await flight.goto(40, 0, -10)
        await until(flight, lambda s: s["vehicle"]["velocity_ned_m_s"][0] > 3.0)
        daemon.process.send_signal(number)
        await asyncio.sleep(BLOCK_S)
        daemon.process.send_signal(signal.SIGCONT)
        status = await until(flight, lambda s: s["state"] in ("fault", "pilot"))
        await asyncio.sleep(2.0)
        status = dict(await flight.status())
        assert status["state"] in ("fault", "pilot")
        assert status["autopilot"]["mode"] in modes
        await flight.hold()
        await flight.engage()
        assert (await (await flight.goto(0, 0, -5))).outcome == "succeeded"
        await flight.land()
