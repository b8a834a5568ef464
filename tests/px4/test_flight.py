"""A flight on whatever PX4 listens at $FLIGHTD_PX4_URL (disarmed, on the ground, in simulation)."""

import os
from math import dist
from pathlib import Path

import pytest
from support.processes import daemon_on, until

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import RefusedError, WrongStateError

URL = os.environ.get("FLIGHTD_PX4_URL")
pytestmark = [pytest.mark.px4, pytest.mark.skipif(not URL, reason="FLIGHTD_PX4_URL names no PX4")]
WITHIN_M = 0.3


async def test_take_off_three_goals_with_a_preemption_and_land(tmp_path: Path) -> None:
    assert URL is not None
    async with daemon_on(tmp_path, URL) as daemon, FlightClient(daemon.socket) as flight:
        await until(flight, lambda s: s["state"] == "standby" and s["vehicle"] is not None)
        with pytest.raises(WrongStateError):
            await flight.goto(5, 0, -5)
        done = await flight.takeoff(5)
        assert (done["state"], done["mode"], done["landed"]) == ("ready", "hold", "in_air")

        first = await flight.goto(8, 0, -5)
        async for feedback in first:
            if feedback.distance_m is not None and feedback.distance_m < 6.0:
                break
        second = await flight.goto(0, 6, -7)
        assert second.preempted == first.goal_id
        result = await first
        assert (result.outcome, result.by) == ("preempted", second.goal_id)
        assert (await second).outcome == "succeeded"
        with pytest.raises(RefusedError, match="ceiling"):
            await flight.goto(0, 0, -1000)
        third = await (await flight.goto(0, 0, -5, yaw_deg=90))
        assert third.outcome == "succeeded"
        assert third.error_m is not None and third.error_m < WITHIN_M
        assert third.error_deg is not None and third.error_deg < 5.0

        status = await flight.status()
        assert status["autopilot"]["mode"] == "offboard"
        assert status["vehicle"] is not None
        assert dist(status["vehicle"]["position_ned_m"], (0, 0, -5)) < 2 * WITHIN_M
        done = await flight.hold()
        assert (done["state"], done["mode"]) == ("ready", "hold")
        done = await flight.land()
        assert (done["state"], done["armed"]) == ("standby", False)
    assert await daemon.stop() == 0


async def test_sigterm_in_flight_hands_over_to_hold(tmp_path: Path) -> None:
    assert URL is not None
    async with daemon_on(tmp_path, URL) as daemon, FlightClient(daemon.socket) as flight:
        await until(flight, lambda s: s["state"] == "standby" and s["vehicle"] is not None)
        await flight.takeoff(5)
        await flight.goto(20, 0, -5)
        await until(flight, lambda s: s["state"] == "tracking")
        assert await daemon.stop() == 0
        assert daemon.states()[-2:] == ["releasing", "ready"]
    async with daemon_on(tmp_path, URL) as again, FlightClient(again.socket) as flight:
        status = await until(flight, lambda s: s["state"] == "pilot")
        assert status["reasons"][0]["code"] == "found_flying"
        assert status["autopilot"]["mode"] == "hold"
        await flight.hold()
        await flight.land()
