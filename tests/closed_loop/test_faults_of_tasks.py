"""Tasks that die or stall in flight, and requests that the autopilot refuses: the vehicle is handed over, goals end."""

from itertools import pairwise
from math import dist
from typing import Any
from unittest.mock import Mock

import pytest
import structlog
from support.flight import Flight, fly

from daemon.autopilot.port import CommandRefusedError
from daemon.journal import Journal
from daemon.messages import FlightMode
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.faults import Fault, Link, ModesRefused
from daemon.telemetry import Telemetry


class DeliberateError(RuntimeError):
    """What a test lets a task die of."""


def _die(*_arguments: Any) -> None:
    raise DeliberateError


async def _under_way(flight: Flight) -> str:
    await flight.airborne()
    goal_id = await flight.goto(40.0, 0.0, -12.0)
    await flight.until(lambda: flight.position[0] > 8.0)
    return goal_id


@pytest.mark.parametrize("dies", ["trajectory", "health", "control", "listener of control", "link"])
def test_a_task_that_dies_hands_the_vehicle_over_before_the_daemon_ends(
    dies: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights: list[Flight] = []

    async def scenario(flight: Flight) -> None:
        flights.append(flight)
        await _under_way(flight)
        if dies == "trajectory":
            flight.vehicle.trajectory.tick = _die  # type: ignore[method-assign]
        elif dies == "health":
            monkeypatch.setattr("daemon.loops.health_task.notify", _die)
        elif dies == "listener of control":
            flight.vehicle.control.listeners.append(_die)
        elif dies == "link":
            flight.autopilot.session.poll = _die  # type: ignore[method-assign]
        else:
            monkeypatch.setattr("daemon.pipeline.step", _die)
        await flight.until(lambda: False)

    with pytest.raises(ExceptionGroup) as group:
        fly(scenario)
    assert group.group_contains(DeliberateError)
    (flight,) = flights
    assert flight.px4.mode is FlightMode.HOLD
    assert [entry.outcome for entry in flight.ended] == ["aborted"]
    assert flight.ended[0].reason == "task_failed"
    assert flight.vehicle.gate.latched


@pytest.mark.parametrize("silent_s", [0.05, 0.25])
def test_the_hold_of_a_control_task_that_died_is_asked_for_again_when_it_is_lost(
    silent_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights: list[Flight] = []

    async def scenario(flight: Flight) -> None:
        flights.append(flight)
        await _under_way(flight)
        flight.px4.inject(Link(direction="up", silent=True, duration_s=silent_s))
        monkeypatch.setattr("daemon.pipeline.step", _die)
        await flight.until(lambda: False)

    with pytest.raises(ExceptionGroup):
        fly(scenario)
    (flight,) = flights
    assert flight.px4.mode is FlightMode.HOLD


def test_a_listener_that_fails_again_while_the_vehicle_is_given_away_does_not_keep_it() -> None:
    flights: list[Flight] = []

    async def scenario(flight: Flight) -> None:
        flights.append(flight)
        await _under_way(flight)
        flight.vehicle.trajectory.listeners.append(Mock(goal_progress=_die, goal_ended=_die))
        await flight.until(lambda: False)

    with pytest.raises(ExceptionGroup) as group:
        fly(scenario)
    (error,) = group.value.exceptions
    assert "DeliberateError" in error.__notes__[0]
    (flight,) = flights
    assert flight.vehicle.gate.latched
    assert flight.px4.mode is FlightMode.HOLD


def test_telemetry_that_fails_is_told_once_and_the_flight_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.telemetry._drawn", _die)

    async def scenario(flight: Flight) -> None:
        control, health = flight.vehicle.control, flight.vehicle.health
        Telemetry(flight.vehicle, Reports(flight.vehicle), flight.hub, Journal(flight.hub, None))
        told: list[float] = []
        control.watchers.add("recorder", lambda _inputs, record: told.append(record.now_s))
        goal_id = await _under_way(flight)
        assert (await flight.result(goal_id)).outcome == "succeeded"
        await flight.result(await flight.goto(40.0, 5.0, -12.0))
        assert told[-1] == flight.records[-1].now_s
        assert len(told) == len(flight.records)
        assert "DeliberateError" in health.warnings["telemetry_failed"]
        assert "recorder_failed" not in health.warnings

    with structlog.testing.capture_logs() as lines:
        fly(scenario)
    failures = [line for line in lines if line["event"] == "watcher_failed"]
    assert [(line["watcher"], line["error"]) for line in failures] == [("telemetry", "DeliberateError()")]
    assert "telemetry.py:" in failures[0]["where"]


def test_a_trajectory_task_that_stalls_leaves_a_vehicle_that_brakes_and_holds() -> None:
    async def scenario(flight: Flight) -> None:
        await _under_way(flight)
        since_s, place = flight.now_s, flight.position
        flight.vehicle.trajectory.tick = lambda _now_s: None  # type: ignore[method-assign]
        await flight.until(lambda: flight.now_s - since_s > 8.0)
        assert dist(place, flight.position) < 15.0
        assert dist((0.0, 0.0, 0.0), flight.px4.truth.velocity_ned_m_s) < 0.3
        assert flight.state is State.TRACKING

    fly(scenario)


@pytest.mark.parametrize("then", ["goes on", "is canceled", "is replaced", "is replaced by a path"])
def test_a_trajectory_task_that_comes_back_goes_on_from_where_the_vehicle_was_braked(then: str) -> None:
    async def scenario(flight: Flight) -> None:
        await _under_way(flight)
        task = flight.vehicle.trajectory
        first, tick = task.goal_id, task.tick
        task.tick = lambda _now_s: None  # type: ignore[method-assign]
        await flight.until(lambda since_s=flight.now_s: flight.now_s - since_s > 2.5)  # type: ignore[misc]
        seen = len(flight.records)
        if then == "is canceled":
            task.cancel()
        elif then == "is replaced":
            await flight.submit(waypoint={"position": [5.0, 5.0, -5.0]})
        elif then == "is replaced by a path":
            places = [{"position": [5.0, north, -5.0]} for north in (0.0, 5.0)]
            await flight.submit(path={"waypoints": places, "through": "fly_by"})
        task.tick = tick  # type: ignore[method-assign]
        await flight.until(lambda since_s=flight.now_s: flight.now_s - since_s > 20.0)  # type: ignore[misc]
        flown = [record.reference for record in flight.records[seen:] if record.reference is not None]
        for one, two in pairwise(flown):
            assert dist(one.position_ned_m, two.position_ned_m) < 0.06, "5 m/s at most"
            assert dist(one.velocity_ned_m_s, two.velocity_ned_m_s) < 0.04, "3.6 m/s^2 at most"
        outcome = {"goes on": "aborted", "is canceled": "canceled"}.get(then, "preempted")
        ended = [(entry.outcome, entry.reason) for entry in flight.ended if entry.goal_id == first]
        assert ended == [(outcome, "not_followed" if then == "goes on" else None)]
        if then.startswith("is replaced"):
            assert flight.ended[-1].outcome == "succeeded"
        assert flight.state is State.HOLDING

    fly(scenario)


@pytest.mark.parametrize("fault", [ModesRefused(modes=("offboard",)), ModesRefused(modes=("offboard", "hold"))])
def test_a_refused_offboard_ends_in_silence_and_hold_with_the_reason(fault: Fault) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(fault)
        with pytest.raises(CommandRefusedError, match="did not go to offboard"):
            await flight.vehicle.commander.engage()
        count = len(flight.sent)
        since_s = flight.now_s
        await flight.until(lambda: flight.now_s - since_s > 3.0)
        assert len(flight.sent) == count
        assert flight.px4.mode is FlightMode.HOLD
        assert flight.state is State.READY

    fly(scenario)
