"""Giving the vehicle back: for which reasons, in which steps, and within which time."""

from dataclasses import replace
from itertools import pairwise

import pytest
from support.statuses import IN_HOLD, IN_OFFBOARD
from support.supervision_rig import Rig, releasing, tracking, vehicle_at

from daemon.messages import (
    FlightMode,
    ModeRefusal,
    RequestKind,
)
from daemon.safety import supervision as safety
from daemon.safety.conditions import Bounds, Conditions
from daemon.safety.geofence import Geofence
from daemon.safety.supervision import Drive, Supervision
from daemon.safety.supervisor import OURS, State


def test_a_young_state_is_flown_an_older_one_levelled_a_lost_one_released() -> None:
    rig = tracking()
    rig.set(age_s=0.19).tick()
    assert (rig.supervision.state, rig.drive) == (State.TRACKING, Drive.LAW)
    rig.set(age_s=0.21).tick()
    assert (rig.supervision.state, rig.drive) == (State.TRACKING, Drive.LEVEL)
    rig.set(age_s=0.51).tick()
    assert (rig.supervision.state, rig.drive) == (State.RELEASING, Drive.LEVEL)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    assert rig.supervision.left == "estimate_lost"


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"position_variance_m2": 0.31}, "estimate_poor"),
        ({"position_variance_m2": float("nan")}, "estimate_poor"),
        ({"innovation": 1.1}, "estimate_poor"),
        ({"truth_returned": True}, "position_reset"),
        ({"state": vehicle_at((0.0, 0.0, -130.0))}, "geofence"),
        ({"state": replace(vehicle_at(), attitude_wb=(0.5, 0.866, 0.0, 0.0))}, "tilt_excess"),
        ({"state": replace(vehicle_at(), velocity_ned_m_s=(21.0, 0.0, 0.0))}, "speed_excess"),
        ({"disagreement_rad": 0.5}, "attitude_disagreement"),
    ],
)
def test_what_cannot_be_flown_is_handed_over_to_hold(changes: dict[str, object], reason: str) -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0))
    rig.set(**changes)
    for _ in range(300):
        if rig.tick() is State.RELEASING:
            break
    assert rig.supervision.left == reason
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


@pytest.mark.parametrize("beyond", [FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN])
def test_a_vehicle_that_drifts_on_beyond_the_hard_fence_is_brought_down_or_back_as_configured(
    beyond: FlightMode,
) -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=beyond)
    rig.set(state=vehicle_at((0.0, 0.0, -126.0)))
    assert rig.tick() is State.RELEASING
    rig.status(IN_HOLD)
    assert rig.tick(100) is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -132.0)))
    rig.tick(400)
    assert rig.asked == [], "it rests where Hold has stopped it"
    rig.set(state=replace(vehicle_at((0.0, 0.0, -132.0)), velocity_ned_m_s=(0.0, 0.0, -1.0)))
    rig.tick(150)
    assert rig.asked == [], "it may be braking still"
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == ([] if beyond is FlightMode.HOLD else [beyond])
    rig.tick(5000)
    assert len(rig.asked) == (0 if beyond is FlightMode.HOLD else 5), "a refusal is not argued with for ever"
    if beyond is not FlightMode.HOLD:
        rig.ask(RequestKind.LAND if beyond is FlightMode.LAND else RequestKind.RETURN)
        rig.tick()
        rig.status(IN_HOLD, mode=beyond, intended_mode=beyond)
        assert rig.tick() is State.LANDING


@pytest.mark.parametrize("left", ["requested", "battery_low"])
def test_a_hold_that_was_not_given_for_the_fence_is_left_alone_beyond_it(left: str) -> None:
    rig = tracking()
    rig.bounds = Bounds(
        fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND, battery_fraction=0.1
    )
    if left == "requested":
        rig.ask(RequestKind.HOLD)
    else:
        rig.status(IN_OFFBOARD, battery_fraction=0.05)
    while rig.tick() is not State.RELEASING:
        assert rig.now_s < 60.0
    assert rig.supervision.left == left
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -126.0))).tick()
    rig.set(state=replace(vehicle_at((0.0, 0.0, -140.0)), velocity_ned_m_s=(0.0, 0.0, -1.0)))
    rig.tick(400)
    assert rig.asked == []


def test_a_short_excess_of_tilt_is_not_handed_over() -> None:
    rig = tracking().set(state=replace(vehicle_at(), attitude_wb=(0.5, 0.866, 0.0, 0.0)))
    rig.tick(20)
    rig.set(state=vehicle_at())
    assert rig.tick(100) is State.TRACKING


def test_release_ends_when_hold_is_confirmed() -> None:
    rig = releasing()
    assert rig.drive is Drive.LAW
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(5)
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    assert rig.drive is Drive.SILENT


