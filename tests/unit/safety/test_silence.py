"""What takes the vehicle from us, or has it taken: silence within one tick, and who is asked for what then."""

from collections.abc import Callable

import pytest
from support.statuses import IN_HOLD, IN_OFFBOARD, ON_GROUND
from support.supervision_rig import Rig, engaging, releasing, tracking

from daemon.messages import FlightMode, RequestKind, SystemStatus
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import State


@pytest.mark.parametrize(
    "mode", sorted(set(FlightMode) - {FlightMode.OFFBOARD, FlightMode.UNKNOWN, FlightMode.TERMINATION}, key=str)
)
def test_a_mode_change_not_asked_for_silences_within_one_tick_and_asks_nothing(mode: FlightMode) -> None:
    rig = tracking().status(IN_OFFBOARD, mode=mode, intended_mode=mode)
    assert rig.tick() is State.PILOT
    assert rig.supervision.left == "pilot_override"
    assert rig.drive is Drive.SILENT
    rig.tick(300)
    assert rig.asked == []


def test_a_failsafe_of_the_autopilot_silences_and_the_daemon_stays_silent_when_offboard_comes_back() -> None:
    rig = tracking().status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL)
    assert rig.tick(500) is State.FAULT
    assert rig.supervision.left == "autopilot_failsafe"
    assert rig.asked == []
    rig.status(IN_OFFBOARD)
    rig.tick(500)
    assert rig.supervision.state is State.FAULT
    assert rig.drive is Drive.SILENT


def test_a_failsafe_that_shows_only_in_the_intended_mode_is_one() -> None:
    rig = tracking().status(IN_OFFBOARD, mode=FlightMode.RETURN)
    assert rig.tick() is State.FAULT


def test_a_kill_switch_silences_within_one_tick_while_the_autopilot_still_calls_itself_armed() -> None:
    rig = tracking().status(IN_OFFBOARD, system_status=SystemStatus.FLIGHT_TERMINATION)
    assert rig.tick() is State.FAULT
    assert rig.supervision.left == "terminated"
    assert rig.drive is Drive.SILENT
    rig.tick(100)
    assert rig.asked == []


@pytest.mark.parametrize("begin", [engaging, tracking, releasing])
def test_flight_termination_is_told_as_such_also_by_its_mode_which_shows_first(begin: Callable[[], Rig]) -> None:
    """As measured: the mode shows at once, MAV_STATE_FLIGHT_TERMINATION with the next HEARTBEAT."""
    rig = begin().status(IN_OFFBOARD, mode=FlightMode.TERMINATION, intended_mode=FlightMode.TERMINATION)
    assert rig.tick() is State.FAULT
    assert rig.supervision.reason == "terminated"
    rig.status(
        IN_OFFBOARD,
        mode=FlightMode.TERMINATION,
        intended_mode=FlightMode.TERMINATION,
        system_status=SystemStatus.FLIGHT_TERMINATION,
    )
    assert rig.tick(300) is State.FAULT
    assert (rig.supervision.reason, rig.drive) == ("terminated", Drive.SILENT)


def test_disarming_silences_within_one_tick() -> None:
    rig = tracking().status(IN_OFFBOARD, armed=False)
    assert rig.tick() is State.STANDBY
    assert rig.drive is Drive.SILENT
    assert rig.asked == []


def test_the_latch_silences_before_everything_and_only_engage_comes_back() -> None:
    rig = tracking().set(latched=True)
    assert rig.tick() is State.FAULT
    assert rig.drive is Drive.SILENT
    rig.set(latched=False).status(IN_HOLD)
    assert rig.tick(50) is State.FAULT
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick() is State.ENGAGING


