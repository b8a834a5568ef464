"""Vehicles that hover near an end of their thrust: it is all used for height; where it is too little, that is told."""

import asyncio
from dataclasses import replace
from math import hypot
from typing import Any

import pytest
import yaml
from support.flight import CALLER, Flight, fly

from daemon.config import default_path
from daemon.goals.errors import ProtocolError
from daemon.goals.methods import ConfigSet
from daemon.loops.turns import NotPossibleError
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.airframe_files import load as load_airframe
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
        assert flight.position[2] < -13.0, "it is kept in the air, by the autopilot's Hold when it sinks too far"

    fly(scenario, airframe="x500", config=x500())


async def set_to(flight: Flight, path: str, value: float) -> None:
    await flight.service.config_set(ConfigSet(path=path, value=value), CALLER)


def warnings(flight: Flight) -> dict[str, str]:
    return {reason["code"]: reason["text"] for reason in Reports(flight.vehicle).status()["reasons"]}


@pytest.mark.parametrize(
    ("key", "wrong", "right", "hover_thrust", "rotor_max_thrust_n"),
    [("thrust_max", 0.70, 0.95, 0.72, 3.4), ("thrust_min", 0.30, 0.08, 0.30, 8.2)],
)
def test_a_hover_thrust_outside_the_thrust_limits_is_told_and_the_vehicle_not_taken_until_they_leave_room(
    monkeypatch: pytest.MonkeyPatch,
    key: str,
    wrong: float,
    right: float,
    hover_thrust: float,
    rotor_max_thrust_n: float,
) -> None:
    airframe = replace(load_airframe("sih"), rotor_max_thrust_n=rotor_max_thrust_n)
    monkeypatch.setattr("support.flight.load_airframe", lambda _: airframe)

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        reason = f"{key} {wrong:g}.* leaves less than a tenth about the {hover_thrust:.2f}"
        assert warnings(flight)["thrust_room"].startswith("thrust_min")
        with pytest.raises(NotPossibleError, match=reason):
            await flight.vehicle.commander.engage()
        with pytest.raises(ProtocolError, match=reason):
            await flight.goto(3.0, 0.0, -5.0)
        await set_to(flight, f"control.{key}", right)
        await set_to(flight, "guidance.limits.vertical_acceleration_m_s2", 1.0)
        await asyncio.sleep(1.0)
        assert "thrust_room" not in warnings(flight)
        height_m = -flight.position[2]
        await flight.vehicle.commander.engage()
        await asyncio.sleep(5.0)
        assert -flight.position[2] == pytest.approx(height_m, abs=0.2)

    fly(scenario, config={"control": {key: wrong}}, parameters={"MPC_THR_HOVER": hover_thrust})


def test_a_loaded_vehicle_in_flight_takes_every_setting_but_what_leaves_it_less_thrust() -> None:
    async def scenario(flight: Flight) -> None:
        flight.px4.payload_kg = 0.8
        await flight.airborne(20.0)
        await asyncio.sleep(20.0)
        assert flight.vehicle.control.state.control.hover_thrust > 0.88
        await set_to(flight, "guidance.limits.speed_m_s", 1.0)
        with pytest.raises(ProtocolError, match="leaves less than a tenth"):
            await set_to(flight, "control.thrust_max", 0.9)
        await set_to(flight, "control.thrust_max", 1.0)

    fly(scenario, airframe="x500", config=x500())
