"""The geofence against a goal, a moving start and the wind: soft it ends the goal, hard it hands the vehicle over."""

from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.goals.errors import ProtocolError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import SteadyWind, WindGust


def fenced(**fence: Any) -> dict[str, Any]:
    return {"safety": {"fence": {"radius_m": 20.0, **fence}}}


def test_a_goal_outside_is_refused_while_the_one_inside_goes_on_from_a_moving_start() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        inside = await flight.goto(18.0, 0.0, -5.0)
        await flight.until(lambda: flight.px4.truth.velocity_ned_m_s[0] > 3.0)
        with pytest.raises(ProtocolError, match="outside the fence"):
            await flight.goto(25.0, 0.0, -5.0)
        assert (await flight.result(inside)).outcome == "succeeded"
        assert max(truth[0] for truth in flight.truths) < 20.0

    fly(scenario, config=fenced())


def test_wind_across_the_soft_fence_ends_the_goal_and_the_vehicle_comes_back_inside() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(waypoint={"position": [19.7, 0.0, -5.0], "hold_s": 60.0})
        await flight.until(lambda: flight.position[0] > 19.5)
        flight.px4.inject(WindGust(north_m_s=15.0, duration_s=2.0))
        entry = await flight.result(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "geofence")
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 6.0)
        assert flight.state is State.HOLDING
        assert flight.position[0] < 20.0

    fly(scenario, config=fenced())


def test_wind_across_the_hard_fence_hands_the_vehicle_over() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(waypoint={"position": [19.7, 0.0, -5.0], "hold_s": 60.0})
        await flight.until(lambda: flight.position[0] > 19.5)
        flight.px4.inject(SteadyWind(north_m_s=30.0))
        entry = await flight.result(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "geofence")
        await flight.until(lambda: flight.state is State.READY)
        assert flight.records[-1].supervision.left == "geofence"
        await flight.until(lambda: flight.px4.mode is FlightMode.RETURN)
        assert flight.state in (State.READY, State.LANDING)
        assert flight.sent[-1][0] < flight.now_s

    fly(scenario, config=fenced(hard_margin_m=1.0))
