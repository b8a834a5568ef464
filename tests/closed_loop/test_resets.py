"""Resets of the EKF in flight, against the twin flight of the same seed without: the vehicle must not notice."""

import asyncio
import json
from functools import cache
from math import degrees, dist
from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.frames import angle_between, ned_from_global, tilt_of
from daemon.journal import Journal
from daemon.messages import FlightMode, GlobalPosition, Quat, Vec3
from daemon.pipeline import Inputs, Record
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.faults import ClockStep, EkfReset, Fault, GpsLoss
from daemon.telemetry import Telemetry

BEFORE_S, AFTER_S = 3.0, 4.0
POSITION = {
    "3 m": EkfReset(kind="position_ne", size_m=3.0),
    "11 m": EkfReset(kind="position_ne", size_m=11.1),
    "2 m down": EkfReset(kind="position_d", size_m=2.0),
}
Path = list[tuple[float, Vec3, Quat]]


@cache
def flown(fault: Fault | None, leg: bool) -> Path:
    """Time since the fault, true position and attitude; on the spot, or on a leg to the north at 2 m/s."""

    async def scenario(flight: Flight) -> Path:
        await flight.airborne()
        if leg:
            await flight.goto(40.0, 0.0, -5.0)
        begun_s = flight.now_s
        await flight.until(lambda: flight.now_s >= begun_s + BEFORE_S)
        since_s, path = flight.now_s, []
        truth = flight.px4
        flight.vehicle.control.listeners.append(
            lambda _, r: path.append((r.now_s - since_s, truth.truth.position_ned_m, truth.truth.attitude_wb))
        )
        if fault is not None:
            flight.px4.inject(fault)
        await flight.until(lambda: flight.now_s >= since_s + AFTER_S)
        assert flight.state is (State.TRACKING if leg else State.HOLDING)
        return path

    return fly(scenario, seed=3, noise=True, config={"guidance": {"limits": {"speed_m_s": 2.0}}})


def departures(fault: Fault, leg: bool) -> list[tuple[float, float, float]]:
    """Time since the reset, metres and degrees from the twin."""
    pairs = zip(flown(fault, leg), flown(None, leg), strict=True)
    return [(a[0], dist(a[1], b[1]), degrees(angle_between(a[2], b[2]))) for a, b in pairs]


@pytest.mark.parametrize("leg", [False, True], ids=["hover", "leg at 2 m/s"])
@pytest.mark.parametrize("reset", POSITION.values(), ids=POSITION.keys())
def test_a_reset_of_the_position_moves_only_the_numbers(reset: EkfReset, leg: bool) -> None:
    apart = departures(reset, leg)
    assert max(metres for _, metres, _ in apart) < 0.15
    assert max(angle for _, _, angle in apart) < 2.0


@pytest.mark.parametrize(
    "reset",
    [EkfReset(kind="velocity_ne", size_m_s=1.0), EkfReset(kind="heading", size_deg=30.0)],
    ids=["velocity 1 m/s", "heading 30 deg"],
)
def test_a_reset_of_velocity_or_heading_in_hover_is_hardly_felt(reset: EkfReset) -> None:
    assert max(metres for t, metres, _ in departures(reset, leg=False) if t <= 2.0) < 0.3


@pytest.mark.parametrize("step_s", [-20.0, -2.0, -0.2, 0.2, 2.0])
def test_a_step_of_the_autopilots_clock_is_not_felt(step_s: float) -> None:
    assert max(metres for _, metres, _ in departures(ClockStep(step_s=step_s), leg=True)) < 0.05


def test_a_lost_gps_hands_the_vehicle_over_before_the_position_is_worthless() -> None:
    async def scenario(flight: Flight) -> float:
        await flight.airborne()
        flight.px4.inject(GpsLoss())
        waited_s = await flight.until(lambda: flight.state is State.READY, 6.0)
        assert flight.autopilot.status.value.mode is FlightMode.HOLD
        assert max(r.estimate.position_variance_m2 for r in flight.records[-10:]) < 0.4
        return waited_s

    assert fly(scenario, seed=3, noise=True) < 4.5


