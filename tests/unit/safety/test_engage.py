"""Taking the vehicle: what is sent, what is asked for, when an engage is not begun and how it is given up."""

from itertools import pairwise

import pytest
from support.statuses import IN_HOLD, IN_OFFBOARD
from support.supervision_rig import Rig, engaging, ready

from daemon.messages import (
    FlightMode,
    LandedState,
    ModeRefusal,
    RequestKind,
    SystemStatus,
)
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import OURS, State


def test_engage_matches_for_two_tenths_before_it_asks_for_offboard() -> None:
    rig = engaging()
    since = rig.now_s
    assert rig.drive is Drive.MATCH
    rig.tick(40)
    (when, mode), *more = rig.asked
    assert mode is FlightMode.OFFBOARD
    assert when - since == pytest.approx(0.2, abs=0.015)
    assert more == []


def test_a_refused_offboard_is_asked_again_until_two_seconds_then_hold_and_silence() -> None:
    rig = engaging()
    since = rig.now_s
    for _ in range(220):
        rig.tick()
        if rig.asked and rig.asked[-1][1] is FlightMode.OFFBOARD:
            rig.status(IN_HOLD, mode_refusal=ModeRefusal(FlightMode.OFFBOARD, "no", rig.now_s))
        if rig.supervision.state is not State.ENGAGING:
            break
    assert rig.supervision.state is State.READY
    assert rig.supervision.reason == "engage_refused"
    assert rig.now_s - since == pytest.approx(2.0, abs=0.03)
    modes = [mode for _, mode in rig.asked]
    assert 5 <= modes.count(FlightMode.OFFBOARD) <= 10
    assert modes[-1] is FlightMode.HOLD
    assert rig.drive is Drive.SILENT


def test_an_engage_that_is_not_possible_is_not_begun() -> None:
    for changes in (
        {"armed": False},
        {"landed": LandedState.LANDING},
        {"mode": FlightMode.RETURN, "intended_mode": FlightMode.RETURN},
        {"mode": FlightMode.POSITION, "intended_mode": FlightMode.POSITION},
        {"intended_mode": FlightMode.OFFBOARD},
        {"system_status": SystemStatus.CRITICAL},
    ):
        rig = Rig().status(IN_HOLD)
        rig.tick()
        rig.status(IN_HOLD, **changes).ask(RequestKind.ENGAGE)
        assert rig.tick(5) not in OURS, changes
        rig.status(IN_HOLD)
        assert rig.tick(5) not in OURS, "a request is taken at once or not at all"
        assert rig.asked == []


def test_an_engage_on_an_attitude_that_the_accelerometer_contradicts_is_not_begun() -> None:
    rig = ready().set(disagreement_rad=0.5)
    rig.tick(250)
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick(5) is State.READY


def test_a_refused_offboard_is_not_asked_for_again_before_two_tenths() -> None:
    rig = engaging()
    for _ in range(150):
        rig.tick()
        if rig.asked:
            rig.status(IN_HOLD, mode_refusal=ModeRefusal(FlightMode.OFFBOARD, "no", rig.now_s))
    times = [time for time, _ in rig.asked]
    assert len(times) == 7
    assert all(0.19 < after - before < 0.22 for before, after in pairwise(times))


@pytest.mark.parametrize("changes", [{"variance_grows": True}, {"innovation": 1.1}, {"position_variance_m2": 0.31}])
def test_a_vehicle_whose_position_becomes_doubtful_is_not_taken(changes: dict[str, object]) -> None:
    rig = ready().set(**changes)
    rig.tick(150)
    rig.ask(RequestKind.ENGAGE)
    rig.tick(5)
    assert rig.supervision.state is State.READY


def test_a_release_from_an_engage_waits_until_the_offboard_that_was_asked_for_cannot_come_any_more() -> None:
    rig = engaging()
    while not rig.asked:
        rig.tick()
    offboard_s = rig.now_s
    rig.tick(4)
    rig.ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    while rig.tick() is State.RELEASING:
        assert rig.now_s - offboard_s < 0.3
    assert rig.supervision.state is State.READY
    assert rig.now_s - offboard_s == pytest.approx(0.2, abs=0.015)


def test_a_release_before_offboard_was_asked_for_ends_in_the_hold_that_is_flown() -> None:
    rig = engaging()
    rig.tick(5)
    assert rig.asked == []
    rig.ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    assert rig.tick() is State.READY


def test_a_landing_asked_for_while_engaging_has_two_tenths_to_begin() -> None:
    rig = engaging()
    rig.tick(5)
    rig.ask(RequestKind.LAND)
    assert rig.tick() is State.RELEASING
    since = rig.now_s
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]
    while rig.tick() is State.RELEASING:
        assert rig.now_s - since < 0.3
    assert rig.supervision.state is State.READY
    assert rig.now_s - since == pytest.approx(0.2, abs=0.015)
    rig.status(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING, "it came after all"
    assert rig.supervision.reason == "requested"


def test_an_offboard_that_comes_while_the_engage_is_given_up_is_answered_by_hold() -> None:
    rig = engaging()
    rig.tick(210)
    assert rig.supervision.state is State.READY
    assert rig.asked[-1][1] is FlightMode.HOLD
    assert rig.supervision.asked_mode is FlightMode.HOLD


def _pilot_over_offboard() -> Rig:
    """A pilot chose Position after OFFBOARD was asked for and before it took effect."""
    rig = engaging()
    rig.tick(25)
    assert [mode for _, mode in rig.asked] == [FlightMode.OFFBOARD]
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick() is State.PILOT
    rig.asked.clear()
    return rig


def test_an_offboard_that_overtakes_the_pilots_mode_is_undone_once_and_the_pilot_keeps_the_vehicle() -> None:
    rig = _pilot_over_offboard()
    rig.tick(10)
    assert rig.asked == []
    rig.status(IN_OFFBOARD)
    assert rig.tick(20) is State.PILOT
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.status(IN_HOLD)
    assert rig.tick(100) is State.PILOT
    assert rig.drive is Drive.SILENT
    assert len(rig.asked) == 1


def test_an_offboard_that_somebody_else_chooses_later_is_left_alone() -> None:
    rig = _pilot_over_offboard()
    rig.tick(100)
    rig.status(IN_OFFBOARD)
    assert rig.tick(100) is State.PILOT
    assert rig.asked == []


def test_offboard_is_asked_for_once_the_mode_was_told_since_it_became_due_and_since_the_last_late_tick() -> None:
    rig = engaging().status(IN_HOLD, told_s=0.0)
    rig.tick(50)
    assert rig.asked == []
    rig.set(tick_s=0.15).tick()
    late_s = rig.now_s
    rig.set(tick_s=0.01).status(IN_HOLD, told_s=late_s - 0.001).tick(10)
    assert rig.asked == [], "it was told before we stood still"
    rig.status(IN_HOLD, told_s=late_s).tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.OFFBOARD]


def test_nothing_is_asked_for_when_an_engage_ends_that_never_asked() -> None:
    rig = engaging().status(IN_HOLD, told_s=0.0)
    rig.tick(220)
    assert (rig.supervision.state, rig.supervision.reason, rig.asked) == (State.READY, "engage_refused", [])
