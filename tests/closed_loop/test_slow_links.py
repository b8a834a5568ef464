"""A link that becomes slow in flight: the vehicle is given to the autopilot before the law swings it."""

import asyncio
from math import degrees

import pytest
from support.flight import CALLER, Flight, fly

from daemon.frames import tilt_of
from daemon.goals.methods import NoParams
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import Link

HEIGHT_M = 10.0


async def _watched(flight: Flight, seconds: float) -> tuple[float, float]:
    """The largest true tilt in degrees and the least height in metres."""
    tilt_deg, height_m = 0.0, HEIGHT_M
    for _ in range(round(seconds / 0.02)):
        await asyncio.sleep(0.02)
        tilt_deg = max(tilt_deg, degrees(tilt_of(flight.px4.truth.attitude_wb)))
        height_m = min(height_m, -flight.position[2])
    return tilt_deg, height_m


def _struck(*faults: Link, seconds: float = 8.0, seed: int = 1) -> tuple[float, float, State, str, FlightMode]:
    """A hover that these meet: tilt, least height, and what the flight ends in."""

    async def scenario(flight: Flight) -> tuple[float, float, State, str, FlightMode]:
        await flight.airborne(HEIGHT_M)
        await asyncio.sleep(3.0)
        for fault in faults:
            flight.px4.inject(fault)
        tilt_deg, height_m = await _watched(flight, seconds)
        left = flight.records[-1].supervision.left
        return tilt_deg, height_m, flight.state, left, flight.px4.mode

    return fly(scenario, noise=True, seed=seed)


@pytest.mark.parametrize("delay_s", [0.12, 0.2, 0.3, 0.45])
@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_link_that_becomes_slow_gives_the_vehicle_to_hold_before_it_swings(direction: str, delay_s: float) -> None:
    """Flown on, it was on the ground within 9 s from 0.3 s on, and leaned by 60 degrees at 0.2 s."""
    tilt_deg, height_m, *ends = _struck(Link(direction=direction, delay_s=delay_s))
    assert ends == [State.READY, "link_slow", FlightMode.HOLD]
    assert tilt_deg < 20.0
    assert height_m > HEIGHT_M - 1.5


@pytest.mark.parametrize("delay_s", [0.06, 0.15, 0.3])
def test_the_way_up_and_down_count_together(delay_s: float) -> None:
    tilt_deg, height_m, *ends = _struck(Link(delay_s=delay_s))
    assert ends == [State.READY, "link_slow", FlightMode.HOLD]
    assert tilt_deg < 20.0
    assert height_m > HEIGHT_M - 1.5


def test_hold_that_takes_a_slow_links_time_to_show_is_not_followed_by_land() -> None:
    async def scenario(flight: Flight) -> set[FlightMode]:
        await flight.airborne(HEIGHT_M)
        flight.px4.inject(Link(direction="up", delay_s=0.45))
        await _watched(flight, 6.0)
        return {mode for _, mode in flight.asked if mode is not FlightMode.OFFBOARD}

    assert fly(scenario) == {FlightMode.HOLD}


@pytest.mark.parametrize(
    "fault",
    [Link(jitter_s=0.045), Link(loss=0.4), Link(delay_s=0.04), Link(delay_s=0.2, duration_s=0.2)],
    ids=["jitter", "loss", "a little", "for a moment"],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_link_that_can_be_flown_by_takes_nothing_away(fault: Link, seed: int) -> None:
    tilt_deg, _, *ends = _struck(fault, seed=seed)
    assert ends == [State.HOLDING, "", FlightMode.OFFBOARD]
    assert tilt_deg < 30.0


def test_who_configures_the_latency_may_allow_it() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(HEIGHT_M, engage=False)
        flight.px4.inject(Link(direction="up", delay_s=0.12))
        await asyncio.sleep(3.0)
        await flight.vehicle.commander.engage()
        entry = await flight.result(await flight.goto(10.0, 0.0, -HEIGHT_M))
        assert entry.outcome == "succeeded"
        assert flight.state is State.HOLDING

    fly(scenario, config={"loops": {"command_latency_s": 0.14}, "link": {"round_trip_max_s": 0.2}})


def test_the_status_tells_what_the_link_takes() -> None:
    async def scenario(flight: Flight) -> float | None:
        await flight.airborne(HEIGHT_M)
        flight.px4.inject(Link(delay_s=0.03))
        await asyncio.sleep(1.0)
        status = await flight.service.status_get(NoParams(), CALLER)
        return status["autopilot"]["round_trip_ms"]

    assert fly(scenario) == pytest.approx(64.0, abs=5.0)