def test_a_wrong_position_that_gps_pulls_back_moves_the_vehicle_by_no_more_than_it_was_wrong() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(15.0)
        await asyncio.sleep(2.0)
        place, since = flight.position, len(flight.records)
        flight.px4.inject(EkfReset(kind="position_ne", size_m=3.0, origin=False))
        await asyncio.sleep(5.0)
        assert flight.state is State.HOLDING
        assert 2.0 < flight.position[0] - place[0] < 3.0, "a real PX4 in offboard: 2.7 m"
        tilts = [degrees(tilt_of(newest.attitude_wb)) for r in flight.records[since:] if (newest := r.estimate.newest)]
        assert 25.0 < max(tilts) < 40.0, "35 there"

    fly(scenario)


def test_a_position_that_gps_takes_back_hands_the_vehicle_over_for_its_variance() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(15.0)
        place = flight.position
        flight.px4.inject(EkfReset(kind="position_ne", size_m=11.0, origin=False))
        await flight.until(lambda: flight.state is State.READY, 1.5)
        assert "estimate_poor" in {record.supervision.reason for record in flight.records}
        await asyncio.sleep(3.0)
        assert dist(flight.position, place) < 1.0
        await flight.vehicle.commander.engage()

    fly(scenario)


@pytest.mark.parametrize(
    ("reset", "kinds", "key", "size"),
    [
        (EkfReset(kind="position_ne", size_m=3.0), ["position_ne"], "position_ned_m", [3.0, 0.0, 0.0]),
        (EkfReset(kind="velocity_ne", size_m_s=1.0), ["velocity_ne"], "velocity_ned_m_s", [1.0, 0.0, 0.0]),
        (EkfReset(kind="heading", size_deg=30.0), ["heading"], "yaw_deg", 30.0),
    ],
    ids=["position", "velocity", "heading"],
)
def test_planners_outside_hear_what_was_reset_and_by_how_much(
    reset: EkfReset, kinds: list[str], key: str, size: list[float] | float
) -> None:
    class Planner:
        def __init__(self) -> None:
            self.events: list[dict[str, Any]] = []

        def send(self, line: bytes, *, essential: bool) -> None:
            self.events.append(json.loads(line)["params"])

    async def scenario(flight: Flight) -> list[dict[str, Any]]:
        await flight.airborne()
        planner = Planner()
        Telemetry(flight.vehicle, Reports(flight.vehicle), flight.hub, Journal(flight.hub, None))
        flight.hub.subscribe(planner, ["events"], 1.0)
        flight.px4.inject(reset)
        await flight.until(lambda begun=flight.now_s: flight.now_s - begun > 0.5)
        return planner.events

    (event,) = (event for event in fly(scenario, seed=3, noise=True) if event["code"] == "reset")
    assert event["reset"]["kinds"] == kinds
    assert event["reset"]["counter_steps"] == (2 if kinds == ["position_ne"] else 1)
    assert event["reset"][key] == pytest.approx(size, abs=0.2 if isinstance(size, list) else 1.0)


