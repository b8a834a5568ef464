"""A link that breaks both ways while the vehicle accelerates: what the vehicle does, and who has it afterwards."""

import asyncio
from math import degrees

import pytest
from support.flight import Flight, fly

from daemon import frames
from daemon.messages import FlightMode
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import Link, PilotTakesOver


async def _breaks(flight: Flight, duration_s: float) -> float:
    """The link breaks while the vehicle tilts towards its goal; returns when."""
    await flight.airborne(20.0)
    await flight.goto(40.0, 0.0, -20.0)
    since_s = flight.now_s
    await flight.until(lambda: flight.now_s - since_s >= 0.4)
    flight.px4.inject(Link(silent=True, duration_s=duration_s))
    return flight.now_s


@pytest.mark.parametrize("duration_s", [0.6, 0.7, 0.8, 0.9])
def test_a_vehicle_is_in_hold_a_tenth_after_a_break_of_less_than_a_second(duration_s: float) -> None:
    """The autopilot keeps the last rate through the break; from its end on nothing gets worse."""

    async def scenario(flight: Flight) -> None:
        begun_s = await _breaks(flight, duration_s)
        await flight.until(lambda: flight.now_s - begun_s >= duration_s)
        tilt_at_end_rad = frames.tilt_of(flight.px4.truth.attitude_wb)
        held_after_s = await flight.until(lambda: flight.px4.mode is FlightMode.HOLD, 1.0)
        assert held_after_s < 0.1
        tilt_rad = 0.0
        for _ in range(300):
            tilt_rad = max(tilt_rad, frames.tilt_of(flight.px4.truth.attitude_wb))
            await asyncio.sleep(0.01)
        assert degrees(tilt_rad) < max(degrees(tilt_at_end_rad), 35.0) + 5.0
        assert (flight.state, flight.px4.mode) == (State.READY, FlightMode.HOLD)
        assert {mode for time_s, mode in flight.asked if time_s >= begun_s} == {FlightMode.HOLD}
        assert flight.ended[-1].reason == "estimate_lost"

    fly(scenario, noise=True)


def test_a_pilot_who_takes_over_in_a_break_keeps_the_vehicle() -> None:
    async def scenario(flight: Flight) -> None:
        begun_s = await _breaks(flight, 1.0)
        await flight.until(lambda: flight.now_s - begun_s >= 0.85)
        flight.px4.inject(PilotTakesOver(mode="position"))
        await flight.until(lambda: flight.state not in OURS)
        await asyncio.sleep(1.0)
        assert (flight.state, flight.px4.mode) == (State.PILOT, FlightMode.POSITION)

    fly(scenario)


def test_a_long_break_is_told_as_one() -> None:
    async def scenario(flight: Flight) -> None:
        await _breaks(flight, 4.0)
        await flight.until(lambda: flight.state is State.DISCONNECTED)
        await flight.until(lambda: flight.state is State.FAULT)
        said = [record.supervision.reason for record in flight.records]
        assert list(dict.fromkeys(said))[-4:] == [
            "estimate_lost", "release_failed", "link_lost", "link_returned", "autopilot_failsafe",
        ][-4:]  # fmt: skip
        assert flight.ended[-1].reason == "estimate_lost"

    fly(scenario)


@pytest.mark.parametrize("silence_s", [0.25, 0.33, 0.41, 0.55])
def test_what_the_autopilot_does_is_known_soon_after_a_silence(silence_s: float) -> None:
    """PX4 tells its mode twice a second, and answers a request for CURRENT_MODE by "denied" while it is the same."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(Link(silent=True, duration_s=silence_s))
        await flight.until(lambda: not flight.autopilot.status.value.heard)
        await flight.until(lambda: not flight.px4.faults.active)
        assert await flight.until(lambda: flight.autopilot.status.value.heard) < 0.03

    fly(scenario)
