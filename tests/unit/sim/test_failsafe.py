"""Which mode flies when the intended one will not do."""

import pytest

from daemon.messages import FlightMode
from daemon.sim.failsafe import BatteryWarning, Cause, Health, can_run, decide, sustains

PX4_DEFAULTS = {"offboard_loss": 0, "manual_loss": 2, "low_battery": 3}
FINE = Health(offboard_signal=True, position=True)
HOLD, LAND, OFFBOARD, POSITION, RETURN = (
    FlightMode.HOLD,
    FlightMode.LAND,
    FlightMode.OFFBOARD,
    FlightMode.POSITION,
    FlightMode.RETURN,
)


@pytest.mark.parametrize("mode", [HOLD, LAND, OFFBOARD, FlightMode.TAKEOFF, RETURN])
def test_a_mode_that_can_run_goes_on(mode):
    assert decide(mode, FINE, **PX4_DEFAULTS).mode is None


@pytest.mark.parametrize(
    ("parameter", "health", "mode", "descend"),
    [
        (0, Health(), RETURN, False),  # Position wants a pilot: recorded
        (0, Health(manual_control=True), POSITION, False),
        (0, Health(position=False), FlightMode.ALTITUDE, True),  # seen on PX4 in SITL: nobody asks for a pilot any more
        (1, Health(position=False), LAND, True),
        (2, Health(manual_control=True), FlightMode.STABILIZED, False),
        (1, Health(manual_control=True, position=False), FlightMode.ALTITUDE, False),
        (3, Health(), RETURN, False),
        (4, Health(), LAND, False),
        (4, Health(position=False), LAND, True),
        (5, Health(), HOLD, False),
        (5, Health(position=False), LAND, True),
    ],
)
def test_losing_offboard_falls_through(parameter, health, mode, descend):
    action = decide(OFFBOARD, health, **{**PX4_DEFAULTS, "offboard_loss": parameter})
    assert (action.mode, action.descend) == (mode, descend)
    assert action.cause is Cause.GENERIC
    assert not action.delayed


@pytest.mark.parametrize("mode", [POSITION, FlightMode.POSITION_SLOW])
def test_a_pilot_who_has_no_position_any_more_flies_altitude(mode):
    """Failsafe::checkModeFallback."""
    blind = Health(manual_control=True, position=False)
    assert decide(mode, blind, **PX4_DEFAULTS).mode is FlightMode.ALTITUDE


def test_hold_without_a_position_descends():
    action = decide(HOLD, Health(position=False), **PX4_DEFAULTS)
    assert (action.mode, action.descend) == (LAND, True)


def test_without_setpoints_sticks_and_an_action_for_lost_sticks_nothing_happens():
    assert decide(OFFBOARD, Health(), **{**PX4_DEFAULTS, "manual_loss": 0}).mode is None


def test_the_worst_action_wins():
    health = Health(battery=BatteryWarning.CRITICAL)
    action = decide(OFFBOARD, health, **{**PX4_DEFAULTS, "offboard_loss": 4})
    assert (action.mode, action.cause, action.delayed) == (LAND, Cause.GENERIC, False)
    action = decide(OFFBOARD, health, **{**PX4_DEFAULTS, "offboard_loss": 5})
    assert (action.mode, action.cause, action.delayed) == (RETURN, Cause.BATTERY_CRITICAL, True)


@pytest.mark.parametrize("intended", [LAND, RETURN])
def test_a_vehicle_on_its_way_down_is_not_called_home(intended):
    assert decide(intended, Health(battery=BatteryWarning.CRITICAL), **PX4_DEFAULTS).mode is None
    assert decide(LAND, Health(battery=BatteryWarning.EMERGENCY), **PX4_DEFAULTS).mode is LAND


def test_a_lost_remote_control_holds_first():
    action = decide(HOLD, Health(manual_control_lost=True), **PX4_DEFAULTS)
    assert (action.mode, action.delayed) == (RETURN, True)
    assert decide(HOLD, Health(manual_control_lost=True), **{**PX4_DEFAULTS, "manual_loss": 0}).mode is None


@pytest.mark.parametrize(
    ("parameter", "warning", "mode"),
    [
        (0, BatteryWarning.EMERGENCY, None),
        (1, BatteryWarning.CRITICAL, RETURN),
        (1, BatteryWarning.EMERGENCY, RETURN),
        (3, BatteryWarning.LOW, None),
        (3, BatteryWarning.CRITICAL, RETURN),
        (3, BatteryWarning.EMERGENCY, LAND),
        (2, BatteryWarning.CRITICAL, LAND),
    ],
)
def test_the_battery_decides_by_its_parameter(parameter, warning, mode):
    health = Health(offboard_signal=True, battery=warning)
    assert decide(OFFBOARD, health, **{**PX4_DEFAULTS, "low_battery": parameter}).mode is mode


def test_offboard_by_rates_needs_no_position_and_position_modes_do():
    blind = Health(offboard_signal=True, position=False, manual_control=True)
    assert can_run(OFFBOARD, blind)
    assert can_run(FlightMode.STABILIZED, blind)
    assert not can_run(FlightMode.STABILIZED, Health(position=True))
    assert sustains(FlightMode.STABILIZED, Health(position=True))
    assert not any(can_run(mode, blind) for mode in (HOLD, LAND, RETURN, POSITION, FlightMode.TAKEOFF))
