"""A daemon that is told to stop: the vehicle goes to Hold or stays there, and each goal has its result by then."""

import asyncio

import pytest
from support.flight import Flight, fly

from daemon.messages import FlightMode
from daemon.safety.supervisor import OURS


@pytest.mark.parametrize("after_s", [0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.3, 1.0, 2.5])
def test_a_goal_that_is_still_engaging_or_flown_ends_with_one_result(after_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        goal_id = await flight.goto(5.0, 0.0, -5.0)
        await asyncio.sleep(after_s)
        await flight.vehicle.release()
        assert [entry.goal_id for entry in flight.ended] == [goal_id]
        assert (flight.ended[0].outcome, flight.ended[0].reason) == ("aborted", "stopping")
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 2.0)
        assert len(flight.ended) == 1
        assert flight.px4.mode is FlightMode.HOLD
        assert flight.state not in OURS

    fly(scenario)


def test_a_goal_that_waits_for_a_long_plan_ends_with_a_result() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        points = [{"position": [8.0, 0.0, -5.0]}, {"position": [8.0, 6.0, -6.0]}, {"position": [0.0, 6.0, -5.0]}]
        goal_id = await flight.submit(path={"waypoints": points, "through": "fly_by"})
        await flight.vehicle.release()
        assert [entry.goal_id for entry in flight.ended] == [goal_id]

    fly(scenario)
