"""A command that was never acknowledged is sent again, but not to a vehicle that somebody else has asked or taken."""

import asyncio

import pytest
from support.flight import Flight, fly

from daemon.autopilot.px4 import Fields
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState
from daemon.safety.supervisor import State
from daemon.sim.faults import NoAcks, PilotTakesOver

TAKEOFF_COMMAND = 22


def _takeoffs(flight: Flight) -> list[float]:
    """The times, to come, at which the vehicle is told to take off."""
    times: list[float] = []
    receive = flight.px4.receive

    def received(name: str, fields: Fields, **sender: int) -> None:
        if name == "COMMAND_LONG" and fields["command"] == TAKEOFF_COMMAND:
            times.append(flight.now_s)
        receive(name, fields, **sender)

    flight.px4.receive = received  # type: ignore[method-assign]
    return times


async def _takes_off_unheard(flight: Flight) -> "asyncio.Task[None]":
    """A take-off whose command takes effect, and is not acknowledged."""
    await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
    takeoff = asyncio.ensure_future(flight.vehicle.commander.takeoff(10.0))
    await flight.until(lambda: flight.autopilot.status.value.armed)
    flight.px4.inject(NoAcks())
    await flight.until(lambda: flight.autopilot.status.value.landed is not LandedState.ON_GROUND)
    assert flight.state is State.TAKING_OFF
    return takeoff


@pytest.mark.parametrize(("request_name", "mode"), [("hold", FlightMode.HOLD), ("land", FlightMode.LAND)])
def test_a_take_off_that_was_superseded_is_not_sent_again(request_name: str, mode: FlightMode) -> None:
    async def scenario(flight: Flight) -> None:
        times = _takeoffs(flight)
        takeoff = await _takes_off_unheard(flight)
        assert not takeoff.done()
        newer, since_s = asyncio.ensure_future(getattr(flight.vehicle.commander, request_name)()), flight.now_s
        await flight.until(lambda: flight.px4.mode is mode, 0.5)
        assert takeoff.done()
        with pytest.raises(NotPossibleError, match="superseded"):
            await takeoff
        await asyncio.sleep(2.5)
        assert flight.px4.mode is mode
        assert max(times) < since_s
        newer.cancel()

    fly(scenario)


def test_a_pilot_who_takes_over_is_not_told_to_take_off_again() -> None:
    async def scenario(flight: Flight) -> None:
        times = _takeoffs(flight)
        takeoff = await _takes_off_unheard(flight)
        flight.px4.inject(PilotTakesOver(mode="position"))
        since_s = flight.now_s
        await asyncio.sleep(2.5)
        assert flight.px4.mode is FlightMode.POSITION
        assert max(times) < since_s
        await asyncio.gather(takeoff, return_exceptions=True)

    fly(scenario)


def test_a_take_off_that_shows_needs_no_acknowledgement() -> None:
    async def scenario(flight: Flight) -> None:
        times = _takeoffs(flight)
        await (await _takes_off_unheard(flight))
        assert flight.state is State.READY
        assert len(times) == 1

    fly(scenario)
