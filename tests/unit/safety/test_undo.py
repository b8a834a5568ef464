"""An OFFBOARD that comes after the vehicle is not ours any more: who is asked for what, how often, and until when."""

from dataclasses import replace
from itertools import pairwise

import pytest
from support.statuses import IN_HOLD, IN_OFFBOARD
from support.supervision_rig import Rig, engaging, releasing, tracking

from daemon.messages import FlightMode, ModeRefusal, RequestKind, SystemStatus
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import State


def in_failsafe(mode: FlightMode = FlightMode.HOLD) -> Rig:
    """The autopilot's failsafe took the vehicle from us; it intends to go back to OFFBOARD."""
    rig = tracking().status(IN_OFFBOARD, mode=mode, system_status=SystemStatus.CRITICAL)
    assert rig.tick() is State.FAULT
    return rig


def modes(rig: Rig) -> list[FlightMode]:
    return [mode for _, mode in rig.asked]


@pytest.mark.parametrize(
    ("mode", "answer"),
    [
        (FlightMode.HOLD, FlightMode.HOLD),
        (FlightMode.RETURN, FlightMode.RETURN),
        (FlightMode.LAND, FlightMode.LAND),
        (FlightMode.MISSION, FlightMode.HOLD),
    ],
)
@pytest.mark.parametrize("later_s", [0.3, 20.0])
def test_an_autopilot_that_goes_back_to_offboard_by_itself_is_sent_back_at_once(
    mode: FlightMode, answer: FlightMode, later_s: float
) -> None:
    rig = in_failsafe(mode)
    rig.tick(round(later_s * 100))
    rig.status(IN_OFFBOARD)
    assert rig.tick() is State.FAULT
    assert modes(rig) == [answer]
    assert rig.drive is Drive.SILENT


def test_an_offboard_that_may_be_of_the_past_is_answered_once_it_is_known_to_be_of_now() -> None:
    rig = in_failsafe()
    rig.status(IN_HOLD, system_status=SystemStatus.CRITICAL).tick(95)
    rig.status(IN_OFFBOARD, heard=False).tick(20)
    assert rig.asked == []
    rig.status(IN_OFFBOARD).tick()
    assert modes(rig) == [FlightMode.HOLD]


def test_an_offboard_of_the_past_is_not_answered_when_another_mode_is_of_now() -> None:
    rig = in_failsafe()
    rig.status(IN_OFFBOARD, heard=False).tick(20)
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION).tick(300)
    assert rig.asked == []


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.RETURN])
def test_the_answer_is_repeated_thrice_while_offboard_stays_and_then_no_more(mode: FlightMode) -> None:
    rig = in_failsafe(mode)
    rig.status(IN_OFFBOARD)
    rig.tick(500)
    assert modes(rig) == [mode] * 3
    assert all(0.19 < b - a < 0.22 for (a, _), (b, _) in pairwise(rig.asked))


def test_a_return_that_is_refused_becomes_hold() -> None:
    rig = in_failsafe(FlightMode.RETURN)
    rig.status(IN_OFFBOARD)
    rig.tick()
    rig.status(IN_OFFBOARD, mode_refusal=ModeRefusal(FlightMode.RETURN, "no home", rig.now_s))
    rig.tick(30)
    assert modes(rig) == [FlightMode.RETURN, FlightMode.HOLD]


def test_a_return_that_was_refused_before_the_failsafe_flew_one_is_asked_for_all_the_same() -> None:
    rig = in_failsafe(FlightMode.RETURN)
    rig.status(IN_OFFBOARD, mode_refusal=ModeRefusal(FlightMode.RETURN, "no home", 0.0))
    rig.tick()
    assert modes(rig) == [FlightMode.RETURN]


def test_who_chooses_offboard_after_the_answer_keeps_it() -> None:
    rig = in_failsafe()
    rig.status(IN_OFFBOARD).tick()
    rig.status(IN_HOLD).tick(10)
    rig.status(IN_OFFBOARD)
    assert rig.tick(500) is State.FAULT
    assert modes(rig) == [FlightMode.HOLD]


