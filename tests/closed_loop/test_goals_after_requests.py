"""A goal that comes to a vehicle in Hold just after, or just before, a request for another mode: that is done."""

import asyncio

import pytest
from support.flight import Flight, fly

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.messages import FlightMode
from daemon.safety.supervisor import FLYING, State
from daemon.sim.faults import Link, ModesRefused, PilotTakesOver

MODES = {"land": FlightMode.LAND, "return_home": FlightMode.RETURN}


@pytest.mark.parametrize("after_s", [0.0, 0.005, 0.011, 0.05])
@pytest.mark.parametrize("request_name", MODES)
def test_a_goal_that_comes_before_the_mode_shows_is_refused_and_the_mode_is_flown(
    request_name: str, after_s: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(30.0, engage=False)
        flight.px4.inject(Link(delay_s=0.03))
        request = asyncio.ensure_future(getattr(flight.vehicle.commander, request_name)())
        await asyncio.sleep(after_s)
        mode = MODES[request_name]
        assert flight.autopilot.status.value.mode is FlightMode.HOLD
        with pytest.raises(ProtocolError, match=f"{mode.value} was asked for") as error:
            await flight.goto(20.0, 0.0, -30.0)
        assert error.value.code is ErrorCode.WRONG_STATE
        await flight.until(lambda: flight.state is State.LANDING, 1.0)
        await asyncio.sleep(1.0)
        assert flight.px4.mode is mode
        assert not request.done()
        assert (flight.sent, flight.ended) == ([], [])
        request.cancel()

    fly(scenario)


def test_a_landing_that_is_asked_for_before_the_goals_engage_is_read_ends_the_goal() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(30.0, engage=False)
        landing = asyncio.ensure_future(flight.vehicle.commander.land())  # begins when the goal was taken
        goal_id = await flight.goto(20.0, 0.0, -30.0)
        entry = await flight.result(goal_id, 1.0)
        assert (entry.outcome, entry.reason) == ("canceled", "vehicle.land")
        await flight.until(lambda: flight.px4.mode is FlightMode.LAND, 0.2)
        assert flight.sent == []
        landing.cancel()

    fly(scenario)


def test_a_goal_may_come_once_the_autopilot_has_refused_the_mode() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(ModesRefused(modes=("land",)))
        landing = asyncio.ensure_future(flight.vehicle.commander.land())
        await flight.until(lambda: flight.autopilot.status.value.mode_refusal is not None, 0.5)
        goal_id = await flight.goto(3.0, 0.0, -5.0)
        assert (await flight.result(goal_id)).outcome == "succeeded"
        assert flight.state in FLYING
        await asyncio.gather(landing, return_exceptions=True)

    fly(scenario)


def test_a_goal_may_come_with_the_reply_to_a_hold_in_hold() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        await flight.vehicle.commander.hold()
        goal_id = await flight.goto(3.0, 0.0, -5.0)
        assert (await flight.result(goal_id)).outcome == "succeeded"

    fly(scenario)


def test_a_hold_in_the_tick_of_a_goals_acceptance_ends_it_as_canceled() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        goal_id = await flight.goto(1.0, 0.0, -5.0)  # without a tick after it: the hold replaces the engage unread
        await flight.vehicle.commander.hold()
        entry = await flight.result(goal_id, 2.0)
        assert (entry.outcome, entry.reason) == ("canceled", "vehicle.hold")
        await asyncio.sleep(3.0)
        assert flight.px4.mode is FlightMode.HOLD
        assert flight.sent == []

    fly(scenario)


@pytest.mark.parametrize("wait_s", [1.0, 1.02, 1.04, 1.06, 1.08])
def test_a_goal_may_come_as_soon_as_a_landing_is_ended_by_hold(wait_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(15.0)
        flight.px4.inject(PilotTakesOver(mode="land"))
        await asyncio.sleep(wait_s)
        assert flight.state is State.PILOT
        await flight.vehicle.commander.hold()
        entry = await flight.result(await flight.goto(5.0, 0.0, -15.0))
        assert entry.outcome == "succeeded"

    fly(scenario)
