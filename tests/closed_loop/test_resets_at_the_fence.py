"""A fence about the origin of the local frame: a mere change of numbers moves it, the return of the truth does not."""

import asyncio
from math import dist

import pytest
from support.flight import Flight, fly

from daemon.messages import Vec3
from daemon.sim.faults import EkfReset, GpsLoss, PilotTakesOver, StoppedTelemetry

CONFIG = {"safety": {"fence": {"anchor": "origin", "radius_m": 150.0}}}
ORIGIN = (0.0, 0.0, 0.0)


def estimated(flight: Flight) -> Vec3:
    newest = flight.records[-1].estimate.newest
    assert newest is not None
    return newest.position_ned_m


def test_a_reset_of_a_trusted_position_takes_the_fence_along() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        flight.px4.inject(EkfReset(kind="position_ne", size_m=3.0))
        await asyncio.sleep(1.0)
        assert flight.vehicle.fence.anchor_ned_m == pytest.approx((3.0, 0.0, 0.0), abs=0.3)

    fly(scenario, config=CONFIG)


def test_the_truth_after_a_lost_gps_finds_the_fence_about_the_origin() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        flight.px4.inject(GpsLoss())
        await asyncio.sleep(20.0)
        assert dist(estimated(flight), flight.position) > 10.0
        flight.px4.faults.clear()
        await asyncio.sleep(3.0)
        assert dist(estimated(flight), flight.position) < 3.0
        assert flight.vehicle.fence.anchor_ned_m == pytest.approx(ORIGIN, abs=0.5)

    fly(scenario, seed=3, noise=True, config=CONFIG)


@pytest.mark.parametrize("reset", [EkfReset(kind="heading", size_deg=3.0), EkfReset(kind="position_ne", size_m=0.5)])
def test_a_flight_in_a_silence_with_a_reset_leaves_the_fence_about_the_origin(reset: EkfReset) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        flight.px4.inject(PilotTakesOver(mode="position", forward=1.0))
        await asyncio.sleep(0.5)
        flight.px4.inject(StoppedTelemetry())
        before = flight.position
        await asyncio.sleep(3.0)
        flight.px4.inject(reset)
        await asyncio.sleep(7.0)
        flight.px4.faults.clear()
        await asyncio.sleep(1.0)
        assert dist(before, flight.position) > 50.0
        assert flight.vehicle.fence.anchor_ned_m == pytest.approx(ORIGIN, abs=1e-9)

    fly(scenario, config=CONFIG)
