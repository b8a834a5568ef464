"""What ends inside of the fence although it is flown along it: goals that are stopped, streams that fall silent."""

from math import hypot
from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ProtocolError
from daemon.goals.methods import ReferenceSet
from daemon.safety.supervisor import State

CIRCLE = {"kind": "circle", "center": [0.0, 0.0, -5.0], "radius_m": 26.0, "speed_m_s": 5.0, "turns": 3.0}


def within(radius_m: float, **limits: float) -> dict[str, Any]:
    return {"safety": {"fence": {"radius_m": radius_m}}, "guidance": {"limits": limits}}


async def around(flight: Flight, **more: Any) -> str:
    await flight.airborne()
    goal_id = await flight.submit(trajectory=CIRCLE, **more)
    await flight.until(lambda: hypot(*flight.position[:2]) > 25.5, 200.0)
    await flight.until(lambda: hypot(*flight.px4.truth.velocity_ned_m_s[:2]) > 4.9, 200.0)
    return goal_id


@pytest.mark.parametrize("how", ["cancel", "abort"])
def test_a_goal_that_is_stopped_beside_the_fence_comes_to_rest_inside(how: str) -> None:
    async def scenario(flight: Flight) -> None:
        goal_id = await around(flight)
        seen = len(flight.truths)
        if how == "cancel":
            flight.vehicle.trajectory.cancel()
        else:
            flight.vehicle.trajectory.abort(goal_id, "timeout")
        since_s = flight.now_s
        entry = await flight.result(goal_id)
        assert (entry.outcome, entry.reason) == (("canceled", None) if how == "cancel" else ("aborted", "timeout"))
        await flight.until(lambda: flight.now_s - since_s > 20.0)
        assert flight.state is State.HOLDING
        assert hypot(*flight.px4.truth.velocity_ned_m_s) < 0.3
        assert max(hypot(*truth[:2]) for truth in flight.truths[seen:]) < 26.5

    fly(scenario, config=within(26.5, acceleration_m_s2=1.0))


@pytest.mark.parametrize("profile", ["reference_filter", "jerk_limited"])
def test_a_trajectory_task_that_stalls_beside_the_fence_leaves_a_vehicle_that_rests_inside(profile: str) -> None:
    async def scenario(flight: Flight) -> None:
        await around(flight)
        seen = len(flight.truths)
        flight.vehicle.trajectory.tick = lambda _now_s: None  # type: ignore[method-assign]
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 20.0)
        assert hypot(*flight.px4.truth.velocity_ned_m_s) < 0.3
        assert flight.state is State.TRACKING
        assert max(hypot(*truth[:2]) for truth in flight.truths[seen:]) < 26.5

    config = within(26.5, acceleration_m_s2=1.0)
    config["guidance"]["profile"] = profile
    fly(scenario, config=config)


def test_a_stream_goal_whose_first_brake_leaves_the_fence_is_refused() -> None:
    async def scenario(flight: Flight) -> None:
        goal_id = await around(flight)
        with pytest.raises(ProtocolError, match="outside the fence"):
            await flight.submit(stream={"timeout_s": 0.5})
        assert flight.vehicle.trajectory.goal_id == goal_id

    fly(scenario, config=within(26.5, acceleration_m_s2=1.0))


@pytest.mark.parametrize(("speed_m_s", "timeout_s"), [(5.0, 0.5), (10.0, 2.0)])
def test_a_stream_that_could_not_be_braked_inside_is_refused_and_stops_inside(
    speed_m_s: float, timeout_s: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(stream={"timeout_s": timeout_s})
        begun_s, north_m, refused = flight.now_s, 0.0, list[str | None]()
        while north_m < 59.9:
            before_s = flight.now_s
            await flight.until(lambda last_s=before_s: flight.now_s >= last_s + 0.05)  # type: ignore[misc]
            speed = min(speed_m_s, 2.0 * (flight.now_s - begun_s))
            north_m += speed * (flight.now_s - before_s)
            if flight.vehicle.trajectory.goal_id is None:
                break
            given = {"goal_id": goal_id, "position": [north_m, 0.0, -5.0], "velocity": [speed, 0.0, 0.0]}
            try:
                flight.service.reference_set(ReferenceSet.model_validate(given), CALLER)
            except ProtocolError as error:
                refused.append(error.field)
        entry = await flight.result(goal_id)
        assert (entry.outcome, entry.reason) == ("aborted", "stream_timeout")
        assert refused and set(refused) == {"position[0]"}
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 10.0)
        assert flight.state is State.HOLDING
        assert 40.0 < max(truth[0] for truth in flight.truths) < 60.0

    fly(scenario, config=within(60.0, speed_m_s=speed_m_s))
