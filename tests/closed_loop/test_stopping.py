"""A daemon that is told to stop: the vehicle goes to Hold or stays there, and each goal has its result by then."""

import asyncio

import pytest
from support.flight import Flight, fly

from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import PilotTakesOver


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


@pytest.mark.parametrize("after_s", [0.0, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0, 1.4, 2.5, 5.0])
def test_a_vehicle_that_was_armed_for_a_take_off_does_not_stay_armed_on_the_ground(after_s: float) -> None:
    """PX4 arms at once, and tells of it within a second: stopped before, between, or while its motors run up."""

    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        takeoff = asyncio.ensure_future(flight.vehicle.commander.takeoff(5.0))
        await asyncio.sleep(after_s)
        climbs = flight.px4.commander.landed_state is not LandedState.ON_GROUND
        await flight.vehicle.release()
        await asyncio.sleep(8.0)
        takeoff.cancel()
        await asyncio.gather(takeoff, return_exceptions=True)
        assert flight.px4.armed is climbs
        assert (flight.px4.height_m > 2.0) is climbs

    fly(scenario)


def test_a_vehicle_that_was_armed_and_stands_is_disarmed_and_cannot_be_armed_again() -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        await flight.vehicle.commander.arm()
        await asyncio.sleep(1.0)
        await flight.vehicle.release()
        assert not flight.px4.armed
        await flight.until(lambda: not flight.autopilot.status.value.armed)
        with pytest.raises(NotPossibleError, match="stopping"):
            await flight.vehicle.commander.arm()

    fly(scenario)


@pytest.mark.parametrize("mode", ["position", "hold"])
def test_a_vehicle_that_its_pilot_armed_stays_armed(mode: str) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        await flight.vehicle.commander.arm()
        await flight.vehicle.commander.disarm()
        flight.px4.inject(PilotTakesOver(mode=mode))
        flight.px4.commander.arm()
        await asyncio.sleep(1.5)
        assert flight.autopilot.status.value.armed
        await flight.vehicle.release()
        await asyncio.sleep(0.5)
        assert flight.px4.armed

    fly(scenario)


async def standing_by(flight: Flight) -> None:
    await flight.until(lambda: flight.state is State.STANDBY and flight.now_s > 3.0)
