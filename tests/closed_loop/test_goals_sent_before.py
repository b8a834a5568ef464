"""A goal that was sent before the vehicle was given away never takes it back; only one that is sent after may."""

import asyncio

import pytest
from support.flight import Flight, fly
from support.wire import Wire, slow_planner

from daemon.goals.errors import ErrorCode
from daemon.messages import FlightMode
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import PilotTakesOver

PATH = {"path": {"waypoints": [{"position": [5, 0, -5]}, {"position": [5, 5, -5]}], "through": "fly_by"}}
NEAR = {"waypoint": {"position": [1, 0, -5]}}


async def _stays_with_the_autopilot(flight: Flight) -> None:
    count = len(flight.sent)
    await asyncio.sleep(5.0)
    assert flight.state not in OURS
    assert flight.px4.mode is FlightMode.HOLD
    assert len(flight.sent) == count


@pytest.mark.parametrize("engaged", [True, False])
@pytest.mark.parametrize("clients", [1, 2])
def test_goals_that_wait_while_a_hold_is_asked_for_are_refused(engaged: bool, clients: int) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=engaged)
        slow_planner(0.3)
        first = Wire(flight)
        second = first if clients == 1 else Wire(flight, first.dispatcher)
        first.ask(("one", "goal.submit", PATH), ("two", "goal.submit", PATH), ("three", "goal.submit", NEAR))
        second.ask(("hold", "vehicle.hold", {}))
        assert (await second.reply("hold"))["result"]["state"] == "ready"
        for waiting in ("one", "two", "three"):
            error = (await first.reply(waiting))["error"]
            assert error["code"] == ErrorCode.WRONG_STATE
            assert "released while the goal" in error["message"]
        await _stays_with_the_autopilot(flight)

    fly(scenario)


def test_a_goal_sent_right_after_a_hold_in_hold_is_flown() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        client = Wire(flight)
        client.ask(("hold", "vehicle.hold", {}))
        await client.reply("hold")
        client.ask(("goal", "goal.submit", NEAR))
        accepted = await client.reply("goal")
        assert (await flight.result(accepted["result"]["goal_id"])).outcome == "succeeded"

    fly(scenario)


@pytest.mark.parametrize("by", ["pilot", "hold"])
def test_goals_that_wait_while_the_vehicle_changes_hands_are_refused(by: str) -> None:
    """Also when it is back in Hold, and may be engaged again, by the time they are looked at."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        slow_planner(6.0)
        client = Wire(flight)
        client.ask(("one", "goal.submit", PATH), ("two", "goal.submit", NEAR))
        await asyncio.sleep(1.0)
        if by == "pilot":
            flight.px4.inject(PilotTakesOver(mode="mission"))
            await flight.until(lambda: flight.state is State.PILOT, 1.0)
        other = Wire(flight, client.dispatcher)
        other.ask(("hold", "vehicle.hold", {}))
        assert (await other.reply("hold"))["result"]["state"] == "ready"
        assert "released while" in (await client.reply("two"))["error"]["message"]
        await _stays_with_the_autopilot(flight)

    fly(scenario)


def test_a_batch_may_hold_and_then_submit_but_not_after_somebody_elses_hold() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        client = Wire(flight)
        client.ask(("hold", "vehicle.hold", {}), ("goal", "goal.submit", NEAR), batch=True)
        accepted = await client.reply("goal")
        await flight.result(accepted["result"]["goal_id"])
        slow_planner(1.0)
        again = ("hold", "vehicle.hold", {}), ("three", "goal.submit", NEAR)
        engage = ("engage", "vehicle.engage", {})
        client.ask(("one", "goal.submit", PATH), ("two", "goal.submit", NEAR), engage, *again, batch=True)
        await asyncio.sleep(0.5)
        other = Wire(flight, client.dispatcher)
        other.ask(("other", "vehicle.hold", {}))
        for refused in ("two", "engage", "three"):
            assert "released while" in (await client.reply(refused))["error"]["message"]
        await other.reply("other")
        await _stays_with_the_autopilot(flight)

    fly(scenario)


@pytest.mark.parametrize("request_name", ["land", "return"])
def test_an_engage_or_a_goal_right_after_a_landing_is_refused_and_the_landing_goes_on(request_name: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0)
        client = Wire(flight)
        client.ask(
            (request_name, f"vehicle.{request_name}", {}),
            ("goal", "goal.submit", NEAR),
            ("engage", "vehicle.engage", {}),
        )
        for refused in ("goal", "engage"):
            error = (await client.reply(refused))["error"]
            assert error["code"] == ErrorCode.WRONG_STATE
            assert f"{request_name} was asked for and may still come" in error["message"]
        done = (await client.reply(request_name, 600.0))["result"]
        assert (done["state"], done["mode"]) == ("standby", "offboard")
        assert flight.ended == []

    fly(scenario)


def test_an_engage_while_the_landing_of_an_engage_is_unread_is_refused() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0, engage=False)
        client = Wire(flight)
        client.ask(("engage", "vehicle.engage", {}))
        await flight.until(lambda: flight.state is State.ENGAGING, 1.0)
        client.ask(("land", "vehicle.land", {}), ("again", "vehicle.engage", {}))
        assert "superseded" in (await client.reply("engage"))["error"]["message"]
        assert "land was asked for" in (await client.reply("again"))["error"]["message"]
        assert (await client.reply("land"))["result"]["state"] == "standby"

    fly(scenario)
