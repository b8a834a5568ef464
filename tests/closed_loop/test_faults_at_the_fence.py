"""The geofence against a goal, a moving start and the wind: soft it ends the goal, hard it hands the vehicle over."""

from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.goals.errors import ProtocolError
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import PilotTakesOver, SteadyWind, WindGust


def fenced(**fence: Any) -> dict[str, Any]:
    return {"safety": {"fence": {"radius_m": 20.0, **fence}}}


def quick(**fence: Any) -> dict[str, Any]:
    return {**fenced(**fence), "guidance": {"limits": {"speed_m_s": 8.0}}}


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


async def _outside(flight: Flight) -> None:
    """A pilot flies beyond the hard fence and leaves the vehicle in Hold there."""
    await flight.airborne(engage=False)
    flight.px4.inject(PilotTakesOver(mode="position", forward=1.0))
    await flight.until(lambda: flight.position[0] > 30.0)
    flight.px4.faults.clear()
    flight.px4.pilot_switches_to(FlightMode.HOLD)
    await flight.until(lambda: flight.px4.truth.velocity_ned_m_s[0] < 0.1)
    await flight.vehicle.commander.hold()


def test_a_vehicle_beyond_the_hard_fence_is_not_engaged_only_to_be_given_back() -> None:
    async def scenario(flight: Flight) -> None:
        await _outside(flight)
        with pytest.raises(NotPossibleError, match="beyond the hard fence"):
            await flight.vehicle.commander.engage()
        with pytest.raises(ProtocolError, match="beyond the hard fence"):
            await flight.goto(10.0, 0.0, -5.0)
        await flight.until(lambda: flight.now_s > 60.0)
        assert flight.px4.mode is FlightMode.HOLD
        assert flight.sent == []

    fly(scenario, config=fenced())


@pytest.mark.parametrize("moved_m", [30.0, 600.0])
def test_a_home_that_somebody_moves_away_hands_over_to_hold_and_no_further(moved_m: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.goto(15.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 8.0)
        take, degrees_e7 = flight.px4.take_outgoing, round(moved_m / 111_195.0 * 1e7)

        def taken() -> list[tuple[str, dict[str, Any]]]:
            return [
                (name, {**fields, "latitude": fields["latitude"] - degrees_e7} if name == "HOME_POSITION" else fields)
                for name, fields in take()
            ]

        flight.px4.take_outgoing = taken  # type: ignore[method-assign]
        await flight.until(lambda: flight.state is State.READY)
        assert flight.records[-1].supervision.left == "geofence"
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 10.0)
        assert flight.px4.mode is FlightMode.HOLD
        assert {mode for _, mode in flight.asked} == {FlightMode.OFFBOARD, FlightMode.HOLD}

    fly(scenario, config=fenced())


# Two arms of 25 m to the north, and between them a gap of 30 m (5 to 35 m east) that is outside.
U_SHAPE = [
    [-20.0, -20.0],
    [-20.0, 60.0],
    [80.0, 60.0],
    [80.0, 35.0],
    [0.0, 35.0],
    [0.0, 5.0],
    [80.0, 5.0],
    [80.0, -20.0],
]


@pytest.mark.parametrize("hold_s", [0.0, 900.0])
def test_a_path_across_a_gap_of_the_fence_is_refused_however_long_it_rests(hold_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        waypoints = [{"position": [60.0, 0.0, -5.0], "hold_s": hold_s}, {"position": [60.0, 40.0, -5.0]}]
        with pytest.raises(ProtocolError, match=r"on the way: .* outside the fence's polygon"):
            await flight.submit(path={"waypoints": waypoints})

    fly(scenario, config=quick(polygon_ne_m=U_SHAPE))


@pytest.mark.parametrize("turns", [1.0, 300.0])
def test_a_shape_in_the_other_arm_of_the_fence_is_refused_however_many_its_turns(turns: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.result(await flight.goto(60.0, -5.0, -5.0))
        circle = {"kind": "circle", "center": [60.0, 47.0, -6.0], "radius_m": 4.0, "speed_m_s": 2.5, "turns": turns}
        with pytest.raises(ProtocolError, match=r"on the way: .* outside the fence's polygon"):
            await flight.submit(trajectory=circle)

    fly(scenario, config=quick(polygon_ne_m=U_SHAPE))


@pytest.mark.parametrize("turns", [1.0, 100.0])
def test_the_overshoot_towards_a_shape_is_refused_however_many_its_turns(turns: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.goto(49.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 43.0)
        circle = {"kind": "circle", "center": [0.0, 0.0, -6.0], "radius_m": 10.0, "speed_m_s": 2.0, "turns": turns}
        with pytest.raises(ProtocolError, match=r"on the way: .* outside the fence's radius"):
            await flight.submit(trajectory=circle, limits={"acceleration_m_s2": 0.8})

    fly(scenario, config={"safety": {"fence": {"radius_m": 50.0}}})
