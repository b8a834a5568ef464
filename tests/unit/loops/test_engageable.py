"""A vehicle is not engaged while a mode that somebody asked for may still come, and no longer than that."""

from dataclasses import replace

import pytest
from support.statuses import IN_HOLD
from support.trajectory_rig import NOTHING

from daemon.loops.engageable import hindrances
from daemon.messages import (
    BatteryCharge,
    ClockSync,
    FlightMode,
    LandedState,
    ModeRefusal,
    RequestKind,
    SystemStatus,
    VehicleRequest,
)

PATIENCE_S = 2.5
NOW_S = 100.0


def coming(
    *,
    unread: RequestKind | None = None,
    asked: FlightMode | None = None,
    ago_s: float = 0.1,
    refusal: ModeRefusal | None = None,
) -> list[str]:
    supervision = replace(NOTHING.supervision, serial=6, asked_mode=asked, asked_s=NOW_S - ago_s)
    conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False)
    record = replace(NOTHING, now_s=NOW_S, supervision=supervision, conditions=conditions)
    request = VehicleRequest(6, RequestKind.TAKEOFF) if unread is None else VehicleRequest(7, unread)
    return hindrances(replace(IN_HOLD, mode_refusal=refusal), record, request, None, patience_s=PATIENCE_S)


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("tilt_excess", "tilted too far"),
        ("speed_excess", "too fast"),
        ("fence_breached", "beyond the hard fence"),
        ("battery_low", "battery is below"),
        ("estimate_poor", "too uncertain"),
        ("estimate_worsens", "becoming uncertain"),
        ("attitude_disagrees", "accelerometer disagree"),
    ],
)
def test_what_would_hand_the_vehicle_over_at_once_hinders(condition: str, words: str) -> None:
    conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False)
    conditions = replace(conditions, **{condition: True})
    (said,) = hindrances(IN_HOLD, replace(NOTHING, conditions=conditions), None, None, patience_s=PATIENCE_S)
    assert words in said


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"airframe": "a rover (MAV_TYPE 10)"}, "flies multirotors, and the autopilot says that this is a rover"),
        ({"armed": False}, "not armed"),
        ({"landed": LandedState.LANDING}, "landed state is landing"),
        ({"mode": FlightMode.MISSION, "intended_mode": FlightMode.MISSION}, "the mode is mission, not hold"),
        ({"intended_mode": FlightMode.MISSION}, "intends mission: a failsafe acts"),
        ({"system_status": SystemStatus.CRITICAL}, "system status is critical"),
        ({"battery_charge": BatteryCharge.CRITICAL}, "calls the battery critical"),
        ({"battery_charge": BatteryCharge.EMERGENCY}, "calls the battery emergency"),
    ],
)
def test_an_autopilot_that_is_not_quietly_in_hold_hinders(changes: dict[str, object], words: str) -> None:
    conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False)
    status = replace(IN_HOLD, **changes)  # type: ignore[arg-type]
    (said,) = hindrances(status, replace(NOTHING, conditions=conditions), None, None, patience_s=PATIENCE_S)
    assert words in said


def test_without_a_fresh_estimate_nothing_is_engaged() -> None:
    conditions = replace(NOTHING.conditions, state_usable=False, estimate_poor=False)
    said = hindrances(IN_HOLD, replace(NOTHING, conditions=conditions), None, None, patience_s=PATIENCE_S)
    assert said == ["there is no fresh estimate"]


@pytest.mark.parametrize(
    ("link_slow", "words"),
    [(False, []), (True, ["the link takes 1.50 s there and back: too slow to fly by (link.round_trip_max_s)"])],
)
def test_a_link_that_takes_too_long_hinders(link_slow: bool, words: list[str]) -> None:
    conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False, link_slow=link_slow)
    clock = ClockSync(1_000_000, 0.0, 0.0, uncertainty_s=0.001, round_trip_s=1.5)
    assert hindrances(IN_HOLD, replace(NOTHING, conditions=conditions), None, clock, patience_s=PATIENCE_S) == words


def test_nothing_that_was_asked_for_hinders_nothing() -> None:
    assert coming() == []


@pytest.mark.parametrize("kind", [RequestKind.HOLD, RequestKind.LAND, RequestKind.RETURN, RequestKind.TAKEOFF])
def test_a_request_that_the_supervisor_has_not_read_hinders(kind: RequestKind) -> None:
    assert coming(unread=kind) == [f"{kind.value} was asked for and may still come"]


def test_another_engage_that_was_not_read_does_not_hinder() -> None:
    assert coming(unread=RequestKind.ENGAGE) == []


@pytest.mark.parametrize(("ago_s", "hinders"), [(0.0, True), (2.4, True), (2.6, False)])
def test_a_mode_that_does_not_show_hinders_for_as_long_as_it_may_come(ago_s: float, hinders: bool) -> None:
    assert bool(coming(asked=FlightMode.RETURN, ago_s=ago_s)) is hinders


def test_the_mode_that_the_vehicle_is_in_does_not_hinder() -> None:
    assert coming(asked=FlightMode.HOLD) == []


@pytest.mark.parametrize(
    ("mode", "time_s", "hinders"),
    [(FlightMode.LAND, 99.95, False), (FlightMode.LAND, 99.8, True), (FlightMode.OFFBOARD, 99.95, True)],
)
def test_a_mode_that_was_refused_since_does_not_hinder(mode: FlightMode, time_s: float, hinders: bool) -> None:
    refusal = ModeRefusal(mode, "denied", time_s)
    assert bool(coming(asked=FlightMode.LAND, refusal=refusal)) is hinders