@pytest.mark.parametrize("offset_s", [-0.02, 0.0, 0.02], ids=["reset first", "at once", "goal first"])
def test_a_reset_during_a_preemption_ends_neither_goal_and_keeps_the_new_one_in_its_place(offset_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        first = await flight.goto(10.0, 0.0, -5.0)
        await flight.until(lambda: flight.position[0] > 3.0)
        since_s, place = flight.now_s, flight.position
        if offset_s <= 0.0:
            flight.px4.inject(EkfReset(kind="position_ne", size_m=3.0))
            await flight.until(lambda: flight.now_s - since_s >= -offset_s)
        seen = flight.records[-1].estimate.shift.count > 0
        second = await flight.goto(6.0, 8.0, -6.0)
        if offset_s > 0.0:
            await flight.until(lambda: flight.now_s - since_s >= offset_s)
            flight.px4.inject(EkfReset(kind="position_ne", size_m=3.0))
        entry = await flight.result(second)
        assert entry.outcome == "succeeded"
        assert [(e.goal_id, e.outcome) for e in flight.ended] == [(first, "preempted"), (second, "succeeded")]
        shift = flight.records[-1].estimate.shift.position_ned_m
        assert dist(shift, (0.0, 0.0, 0.0)) == pytest.approx(3.0, abs=0.1)
        # A goal that was given in the numbers of before keeps its place; one given afterwards means the new numbers.
        wanted = (6.0 - shift[0], 8.0 - shift[1], -6.0) if seen else (6.0, 8.0, -6.0)
        assert dist(flight.position, wanted) < 0.35
        steps = [dist(a, b) for a, b in zip(flight.truths, flight.truths[1:], strict=False) if dist(a, place) < 1.5]
        assert max(steps) < 0.07, "the vehicle must not lurch"

    fly(scenario)


def test_the_window_is_in_the_numbers_after_a_reset_within_a_tick() -> None:
    """The trajectory task is woken by a reset; its grid of 0.1 s would come up to ten ticks later."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        behind: list[float] = []

        def look(_inputs: Inputs, record: Record) -> None:
            window = flight.vehicle.trajectory.window.value
            if window is not None and window.shift.count != record.estimate.shift.count:
                behind.append(record.now_s)

        flight.vehicle.control.listeners.append(look)
        for _ in range(4):
            await asyncio.sleep(0.53)
            flight.px4.inject(EkfReset(kind="position_ne", size_m=1.0))
        await asyncio.sleep(0.5)
        assert flight.records[-1].estimate.shift.count == 4
        assert len(behind) <= 4  # in the tick itself

    fly(scenario)


@pytest.mark.parametrize("told", ["0.05 s late", "0.4 s late", "when asked"])
def test_a_goal_on_the_globe_ends_at_its_place_though_the_origin_is_told_after_the_jump(told: str) -> None:
    """PX4 tells its origin in a message of its own; the one of the change may be late, or lost."""
    late_s = {"0.05 s late": 0.05, "0.4 s late": 0.4, "when asked": None}[told]

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        hold_back_origins(flight, late_s)
        home = flight.px4.home
        place = GlobalPosition(home.latitude_deg + 30.0 / 111_195.0, home.longitude_deg, home.altitude_amsl_m + 5.0)
        true_place = ned_from_global(place, home)
        goal_id = await flight.goto(place.latitude_deg, place.longitude_deg, place.altitude_amsl_m, frame="global")
        await asyncio.sleep(3.0)
        flight.px4.inject(EkfReset(kind="position_ne", size_m=11.0, origin=True))
        assert (await flight.result(goal_id)).outcome == "succeeded"
        await asyncio.sleep(3.0)
        assert dist(flight.position[:2], true_place[:2]) < 0.3

    fly(scenario)


def hold_back_origins(flight: Flight, late_s: float | None) -> None:
    """From now on GPS_GLOBAL_ORIGIN comes so late; None: only when it was asked for since."""
    take, receive = flight.px4.take_outgoing, flight.px4.receive
    held: list[tuple[float, tuple[str, Any]]] = []
    wanted: list[float] = []

    def taken() -> list[tuple[str, Any]]:
        out = []
        for message in take():
            if message[0] != "GPS_GLOBAL_ORIGIN":
                out.append(message)
            elif late_s is not None:
                held.append((flight.now_s + late_s, message))
            elif wanted:
                out.append(message)
                wanted.clear()
        while held and held[0][0] <= flight.now_s:
            out.append(held.pop(0)[1])
        return out

    def received(name: str, fields: dict[str, Any], **sender: Any) -> None:
        if (fields.get("command"), fields.get("param1")) == (512, 49):
            wanted.append(flight.now_s)
        receive(name, fields, **sender)

    flight.px4.take_outgoing = taken  # type: ignore[method-assign]
    flight.px4.receive = received  # type: ignore[method-assign]
