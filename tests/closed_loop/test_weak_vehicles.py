"""Vehicles that hover near the end of their thrust: height is held with all of it."""

import asyncio
from math import hypot
from typing import Any

import pytest
import yaml
from support.flight import Flight, fly

from daemon.config import default_path
from daemon.safety.supervisor import State
from daemon.sim.faults_vehicle import SteadyWind


def x500() -> dict[str, Any]:
    config: dict[str, Any] = yaml.safe_load(default_path().with_name("x500.yaml").read_text())
    return config


@pytest.mark.parametrize("wind_m_s", [0.0, 8.0])
def test_a_load_that_takes_nine_tenths_of_the_thrust_is_held_where_the_autopilot_held_it(wind_m_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        flight.px4.payload_kg = 0.8
        await flight.airborne(20.0, engage=False)
        await asyncio.sleep(8.0)
        height_m = -flight.position[2]
        await flight.vehicle.commander.engage()
        flight.px4.inject(SteadyWind(north_m_s=wind_m_s))
        since = len(flight.truths)
        await asyncio.sleep(20.0)
        assert flight.state is State.HOLDING
        assert flight.records[-1].setpoint.thrust > 0.895  # type: ignore[union-attr]
        flown = flight.truths[since:]
        assert max(abs(-down - height_m) for _, _, down in flown) < 0.5
        assert max(hypot(north, east) for north, east, _ in flown) < 0.5

    fly(scenario, airframe="x500", config=x500())


def test_a_vehicle_that_cannot_stop_its_descent_in_time_does_not_drift_away_meanwhile() -> None:
    async def scenario(flight: Flight) -> None:
        flight.px4.payload_kg = 0.8
        await flight.airborne(20.0)
        goal_id = await flight.goto(10.0, 0.0, -15.0)
        await flight.result(goal_id)
        await asyncio.sleep(10.0)
        assert max(north for north, _, _ in flight.truths) < 12.0
        assert flight.position == pytest.approx((10.0, 0.0, -15.0), abs=0.1)

    fly(scenario, airframe="x500", config=x500())
