"""Goals and settings that are well-formed and could not be flown, or would hold up the loop that flies: refused."""

from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import ConfigSet
from daemon.goals.protocol import Refusal, interpret

AHEAD = {"position": [40, 0, -5]}
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"waypoint": AHEAD, "limits": {"speed_m_s": 1e-6}}, "limits.speed_m_s"),
    ({"waypoint": AHEAD, "limits": {"acceleration_m_s2": 1e-6}}, "limits.acceleration_m_s2"),
    ({"waypoint": AHEAD, "limits": {"jerk_m_s3": 1e-6}}, "limits.jerk_m_s3"),
    ({"waypoint": AHEAD, "limits": {"yaw_rate_deg_s": 1e-6}}, "limits.yaw_rate_deg_s"),
    ({"stream": {"timeout_s": 3600}}, "stream.timeout_s"),
    (
        {"path": {"waypoints": [{**AHEAD, "hold_s": 3600}, {"position": [0, 0, -5], "hold_s": 3600}] * 2}},
        "path.waypoints",
    ),
]


def test_goals_that_take_for_ever_are_refused_by_their_field_and_the_flight_goes_on() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(20.0, 0.0, -5.0)
        for goal, field in REFUSED:
            with pytest.raises(ProtocolError) as error:
                await flight.submit(**goal)
            assert (error.value.code, error.value.field) == (ErrorCode.REFUSED, field)
        assert (await flight.result(goal_id)).outcome == "succeeded"

    fly(scenario)


@pytest.mark.parametrize(("path", "value"), [("control.thrust_max", 0.3), ("control.thrust_min", 0.5)])
def test_thrust_that_cannot_hover_is_refused_in_flight(path: str, value: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        with pytest.raises(ProtocolError, match="hovers") as error:
            await flight.service.config_set(ConfigSet(path=path, value=value), CALLER)
        assert error.value.code is ErrorCode.REFUSED
        assert (await flight.result(await flight.goto(5.0, 0.0, -6.0))).outcome == "succeeded"

    fly(scenario)


def test_thrust_is_held_against_what_the_vehicle_was_learned_to_hover_with() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.until(lambda since_s=flight.now_s: flight.now_s - since_s > 20.0)
        learned = flight.vehicle.control.state.control.model.hover_thrust
        assert learned > 0.55
        with pytest.raises(ProtocolError, match="hovers"):
            await flight.service.config_set(ConfigSet(path="control.thrust_max", value=1.05 * learned), CALLER)

    fly(scenario, airframe="x500")


@pytest.mark.parametrize("orientation", [[0, 0, 0, 0], [1e300, 0, 0, 0], [2, 0, 0, 0]])
def test_a_pose_from_outside_that_is_no_rotation_is_refused_by_its_field(orientation: list[float]) -> None:
    pose = {"position": [0, 0, -5], "orientation": orientation}
    found = interpret({"jsonrpc": "2.0", "method": "estimator.pose", "params": pose}, operator=True)
    assert isinstance(found, Refusal)
    assert (found.error.code, found.error.field) == (ErrorCode.REFUSED, "orientation")