def test_hold_unconfirmed_becomes_land_then_level_then_silence_within_a_second() -> None:
    rig = releasing()
    since = rig.now_s
    driven: list[Drive] = []
    while rig.tick() is State.RELEASING:
        driven.append(rig.drive)
        assert rig.now_s - since < 1.0
    assert rig.supervision.state is State.FAULT
    modes = [mode for _, mode in rig.asked]
    assert list(dict.fromkeys(modes)) == [FlightMode.HOLD, FlightMode.LAND]
    assert modes == sorted(modes, key=[FlightMode.HOLD, FlightMode.LAND].index), "Hold is not asked for after Land"
    assert modes.count(FlightMode.HOLD) >= 3, "a message may be lost"
    assert next(t for t, mode in rig.asked if mode is FlightMode.LAND) - since == pytest.approx(0.3, abs=0.02)
    assert rig.now_s - since <= 1.0
    assert Drive.SILENT not in driven
    assert driven[-10:] == [Drive.LEVEL] * 10, "the autopilot's failsafe has to start from level"
    rig.tick(200)
    assert rig.drive is Drive.SILENT


def test_the_commands_of_a_hand_over_are_repeated_twenty_times_a_second() -> None:
    rig = releasing()
    while rig.tick() is State.RELEASING:
        pass
    times = [time for time, _ in rig.asked]
    assert 14 <= len(times) <= 16
    assert all(0.04 < after - before < 0.07 for before, after in pairwise(times))


def test_an_autopilot_that_is_not_heard_is_asked_for_hold_alone_and_told_no_more_after_three_tenths() -> None:
    rig = releasing()
    since = rig.now_s
    rig.status(IN_OFFBOARD, heard=False)
    driven = []
    while rig.tick() is State.RELEASING:
        driven.append(rig.drive)
    assert rig.now_s - since == pytest.approx(0.8, abs=0.03)
    assert Drive.SILENT not in driven, "setpoints go on: PX4 would keep the last rate"
    assert {mode for _, mode in rig.asked} == {FlightMode.HOLD}
    assert rig.asked[-1][0] - since <= 0.31


def test_an_autopilot_that_is_heard_again_in_offboard_is_asked_for_hold_at_once() -> None:
    rig = releasing()
    rig.status(IN_OFFBOARD, heard=False).tick(45)
    rig.asked.clear()
    rig.status(IN_OFFBOARD)
    rig.tick(25)
    assert rig.asked[0][0] == pytest.approx(rig.now_s - 0.24)
    assert {mode for _, mode in rig.asked} == {FlightMode.HOLD}, "it has three tenths to answer before it is Land"
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.RETURN])
def test_what_took_the_vehicle_while_the_autopilot_was_not_heard_keeps_it(mode: FlightMode) -> None:
    rig = releasing()
    rig.status(IN_OFFBOARD, heard=False).tick(45)
    rig.asked.clear()
    rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode)
    assert rig.tick(100) is State.PILOT
    assert rig.asked == []


def test_after_a_lost_estimate_the_vehicle_is_levelled_also_when_the_estimate_comes_back() -> None:
    rig = tracking().set(age_s=0.51)
    assert rig.tick() is State.RELEASING
    rig.set(age_s=0.01).tick()
    assert rig.drive is Drive.LEVEL


def test_a_refused_hold_becomes_land_at_once() -> None:
    rig = releasing()
    rig.status(IN_OFFBOARD, mode_refusal=ModeRefusal(FlightMode.HOLD, "no position", rig.now_s))
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD, FlightMode.LAND]
    rig.status(IN_OFFBOARD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING


def test_land_and_return_release_into_their_own_modes() -> None:
    for kind, mode in ((RequestKind.LAND, FlightMode.LAND), (RequestKind.RETURN, FlightMode.RETURN)):
        rig = tracking().ask(kind)
        assert rig.tick() is State.RELEASING
        assert [m for _, m in rig.asked] == [mode]
        rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode)
        assert rig.tick() is State.LANDING


def test_an_estimate_that_contradicts_itself_for_a_moment_is_flown() -> None:
    rig = tracking().set(innovation=5.0)
    rig.tick(90)
    rig.set(innovation=0.5).tick(100)
    assert rig.supervision.state is State.TRACKING


def test_a_flight_is_given_back_for_the_reason_that_ended_it_whatever_follows() -> None:
    rig = tracking().set(truth_returned=True)
    assert rig.tick() is State.RELEASING
    rig.set(truth_returned=False).status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick() is State.PILOT
    assert (rig.supervision.left, rig.supervision.reason) == ("position_reset", "pilot_override")