@pytest.mark.parametrize("unheard", [1, 30, 500])
def test_a_stalled_task_asks_for_hold_once_it_is_heard_that_the_autopilot_still_waits_for_us(unheard: int) -> None:
    rig = tracking().status(IN_OFFBOARD, heard=False).set(latched=True)
    assert rig.tick(unheard) is State.FAULT
    rig.status(IN_OFFBOARD, heard=False, heartbeat_s=rig.now_s).tick(30)
    assert rig.asked == [], "nothing shows yet that it did not wait while we stood still"
    rig.status(IN_OFFBOARD).tick(15)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(300)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD] * 3, "a message may be lost"


def test_an_offboard_that_somebody_chooses_after_a_stalled_task_lost_the_vehicle_is_not_answered() -> None:
    rig = tracking().status(IN_OFFBOARD, heard=False).set(latched=True)
    rig.tick(50)
    rig.status(IN_HOLD).tick(150)
    rig.status(IN_OFFBOARD).tick(300)
    assert rig.asked == []


def test_a_stalled_task_asks_nothing_of_a_vehicle_that_somebody_else_took() -> None:
    rig = tracking().status(IN_OFFBOARD, heard=False).set(latched=True)
    rig.tick()
    for mode in (FlightMode.POSITION, FlightMode.RETURN):
        rig.status(IN_OFFBOARD, mode=mode)
        rig.tick(200)
    assert rig.asked == []


def test_a_lost_link_silences_asks_hold_once_and_the_vehicle_is_not_taken_back() -> None:
    rig = tracking().status(IN_OFFBOARD, connected=False)
    assert rig.tick() is State.DISCONNECTED
    assert rig.drive is Drive.SILENT
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(100)
    rig.status(IN_OFFBOARD)
    assert rig.tick() is State.PILOT
    assert rig.supervision.reason == "link_returned"
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD] * 2, "the first may not have been heard"
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY


def test_what_flew_the_vehicle_while_the_link_was_lost_keeps_it() -> None:
    for mode in (FlightMode.POSITION, FlightMode.RETURN):
        rig = tracking().status(IN_OFFBOARD, connected=False)
        rig.tick(100)
        rig.asked.clear()
        rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode)
        assert rig.tick(100) is State.PILOT
        assert rig.asked == []
        rig.status(IN_OFFBOARD, connected=False)
        rig.tick(100)
        rig.status(IN_OFFBOARD)
        assert rig.tick(100) is State.PILOT
        assert rig.asked == [], "the second loss was not of ours"


def test_a_release_that_nobody_answered_before_the_link_was_lost_is_finished_when_it_is_back() -> None:
    for mode, asked in ((FlightMode.OFFBOARD, [FlightMode.HOLD]), (FlightMode.POSITION, [])):
        rig = releasing().status(IN_OFFBOARD, heard=False)
        while rig.tick() is State.RELEASING:
            pass
        rig.tick(20)
        rig.status(IN_OFFBOARD, connected=False)
        assert rig.tick(300) is State.DISCONNECTED
        rig.asked.clear()
        rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode).tick(50)
        assert [m for _, m in rig.asked] == asked
        assert rig.supervision.reason == "link_returned"


def test_an_autopilot_that_goes_back_to_offboard_after_the_link_is_back_is_sent_back() -> None:
    rig = tracking().status(IN_OFFBOARD, connected=False)
    rig.tick(300)
    rig.asked.clear()
    rig.status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL).tick(200)
    assert rig.asked == []
    rig.status(IN_OFFBOARD).tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.RETURN]


def test_a_rebooted_autopilot_is_met_anew() -> None:
    rig = tracking().status(ON_GROUND, boot_count=1)
    assert rig.tick() is State.STANDBY
    assert rig.drive is Drive.SILENT


def test_hold_after_a_failsafe_counts_when_the_next_heartbeat_no_longer_shows_it() -> None:
    rig = Rig().status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL)
    assert rig.tick(5) is State.FAULT
    rig.ask(RequestKind.HOLD)
    rig.tick()
    rig.status(IN_HOLD, system_status=SystemStatus.CRITICAL)
    assert rig.tick(80) is State.FAULT
    rig.status(IN_HOLD)
    assert rig.tick(5) is State.READY
