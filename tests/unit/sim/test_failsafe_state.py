"""The failsafe in time: Hold first, a user's take-over, a lost pilot who comes back."""

import pytest

from daemon.messages import FlightMode
from daemon.sim.failsafe import BatteryWarning, Cause, Health
from daemon.sim.failsafe_state import FailsafeState
from daemon.sim.parameters import Parameters

HOLD, LAND, OFFBOARD, RETURN = FlightMode.HOLD, FlightMode.LAND, FlightMode.OFFBOARD, FlightMode.RETURN
FINE = Health(offboard_signal=True)
CRITICAL = Health(offboard_signal=True, battery=BatteryWarning.CRITICAL)
EMPTY = Health(offboard_signal=True, battery=BatteryWarning.EMERGENCY)
DT_S = 0.01


@pytest.fixture
def failsafe():
    return FailsafeState(Parameters({}))


def run(failsafe, health, seconds, intended=OFFBOARD):
    """The modes that were flown, each once."""
    flown = []
    for _ in range(round(seconds / DT_S)):
        failsafe.step(intended, health, DT_S)
        if not flown or flown[-1] is not failsafe.flown:
            flown.append(failsafe.flown)
    return flown


def test_a_critical_battery_holds_five_seconds_and_returns(failsafe):
    assert run(failsafe, CRITICAL, 4.98) == [HOLD]
    assert run(failsafe, CRITICAL, 0.1) == [HOLD, RETURN]


def test_an_empty_battery_meanwhile_waits_for_the_rest_of_the_hold_only(failsafe):
    assert run(failsafe, CRITICAL, 3.0) == [HOLD]
    assert run(failsafe, EMPTY, 1.98) == [HOLD]
    assert run(failsafe, EMPTY, 0.1) == [HOLD, LAND]


def test_one_that_returns_already_lands_at_once(failsafe):
    run(failsafe, CRITICAL, 6.0)
    assert run(failsafe, EMPTY, 0.1) == [LAND]


def test_without_a_position_there_is_no_hold_to_wait_in(failsafe):
    blind = Health(offboard_signal=True, position=False, battery=BatteryWarning.CRITICAL)
    assert run(failsafe, blind, 0.1) == [LAND]
    assert failsafe.action.descend


def test_a_user_who_takes_over_keeps_the_vehicle_until_there_is_a_new_reason(failsafe):
    run(failsafe, CRITICAL, 1.0)
    failsafe.taken_over(CRITICAL)
    assert run(failsafe, CRITICAL, 10.0) == [None]
    assert run(failsafe, EMPTY, 5.1) == [HOLD, LAND]


def test_a_user_who_lands_against_a_lost_pilot_may_go_on_afterwards(failsafe):
    lost = Health(offboard_signal=True, manual_control_lost=True)
    run(failsafe, lost, 1.0)
    failsafe.taken_over(lost)
    assert run(failsafe, lost, 1.0, intended=LAND) == [None]
    assert run(failsafe, lost, 1.0, intended=OFFBOARD) == [None]


def test_a_user_cannot_take_over_into_a_mode_that_cannot_run(failsafe):
    blind = Health(position=False, battery=BatteryWarning.CRITICAL)
    run(failsafe, blind, 1.0)
    failsafe.taken_over(blind)
    assert run(failsafe, blind, 0.1, intended=LAND) == [LAND]
    assert failsafe.action.descend


def test_a_pilot_who_was_lost_has_to_switch_the_mode_to_have_the_vehicle_back(failsafe):
    lost, back = Health(manual_control_lost=True), Health(manual_control=True)
    assert run(failsafe, lost, 6.0, intended=HOLD) == [HOLD, RETURN]
    assert run(failsafe, back, 1.0, intended=HOLD) == [RETURN]
    failsafe.taken_over(back)
    assert run(failsafe, back, 1.0, intended=HOLD) == [None]
    assert run(failsafe, lost, 1.0, intended=HOLD) == [HOLD]


def test_setpoints_that_come_back_end_the_failsafe_and_disarming_forgets_it(failsafe):
    assert run(failsafe, Health(), 1.0) == [RETURN]
    assert run(failsafe, FINE, 0.1) == [None]
    run(failsafe, CRITICAL, 1.0)
    failsafe.cleared()
    assert (failsafe.flown, failsafe.action.cause) == (None, Cause.GENERIC)
