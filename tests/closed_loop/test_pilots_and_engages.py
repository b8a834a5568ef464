"""A pilot who chooses a mode while the daemon takes the vehicle: OFFBOARD does not come over it, or gives it back."""

import asyncio

import pytest
from support.flight import Flight, fly
from support.frozen import freeze

from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import Link, PilotTakesOver


async def _seen(flight: Flight, seconds: float) -> set[FlightMode]:
    """The modes that the autopilot flies from now on."""
    modes, until_s = set(), flight.now_s + seconds
    while flight.now_s < until_s:
        modes.add(flight.px4.mode)
        await asyncio.sleep(0.004)
    return modes


STILL = [(still_s, begins_s, "return") for still_s in (0.05, 0.15, 0.2, 0.29) for begins_s in (0.12, 0.19, 0.22, 0.25)]


@pytest.mark.parametrize("before_end_s", [0.004, 0.04])
@pytest.mark.parametrize(
    ("still_s", "begins_s", "mode"), [*STILL, *[(0.2, 0.19, mode) for mode in ("land", "position", "mission")]]
)
def test_a_mode_chosen_while_the_daemon_stood_still_is_not_replaced(
    still_s: float, begins_s: float, mode: str, before_end_s: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        engage = asyncio.ensure_future(flight.vehicle.commander.engage())
        await asyncio.sleep(begins_s)
        freeze(flight, still_s, then=lambda: flight.px4.inject(PilotTakesOver(mode=mode)), before_end_s=before_end_s)
        assert await _seen(flight, 1.0) == {FlightMode(mode)}
        assert (flight.state, engage.done()) == (State.PILOT, True)
        await asyncio.gather(engage, return_exceptions=True)

    fly(scenario)


@pytest.mark.parametrize(("delay_s", "loss", "within_s"), [(0.0, 0.0, 0.25), (0.045, 0.0, 0.46), (0.0, 0.3, 0.35)])
def test_the_proof_that_nobody_else_flies_costs_an_engage_a_round_trip(
    delay_s: float, loss: float, within_s: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(delay_s=delay_s, loss=loss))
        await asyncio.sleep(4.0)
        since_s = flight.now_s
        await flight.vehicle.commander.engage()
        assert next(time_s for time_s, mode in flight.asked if mode is FlightMode.OFFBOARD) - since_s < within_s

    fly(scenario)


@pytest.mark.parametrize(("mode", "ends_in"), [("return", "return"), ("land", "land"), ("position", "hold")])
def test_a_mode_that_came_and_went_between_two_ticks_is_given_back(mode: str, ends_in: str) -> None:
    """OFFBOARD comes over it on the way, while the daemon stands still."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(direction="up", delay_s=0.04))
        await asyncio.sleep(0.5)
        engage = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: any(asked is FlightMode.OFFBOARD for _, asked in flight.asked))
        freeze(flight, 0.1, then=lambda: flight.px4.inject(PilotTakesOver(mode=mode)), before_end_s=0.09)
        assert flight.px4.mode is FlightMode.OFFBOARD
        await asyncio.sleep(0.5)
        assert (flight.px4.mode, flight.state) == (FlightMode(ends_in), State.PILOT)
        await asyncio.gather(engage, return_exceptions=True)

    fly(scenario)
