"""A vehicle that cannot follow its reference: a wind, or limits, that leave too little tilt."""

import asyncio
from math import dist, hypot

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals import methods
from daemon.messages import FlightMode, Vec3
from daemon.safety.supervisor import State
from daemon.sim.faults import Payload, SteadyWind

HEAD_WIND_M_S = 6.0  # beside a drag of 1 1/s more than the tilt allows for on the way north


async def _in_head_wind(flight: Flight) -> None:
    await flight.airborne()
    flight.px4.inject(SteadyWind(north_m_s=-HEAD_WIND_M_S))
    await asyncio.sleep(4.0)


async def _behind(flight: Flight) -> None:
    """Waits until the reference is 3 m ahead: too far to fly on to, not yet far enough to give the goal up."""

    def deviation_m() -> float:
        control = flight.records[-1].control
        return 0.0 if control is None else hypot(*control.position_error_ned_m)

    await flight.until(lambda: deviation_m() > 3.0)


def test_a_canceled_goal_stops_the_vehicle_where_it_is_not_where_its_reference_has_gone():
    async def scenario(flight: Flight) -> None:
        await _in_head_wind(flight)
        goal = await flight.submit(waypoint={"position": [100.0, 0.0, -5.0]})
        await _behind(flight)
        where = flight.position
        await flight.service.goal_cancel(methods.GoalCancel(), CALLER)
        entry = await flight.result(goal, 30.0)
        assert entry.outcome == "canceled"
        await asyncio.sleep(10.0)
        assert dist(flight.position, where) < 2.5

    fly(scenario)


@pytest.mark.parametrize("through", ["waypoint", "stop", "fly_by"])
def test_a_new_goal_starts_from_a_vehicle_that_its_reference_has_left_behind(through: str):
    async def scenario(flight: Flight) -> None:
        await _in_head_wind(flight)
        await flight.submit(waypoint={"position": [100.0, 0.0, -5.0]})
        await _behind(flight)
        where = flight.position
        first, second = ({"position": [where[0], east, -5.0]} for east in (20.0, 30.0))
        if through == "waypoint":
            await flight.submit(waypoint=first)
        else:
            await flight.submit(path={"waypoints": [first, second], "through": through})
        await asyncio.sleep(0.15)
        reference = flight.records[-1].reference
        assert reference is not None
        assert dist(reference.position_ned_m, flight.position) < 1.0

    fly(scenario)


def test_a_goal_whose_reference_goes_on_without_the_vehicle_ends_and_the_vehicle_stays_near_its_path():
    corner = [{"position": [80.0, 0.0, -5.0]}, {"position": [80.0, 60.0, -5.0]}]

    async def scenario(flight: Flight) -> None:
        await _in_head_wind(flight)
        goal = await flight.submit(path={"waypoints": corner, "through": "stop"})
        entry = await flight.result(goal, 60.0)
        assert (entry.outcome, entry.reason) == ("aborted", "not_followed")
        where = flight.position
        await asyncio.sleep(10.0)
        assert dist(flight.position, where) < 2.5
        assert max(abs(east) for _, east, _ in flight.truths) < 1.0  # it has not cut the corner

    fly(scenario)


def test_a_hold_that_a_gust_pushes_the_vehicle_from_stays_where_it_is():
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        held = flight.position
        flight.px4.inject(SteadyWind(north_m_s=-9.0))
        await flight.until(lambda: dist(flight.position, held) > 4.5)
        flight.px4.inject(SteadyWind(north_m_s=0.0))
        await asyncio.sleep(15.0)
        assert flight.state is State.HOLDING
        assert dist(flight.position, held) < 0.5

    fly(scenario)


async def _given_to_hold(flight: Flight) -> Vec3:
    """Waits for the hand-over; where it was."""
    await flight.until(lambda: flight.state is State.READY)
    assert flight.records[-1].supervision.left == "not_followed"
    assert flight.px4.mode is FlightMode.HOLD
    return flight.position


@pytest.mark.parametrize("canceled", [False, True])
def test_a_vehicle_that_the_wind_carries_off_is_given_to_the_autopilots_hold(canceled: bool):
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        if canceled:
            await flight.goto(60.0, 0.0, -5.0)
            await asyncio.sleep(3.0)
            await flight.service.goal_cancel(methods.GoalCancel(), CALLER)
        held = flight.position
        flight.px4.inject(SteadyWind(north_m_s=9.0))
        assert dist(await _given_to_hold(flight), held) < 20.0

    fly(scenario)


@pytest.mark.parametrize("with_goal", [False, True])
def test_a_vehicle_that_sinks_under_its_load_is_given_to_hold_before_it_is_on_the_ground(with_goal: bool):
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal = await flight.submit(trajectory={"kind": "hold", "duration_s": 60.0}) if with_goal else None
        await asyncio.sleep(2.0)
        flight.px4.inject(Payload(mass_kg=1.0))
        assert -(await _given_to_hold(flight))[2] > 2.0
        await asyncio.sleep(10.0)
        assert -flight.position[2] > 1.5  # what the law may not use of the thrust, the autopilot may
        if goal is not None:
            assert (await flight.result(goal)).reason == "not_followed"

    fly(scenario)