def test_who_chose_a_mode_during_the_failsafe_may_choose_offboard_later() -> None:
    rig = in_failsafe()
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION).tick(150)
    rig.status(IN_OFFBOARD)
    rig.tick(300)
    assert rig.asked == []
    rig.status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL).tick(50)
    rig.status(IN_OFFBOARD)
    rig.tick(300)
    assert rig.asked == [], "the failsafe of another program's flight is none of ours"


def test_the_offboard_of_another_program_is_left_alone_after_its_failsafe() -> None:
    rig = Rig().status(IN_OFFBOARD)
    assert rig.tick(10) is State.PILOT
    rig.status(IN_OFFBOARD, mode=FlightMode.HOLD, system_status=SystemStatus.CRITICAL)
    assert rig.tick(50) is State.FAULT
    rig.status(IN_OFFBOARD)
    rig.tick(300)
    assert rig.asked == []


def test_an_offboard_of_an_engage_that_comes_over_a_landing_of_the_autopilot_is_answered_by_land() -> None:
    rig = engaging()
    rig.tick(25)
    rig.asked.clear()
    rig.status(IN_HOLD, mode=FlightMode.LAND, system_status=SystemStatus.CRITICAL)
    assert rig.tick(20) is State.FAULT
    rig.status(IN_OFFBOARD)
    rig.tick()
    assert modes(rig) == [FlightMode.LAND]


def test_stale_setpoints_within_a_second_of_a_pilots_mode_do_not_fly_the_vehicle() -> None:
    rig = tracking().status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick(50) is State.PILOT
    rig.status(IN_OFFBOARD).tick()
    assert modes(rig) == [FlightMode.HOLD]


def test_an_offboard_that_was_never_left_after_a_failed_release_is_the_autopilots_failsafes_affair() -> None:
    rig = releasing()
    while rig.tick() is State.RELEASING:
        pass
    rig.asked.clear()
    assert rig.tick(100) is State.FAULT
    assert rig.asked == []
    rig.status(IN_OFFBOARD, mode=FlightMode.HOLD, system_status=SystemStatus.CRITICAL).tick(20)
    rig.status(IN_OFFBOARD).tick()
    assert modes(rig) == [FlightMode.HOLD], "but its going back to what waited in the link is ours to undo"


def test_a_late_offboard_does_not_argue_with_what_a_person_has_just_asked_for() -> None:
    rig = in_failsafe()
    rig.ask(RequestKind.LAND).tick()
    rig.status(IN_OFFBOARD).tick(10)
    assert modes(rig) == [FlightMode.LAND]


def found_in_offboard_after_a_lost_link(rig: Rig) -> list[FlightMode]:
    """What the autopilot is asked for when the link comes back."""
    rig.set(status=replace(rig.facts.status, connected=False))
    assert rig.tick(50) is State.DISCONNECTED
    rig.asked.clear()
    rig.status(IN_OFFBOARD)
    assert rig.tick(300) is State.PILOT
    return modes(rig)


def test_an_offboard_to_come_is_answered_by_hold_when_it_is_found_after_a_lost_link_too() -> None:
    """What waited in the link took effect while nothing was heard: nobody flies."""
    rig = in_failsafe()
    rig.tick(200)
    assert found_in_offboard_after_a_lost_link(rig) == [FlightMode.HOLD]
    rig = tracking().status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    rig.tick(90)
    assert found_in_offboard_after_a_lost_link(rig) == [FlightMode.HOLD]


def test_an_offboard_that_was_never_left_is_answered_by_hold_after_a_lost_link_whenever_that_was() -> None:
    rig = releasing()
    while rig.tick() is State.RELEASING:
        pass
    rig.tick(500)
    assert found_in_offboard_after_a_lost_link(rig) == [FlightMode.HOLD]


def test_an_offboard_that_is_not_ours_is_left_alone_when_it_is_found_after_a_lost_link() -> None:
    another_program = Rig().status(IN_OFFBOARD)
    another_program.tick(10)
    assert found_in_offboard_after_a_lost_link(another_program) == []
    chosen_long_after = tracking().status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    chosen_long_after.tick(110)
    assert found_in_offboard_after_a_lost_link(chosen_long_after) == []
