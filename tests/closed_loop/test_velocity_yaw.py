"""`control.velocity_yaw`: the nose along the flight, in what is flown and in what is told of it."""

from math import atan2, cos, degrees, hypot, radians, sin
from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon import frames
from daemon.goals.methods import ReferenceSet

ON = {"control": {"velocity_yaw": True}}


def heading_deg(flight: Flight) -> float:
    return degrees(frames.yaw_of(flight.px4.truth.attitude_wb))


@pytest.mark.parametrize("profile", ["reference_filter", "jerk_limited"])
def test_a_waypoint_is_reached_heading_along_the_way_whatever_its_own_heading(profile: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        entry = await flight.result(await flight.goto(5.0, 5.0, -10.0, yaw_deg=-90.0), 30.0)
        assert entry.outcome == "succeeded"
        assert entry.error_deg is not None and entry.error_deg < 5.0
        assert heading_deg(flight) == pytest.approx(45.0, abs=5.0)
        reference, plan = flight.records[-1].reference, flight.vehicle.trajectory.plan.value
        assert reference is not None and plan is not None
        assert degrees(reference.yaw_rad) == pytest.approx(heading_deg(flight), abs=2.0)
        assert degrees(plan.target.yaw_rad) == pytest.approx(45.0, abs=1.0)

    fly(scenario, config={**ON, "guidance": {"profile": profile}})


def test_a_slow_filter_ends_in_the_heading_that_it_came_with() -> None:
    """Twenty seconds below the speed at which a direction means something."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        entry = await flight.result(await flight.goto(0.0, 8.0, -10.0), 60.0)
        assert entry.outcome == "succeeded"
        assert heading_deg(flight) == pytest.approx(90.0, abs=5.0)

    fly(scenario, config={**ON, "guidance": {"natural_frequency_rad_s": 0.3}})


@pytest.mark.parametrize("through", ["stop", "fly_by"])
def test_a_path_ends_along_its_last_velocity(through: str) -> None:
    corners: list[dict[str, Any]] = [{"position": [8, 0, -10], "yaw_deg": 180}, {"position": [8, -8, -10]}]

    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        goal_id = await flight.submit(path={"waypoints": corners, "through": through})
        assert (await flight.result(goal_id, 60.0)).outcome == "succeeded"
        flown = [r.reference.velocity_ned_m_s for r in flight.records if r.reference is not None]
        north, east, _ = next(v for v in reversed(flown) if hypot(v[0], v[1]) > 0.5)
        assert heading_deg(flight) == pytest.approx(degrees(atan2(east, north)), abs=5.0)
        assert east < 0.0

    fly(scenario, config=ON)


def test_a_mere_turn_is_still_flown_where_headings_follow_the_velocity() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        assert (await flight.result(await flight.goto(0.0, -4.0, -10.0, yaw_deg=0.0))).outcome == "succeeded"
        assert heading_deg(flight) == pytest.approx(-90.0, abs=5.0)
        turn = await flight.submit(waypoint={"mode": "only_orientation", "yaw_deg": 30.0})
        assert (await flight.result(turn)).outcome == "succeeded"
        assert heading_deg(flight) == pytest.approx(30.0, abs=6.0)

    fly(scenario, config=ON)


def test_a_stream_is_flown_along_its_velocity() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        goal_id = await flight.submit(stream={"timeout_s": 0.5})
        since = flight.now_s
        while flight.now_s - since < 8.0:
            t = flight.now_s - since
            params = ReferenceSet(
                goal_id=goal_id,
                position=(6.0 * sin(0.4 * t), 6.0 - 6.0 * cos(0.4 * t), -10.0),
                velocity=(2.4 * cos(0.4 * t), 2.4 * sin(0.4 * t), 0.0),
                yaw_deg=180.0,
            )
            flight.service.reference_set(params, CALLER)
            await flight.until(lambda then=flight.now_s: flight.now_s - then > 0.03)
        off = frames.wrap_pi(radians(heading_deg(flight)) - 0.4 * t)
        assert degrees(off) == pytest.approx(0.0, abs=10.0)

    fly(scenario, config=ON)
