"""The health task: the watchdog is fed while both tasks tick, slipping grids are told."""

from dataclasses import replace
from itertools import pairwise
from math import dist

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ProtocolError
from daemon.goals.methods import NoParams
from daemon.messages import GlobalPosition, Vec3
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.fault import Fault
from daemon.sim.faults import BatteryLow, EkfReset, Link, StoppedTelemetry

HERE = GlobalPosition(47.4, 8.5, 490.0)
NORTH_OF_HERE = GlobalPosition(47.4001, 8.5, 492.0)


async def standing_by(flight: Flight) -> None:
    await flight.until(lambda: flight.state is State.STANDBY and flight.now_s > 3.0)


async def later(flight: Flight, seconds: float) -> None:
    since_s = flight.now_s
    await flight.until(lambda: flight.now_s - since_s >= seconds)


@pytest.mark.parametrize("stopped", ["control", "trajectory"])
def test_the_watchdog_is_fed_five_times_a_second_until_one_task_stops(
    stopped: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr("daemon.loops.health_task.notify", said.append)

    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        said.clear()
        await later(flight, 2.0)
        assert said == ["WATCHDOG=1"] * 10
        getattr(flight.vehicle, stopped).grid._alarm.set(1e9, lambda: None)
        await later(flight, 0.3)
        said.clear()
        await later(flight, 2.0)
        assert said == []

    fly(scenario)


def test_systemd_is_told_each_state_once(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("daemon.loops.health_task.notify", said.append)

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await later(flight, 1.0)

    fly(scenario)
    told = [text for text in said if text.startswith("STATUS=")]
    assert told[0] == "STATUS=standby: the autopilot is connected, the vehicle is on the ground"
    assert told[-1] == "STATUS=holding: the vehicle is under the daemon's control"
    assert "STATUS=taking_off" in [text.partition(":")[0] for text in told]
    assert all(before != after for before, after in pairwise(told))


def test_a_grid_that_slips_is_told_until_it_no_longer_does() -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        statistics = flight.vehicle.control.grid.statistics
        await later(flight, 5.0)
        assert "control_slips" not in flight.vehicle.health.warnings
        statistics.missed += 11
        await later(flight, 5.0)
        assert "11 ticks" in flight.vehicle.health.warnings["control_slips"]
        await later(flight, 5.0)
        assert "control_slips" not in flight.vehicle.health.warnings

    fly(scenario)


def test_a_warning_of_others_stands_in_the_status_as_long_as_it_holds() -> None:
    async def scenario(flight: Flight) -> None:
        flight.vehicle.health.asked["recording"] = lambda: "no flight record" if flight.now_s < 4.0 else None
        await standing_by(flight)
        told = {"code": "recording", "text": "no flight record"}
        assert told in (await flight.service.status_get(NoParams(), CALLER))["reasons"]
        await later(flight, 2.0)
        assert told not in (await flight.service.status_get(NoParams(), CALLER))["reasons"]

    fly(scenario)


@pytest.mark.parametrize("end", [None, Link(silent=True)], ids=["it recovers", "the link is lost"])
def test_a_stream_that_comes_too_seldom_is_told_until(end: Fault | None) -> None:
    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        assert "slow_streams" not in flight.vehicle.health.warnings
        flight.px4.inject(StoppedTelemetry(messages=("HIGHRES_IMU",)))
        await later(flight, 4.5)
        told = {reason["code"]: reason["text"] for reason in Reports(flight.vehicle).reasons("goal")}
        assert told["slow_streams"].startswith("HIGHRES_IMU of the autopilot")
        flight.px4.faults.clear() if end is None else flight.px4.inject(end)
        await later(flight, 4.5 if end is None else 2.0)
        assert "slow_streams" not in flight.vehicle.health.warnings

    fly(scenario)


def test_a_battery_that_the_autopilot_calls_critical_is_told_and_hinders_an_engage() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        assert "battery" not in flight.vehicle.health.warnings
        flight.px4.inject(BatteryLow(fraction=0.14, failsafe=False))
        await later(flight, 3.0)
        assert flight.vehicle.health.warnings["battery"] == "the autopilot calls the battery low"
        flight.px4.inject(BatteryLow(fraction=0.06, failsafe=False))
        await later(flight, 3.0)
        assert flight.vehicle.health.warnings["battery"] == "the autopilot calls the battery critical"
        with pytest.raises(ProtocolError, match="the autopilot calls the battery critical"):
            await flight.goto(5.0, 0.0, -5.0)
        assert flight.sent == []

    fly(scenario, parameters={"CBRK_SUPPLY_CHK": 0, "COM_LOW_BAT_ACT": 0})


@pytest.mark.parametrize(("anchor", "told"), [("home", True), ("origin", False)])
def test_a_fence_about_a_home_that_nobody_tells_is_warned_of_until_it_is_told(anchor: str, told: bool) -> None:
    async def scenario(flight: Flight) -> None:
        take, silent = flight.px4.take_outgoing, True
        flight.px4.take_outgoing = lambda: [m for m in take() if not (silent and m[0] == "HOME_POSITION")]  # type: ignore[method-assign]
        await flight.airborne()
        assert ("home_unknown" in flight.vehicle.health.warnings) is told
        silent = False
        await later(flight, 3.0)
        assert "home_unknown" not in flight.vehicle.health.warnings

    fly(scenario, config={"safety": {"fence": {"anchor": anchor}}})


@pytest.mark.parametrize(
    ("anchor", "home", "origin", "home_ned_m", "expected_m"),
    [
        ("home", NORTH_OF_HERE, HERE, (5.0, 5.0, 5.0), (11.12, 0.0, -2.0)),
        ("home", NORTH_OF_HERE, None, (5.0, 5.0, 5.0), (5.0, 5.0, 5.0)),
        ("home", None, HERE, (5.0, 5.0, 5.0), (5.0, 5.0, 5.0)),
        ("home", None, None, None, (0.0, 0.0, 0.0)),
        ("origin", NORTH_OF_HERE, HERE, (5.0, 5.0, 5.0), (0.0, 0.0, 0.0)),
    ],
)
def test_the_fence_lies_about_home_by_the_globe_else_as_it_is_told_or_about_the_origin(
    anchor: str, home: GlobalPosition | None, origin: GlobalPosition | None, home_ned_m: Vec3 | None, expected_m: Vec3
) -> None:
    """A ten-thousandth of a degree of latitude is 11.12 m."""

    async def scenario(flight: Flight) -> None:
        await standing_by(flight)
        status = replace(flight.autopilot.status.value, home=home, global_origin=origin, home_ned_m=home_ned_m)
        flight.vehicle.health._follow_fence(status)
        assert flight.vehicle.fence.anchor_ned_m == pytest.approx(expected_m, abs=0.02)

    fly(scenario, config={"safety": {"fence": {"anchor": anchor}}})


@pytest.mark.parametrize(("origin", "moved_m"), [(True, 1.0), (False, 0.0)])
def test_the_fence_about_home_is_told_anew_after_each_reset(origin: bool, moved_m: float) -> None:
    """It moves with the origin alone; also where it stays it is of the frame after the reset."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        before = flight.vehicle.fence.anchor_ned_m
        flight.px4.inject(EkfReset(kind="position_ne", size_m=1.0, origin=origin))
        await later(flight, 2.5)
        assert dist(flight.vehicle.fence.anchor_ned_m, before) == pytest.approx(moved_m, abs=0.1)
        assert flight.vehicle.parameters.value.fence_shift.count == flight.records[-1].estimate.shift.count == 1

    fly(scenario)
