"""Requests while the autopilot flies or waits, and what is nobody's request."""

from collections.abc import Callable

import pytest
from support.statuses import IN_HOLD, ON_GROUND
from support.supervision_rig import TICK_S, Rig, ready

from daemon.messages import FlightMode, ModeRefusal, RequestKind, VehicleRequest
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import State


def test_a_vehicle_met_in_flight_belongs_to_the_pilot_and_nothing_is_asked() -> None:
    rig = Rig().status(IN_HOLD)
    assert rig.tick(100) is State.PILOT
    assert rig.supervision.reason == "found_flying"
    assert rig.asked == []
    assert rig.drive is Drive.SILENT


def test_a_hold_that_comes_long_after_it_was_asked_for_is_somebody_elses() -> None:
    for late_s, state in ((2.9, State.READY), (3.1, State.PILOT)):
        rig = Rig().status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION)
        rig.tick()
        rig.ask(RequestKind.HOLD)
        rig.tick(round(late_s / TICK_S))
        rig.status(IN_HOLD)
        assert rig.tick(5) is state


@pytest.mark.parametrize("mode", [FlightMode.POSITION, FlightMode.POSITION_SLOW, FlightMode.UNKNOWN])
@pytest.mark.parametrize("kind", [RequestKind.HOLD, RequestKind.LAND, RequestKind.RETURN])
def test_a_request_that_meets_a_pilots_mode_in_its_tick_commands_nothing(kind: RequestKind, mode: FlightMode) -> None:
    rig = Rig().status(IN_HOLD)
    rig.tick()
    rig.status(IN_HOLD, mode=mode, intended_mode=mode)
    rig.ask(kind)
    assert rig.tick(5) is State.PILOT
    assert rig.asked == []


def test_hold_can_be_asked_for_after_a_pilot_let_go() -> None:
    rig = Rig().status(IN_HOLD)
    rig.tick()
    rig.ask(RequestKind.HOLD)
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    assert rig.tick() is State.READY


def test_landing_ends_disarmed_on_the_ground() -> None:
    rig = ready().ask(RequestKind.LAND)
    rig.tick()
    rig.status(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING
    rig.status(ON_GROUND, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.STANDBY


def test_the_first_request_counts_whatever_its_serial() -> None:
    for serial in (1, 7, -1):
        rig = Rig().status(IN_HOLD)
        rig.tick()
        rig.request = VehicleRequest(serial, RequestKind.HOLD)
        rig.tick()
        assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
        assert rig.tick() is State.READY


def test_a_request_is_answered_once() -> None:
    rig = Rig().status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION)
    rig.tick()
    rig.ask(RequestKind.LAND)
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]


def test_nothing_is_asked_of_an_autopilot_that_is_not_heard() -> None:
    rig = Rig().status(IN_HOLD, connected=False)
    rig.ask(RequestKind.LAND)
    rig.tick(5)
    rig.status(IN_HOLD)
    assert rig.tick(5) is State.PILOT
    assert rig.asked == []


def test_a_take_off_is_commanded_by_whoever_asks_for_it() -> None:
    rig = Rig()
    rig.tick()
    rig.ask(RequestKind.TAKEOFF)
    rig.tick(10)
    assert rig.asked == []
    assert rig.supervision.asked_mode is FlightMode.TAKEOFF


def test_a_landing_of_a_vehicle_on_the_ground_may_be_asked_for_in_a_pilots_mode() -> None:
    rig = Rig().status(ON_GROUND, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    rig.tick()
    rig.ask(RequestKind.HOLD)
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


@pytest.mark.parametrize("mode", list(FlightMode))
def test_nothing_is_asked_of_a_vehicle_met_in_flight_whatever_mode_it_flies(mode: FlightMode) -> None:
    """Offboard too: another program may fly it."""
    rig = Rig().status(IN_HOLD, mode=mode, intended_mode=mode)
    assert rig.tick(300) is State.PILOT
    assert rig.asked == []
    assert rig.drive is Drive.SILENT


@pytest.mark.parametrize("kind", [RequestKind.HOLD, RequestKind.LAND])
def test_a_mode_that_was_refused_and_comes_all_the_same_is_somebody_elses(kind: RequestKind) -> None:
    mode = {RequestKind.HOLD: FlightMode.HOLD, RequestKind.LAND: FlightMode.LAND}[kind]
    rig = Rig().status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION)
    rig.tick()
    rig.ask(kind).tick()
    refusal = ModeRefusal(mode, "no position", rig.now_s)
    rig.status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION, mode_refusal=refusal).tick(10)
    rig.status(IN_HOLD, mode=mode, intended_mode=mode, mode_refusal=refusal)
    assert rig.tick(10) is State.PILOT
    rig.ask(kind).tick(2)
    assert rig.supervision.state is not State.PILOT, "an older refusal does not count"


@pytest.mark.parametrize("kind", [RequestKind.LAND, RequestKind.RETURN])
def test_a_landing_that_takes_effect_over_a_pilots_mode_that_it_crossed_is_told_as_requested(kind: RequestKind) -> None:
    mode = {RequestKind.LAND: FlightMode.LAND, RequestKind.RETURN: FlightMode.RETURN}[kind]
    rig = ready().ask(kind)
    rig.tick(3)
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick(3) is State.PILOT
    rig.status(IN_HOLD, mode=mode, intended_mode=mode)
    assert rig.tick() is State.LANDING
    assert rig.supervision.reason == "requested"
    assert [m for _, m in rig.asked] == [mode]


def _landing() -> Rig:
    rig = ready().ask(RequestKind.LAND)
    rig.tick()
    rig.status(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING
    return rig


def _taking_off() -> Rig:
    rig = Rig()
    rig.tick()
    rig.ask(RequestKind.TAKEOFF).status(IN_HOLD, mode=FlightMode.TAKEOFF, intended_mode=FlightMode.TAKEOFF)
    assert rig.tick(2) is State.TAKING_OFF
    return rig


@pytest.mark.parametrize("begin", [_landing, _taking_off])
def test_a_return_that_crosses_a_pilots_mode_is_told_as_requested_wherever_it_was_asked_for(
    begin: Callable[[], Rig],
) -> None:
    rig = begin().ask(RequestKind.RETURN)
    rig.tick(3)
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick(3) is State.PILOT
    rig.status(IN_HOLD, mode=FlightMode.RETURN, intended_mode=FlightMode.RETURN)
    assert rig.tick() is State.LANDING
    assert rig.supervision.reason == "requested"


@pytest.mark.parametrize("kind", list(RequestKind))
def test_nothing_is_asked_of_an_autopilot_of_which_only_the_past_is_known(kind: RequestKind) -> None:
    """A pilot may have taken it while we stood still."""
    rig = ready()
    rig.asked.clear()
    rig.status(IN_HOLD, heard=False).ask(kind)
    assert rig.tick() is State.READY
    assert (rig.drive, rig.asked) == (Drive.SILENT, [])
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick(300) is State.PILOT
    assert rig.asked == []