@pytest.mark.parametrize(
    ("changes", "drive"),
    [
        ({}, Drive.LAW),
        ({"state_usable": False}, Drive.LEVEL),
        ({"estimate_poor": True}, Drive.LEVEL),
        ({"attitude_disagrees": True}, Drive.LEVEL),
        ({"release_levels": True}, Drive.LEVEL),
    ],
)
def test_while_releasing_only_a_trusted_estimate_is_flown(changes: dict[str, bool], drive: Drive) -> None:
    conditions = replace(Conditions(state_usable=True), **changes)
    assert safety.drive(Supervision(state=State.RELEASING), conditions) is drive
    for state in (State.HOLDING, State.TRACKING):
        expected = Drive.LEVEL if "state_usable" in changes else Drive.LAW
        assert safety.drive(Supervision(state=state), conditions) is expected
    assert safety.drive(Supervision(state=State.ENGAGING), conditions) is Drive.MATCH
    for state in set(State) - OURS:
        assert safety.drive(Supervision(state=state), conditions) is Drive.SILENT


def test_a_hold_that_was_given_for_another_reason_than_the_fence_is_left_alone_beyond_it() -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND)
    rig.set(position_variance_m2=9.0)
    assert rig.tick() is State.RELEASING
    assert rig.supervision.left == "estimate_poor"
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -140.0)))
    rig.tick(400)
    assert rig.asked == []


def _held_after_land_was_asked_for() -> Rig:
    """Hold did not show within 0.3 s, Land was asked for, and then Hold shows."""
    rig = releasing()
    rig.tick(40)
    assert rig.asked[-1][1] is FlightMode.LAND
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.asked.clear()
    return rig


IN_LAND = replace(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)


def test_the_lands_of_a_release_that_come_after_hold_are_answered_by_hold() -> None:
    rig = _held_after_land_was_asked_for()
    rig.tick(25)
    rig.status(IN_LAND)
    assert rig.tick() is State.LANDING
    assert rig.supervision.reason == "land_overtook_hold"
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(10)
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    assert len(rig.asked) == 1


@pytest.mark.parametrize(
    ("kind", "mode"), [(RequestKind.LAND, FlightMode.LAND), (RequestKind.RETURN, FlightMode.RETURN)]
)
def test_that_answer_is_not_repeated_over_what_a_person_asks_for_meanwhile(kind: RequestKind, mode: FlightMode) -> None:
    rig = _held_after_land_was_asked_for().status(IN_LAND)
    rig.tick(5)
    rig.ask(kind).tick(300)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD, mode]


def test_that_answer_is_repeated_thrice_and_not_after_a_refusal() -> None:
    rig = _held_after_land_was_asked_for().status(IN_LAND)
    rig.tick(300)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD] * 3
    rig = _held_after_land_was_asked_for().status(IN_LAND)
    rig.tick()
    rig.status(IN_LAND, mode_refusal=ModeRefusal(FlightMode.HOLD, "no position", rig.now_s)).tick(300)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


def test_a_land_that_shows_more_than_a_second_later_is_somebody_elses() -> None:
    rig = _held_after_land_was_asked_for()
    rig.tick(110)
    rig.status(IN_LAND)
    assert rig.tick(50) is State.PILOT
    assert rig.asked == []


def test_a_land_that_a_person_asks_for_after_that_is_one() -> None:
    rig = _held_after_land_was_asked_for().ask(RequestKind.LAND)
    rig.tick(5)
    rig.status(IN_LAND)
    assert rig.tick() is State.LANDING
    assert rig.supervision.reason == "requested"
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]


def test_a_fence_that_is_left_after_that_is_answered_by_land() -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND)
    rig.set(state=vehicle_at((0.0, 0.0, -126.0))).tick(40)
    rig.status(IN_HOLD)
    assert rig.tick(350) is State.READY
    asked = len(rig.asked)
    rig.set(state=replace(vehicle_at((0.0, 0.0, -132.0)), velocity_ned_m_s=(0.0, 0.0, -1.0))).tick(220)
    assert rig.asked[asked][1] is FlightMode.LAND
    rig.status(IN_LAND)
    assert rig.tick() is State.LANDING
    assert rig.supervision.reason == "geofence"


def test_a_drift_of_before_a_standstill_is_answered_only_when_hold_is_heard_since() -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND)
    rig.set(state=vehicle_at((0.0, 0.0, -126.0))).tick()
    rig.status(IN_HOLD).tick(400)
    rig.asked.clear()
    rig.set(state=replace(vehicle_at((0.0, 0.0, -132.0)), velocity_ned_m_s=(0.0, 0.0, -1.0))).tick(50)
    rig.now_s += 20.0
    rig.status(IN_HOLD, heard=False).tick(5)
    assert rig.asked == []
    rig.status(IN_HOLD).tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]


def test_a_land_that_came_late_is_not_answered_again_before_it_is_heard_that_it_still_lands() -> None:
    rig = _held_after_land_was_asked_for().status(IN_LAND)
    rig.tick()
    assert len(rig.asked) == 1
    rig.now_s += 20.0
    rig.status(IN_LAND, heard=False).tick(5)
    assert len(rig.asked) == 1
