"""Faults: what each does, how it ends, how it is written down."""

import re
from math import isnan, nan

import pytest
from support.px4_talk import command, fly, named

from daemon.messages import FlightMode
from daemon.sim import airframe_files
from daemon.sim.faults import (
    FAULTS,
    ArmingRefused,
    BatteryLow,
    FrozenTelemetry,
    KillSwitch,
    Link,
    ModesRefused,
    MotorEfficiency,
    NanTelemetry,
    NoAcks,
    Payload,
    PilotTakesOver,
    SteadyWind,
    StoppedTelemetry,
    WindGust,
    from_mapping,
)
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.scenario import scenario

SIH = airframe_files.load("sih")


@pytest.fixture
def px4():
    vehicle = SimulatedPx4(airframe=SIH, noise=False)
    vehicle.start_in_air(10.0)
    fly(vehicle, 0.2)
    return vehicle


def test_a_silent_downlink_says_nothing_for_its_duration_and_the_uplink_goes_on(px4):
    px4.inject(Link(direction="down", silent=True, duration_s=0.5))
    command(px4, 21)
    assert fly(px4, 0.496) == []
    assert px4.mode is FlightMode.LAND
    assert fly(px4, 0.5)


def test_a_silent_uplink_brings_no_command(px4):
    px4.inject(Link(direction="up", silent=True, duration_s=0.5))
    command(px4, 21)
    assert named(fly(px4, 0.4), "ODOMETRY")
    assert px4.mode is FlightMode.HOLD
    fly(px4, 0.2)
    command(px4, 21)
    fly(px4, 0.1)
    assert px4.mode is FlightMode.LAND


def test_a_slow_uplink_delays_a_command(px4):
    px4.inject(Link(direction="up", delay_s=0.3))
    command(px4, 21)
    fly(px4, 0.28)
    assert px4.mode is FlightMode.HOLD
    fly(px4, 0.05)
    assert px4.mode is FlightMode.LAND


def test_frozen_odometry_keeps_its_values_with_new_stamps_and_thaws(px4):
    px4.inject(WindGust(north_m_s=8.0, duration_s=1.5))
    px4.inject(FrozenTelemetry(duration_s=0.5))
    frozen = named(fly(px4, 0.49), "ODOMETRY")
    assert len({odometry["x"] for odometry in frozen}) == 1
    stamps = [odometry["time_usec"] for odometry in frozen]
    assert stamps == sorted(set(stamps))
    assert len({odometry["x"] for odometry in named(fly(px4, 0.5), "ODOMETRY")}) > 5


def test_stuck_stamps_stand_still_too(px4):
    px4.inject(FrozenTelemetry(stamps_advance=False))
    assert len({odometry["time_usec"] for odometry in named(fly(px4, 0.5), "ODOMETRY")}) == 1


def test_nan_and_stopped_telemetry_touch_only_their_messages(px4):
    px4.inject(NanTelemetry(duration_s=0.3))
    spoilt = fly(px4, 0.29)
    assert all(isnan(odometry["x"]) and isnan(odometry["q"][0]) for odometry in named(spoilt, "ODOMETRY"))
    assert not any(isnan(attitude["roll"]) for attitude in named(spoilt, "ATTITUDE"))
    px4.inject(StoppedTelemetry(messages=("ODOMETRY", "HIGHRES_IMU"), duration_s=0.3))
    stopped = fly(px4, 0.29)
    assert not named(stopped, "ODOMETRY")
    assert not named(stopped, "HIGHRES_IMU")
    assert named(stopped, "ATTITUDE")
    assert named(fly(px4, 0.3), "ODOMETRY")[-1]["x"] == pytest.approx(0.0, abs=0.1)


def test_wind_pushes_and_calms(px4):
    px4.inject(SteadyWind(north_m_s=5.0, duration_s=1.0))
    fly(px4, 0.9)
    assert px4.truth.velocity_ned_m_s[0] > 0.5
    fly(px4, 0.2)
    assert px4.wind.steady_ned_m_s == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("fault", [Payload(mass_kg=0.3), MotorEfficiency(rotor=2, efficiency=0.7)])
def test_weight_and_weak_motors_cost_height_for_a_moment(px4, fault):
    px4.inject(fault)
    fly(px4, 0.5)
    assert px4.height_m < 9.98
    px4.faults.clear()
    assert (px4.payload_kg, px4.rotor_efficiency) == (0.0, (1.0,) * 4)


def test_a_low_battery_is_acted_upon(px4):
    px4.inject(BatteryLow(fraction=0.06))
    fly(px4, 0.3)
    assert px4.mode is FlightMode.HOLD
    assert px4.commander.status.name == "CRITICAL"
    fly(px4, 5.2)
    assert px4.mode is FlightMode.RETURN


@pytest.mark.parametrize("mode", ["position", "altitude", "stabilized", "acro", "hold", "land", "return"])
def test_the_pilot_takes_every_mode(px4, mode):
    px4.inject(PilotTakesOver(mode=mode))
    fly(px4, 0.1)
    assert px4.mode is FlightMode(mode)
    assert px4.commander.intended is FlightMode(mode)
    fly(px4, 2.0)
    assert px4.mode is FlightMode(mode)


def test_the_pilots_stick_flies_in_position_mode(px4):
    px4.inject(PilotTakesOver(mode="position", forward=0.3))
    fly(px4, 3.0)
    assert px4.truth.velocity_ned_m_s[0] > 1.5
    assert px4.height_m == pytest.approx(10.0, abs=0.3)


def test_the_kill_switch_stops_the_motors_and_releases(px4):
    px4.inject(KillSwitch(duration_s=0.3))
    fly(px4, 0.1)
    assert px4.signals == (0.0,) * 4
    fly(px4, 0.3)
    assert min(px4.signals) > 0.1


def test_refusals_and_missing_acks():
    px4 = SimulatedPx4(airframe=SIH, noise=False)
    px4.inject(ArmingRefused(duration_s=1.0))
    fly(px4, 0.1)
    command(px4, 400, 1.0)
    assert [ack["result"] for ack in named(fly(px4, 0.1), "COMMAND_ACK")] == [1]
    fly(px4, 1.0)
    px4.inject(NoAcks(duration_s=0.5))
    command(px4, 400, 1.0)
    assert not named(fly(px4, 0.5), "COMMAND_ACK")
    assert px4.armed
    px4.inject(ModesRefused(modes=("land",), duration_s=0.5))
    command(px4, 176, 1.0, 4.0, 6.0)
    assert [ack["result"] for ack in named(fly(px4, 0.1), "COMMAND_ACK")] == [0, 1]


def test_a_scenario_happens_when_it_says():
    px4 = SimulatedPx4(airframe=SIH, noise=False)
    items = [
        {"at_s": 2.0, "fault": "wind", "north_m_s": 4, "duration_s": 1.0},
        {"at_s": 1.0, "fault": "payload", "mass_kg": 0.2},
    ]
    assert [entry.at_s for entry in scenario(items)] == [1.0, 2.0]
    px4.faults.schedule(scenario(items))
    fly(px4, 0.99)
    assert px4.payload_kg == 0.0
    fly(px4, 0.02)
    assert px4.payload_kg == 0.2
    fly(px4, 1.0)
    assert px4.wind.steady_ned_m_s == (4.0, 0.0, 0.0)
    fly(px4, 1.0)
    assert px4.wind.steady_ned_m_s == (0.0, 0.0, 0.0)
    assert px4.faults.clear("payload") == 1
    assert px4.payload_kg == 0.0


@pytest.mark.parametrize("name", sorted(FAULTS))
def test_every_fault_can_be_written_down_flown_and_cleared(name):
    px4 = SimulatedPx4(airframe=SIH, noise=True)
    px4.start_in_air(20.0)
    px4.inject(from_mapping({"fault": name}))
    fly(px4, 0.5)
    px4.faults.clear()
    assert px4.faults.active == []
    fly(px4, 0.3)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"fault": "nonsense"}, "fault: 'nonsense'"),
        ({}, "fault: None"),
        ({"fault": "wind", "northwards": 3}, "wind.northwards: unknown"),
        ({"fault": "wind", "north_m_s": "fast"}, "wind.north_m_s: 'fast' is not a number"),
        ({"fault": "wind", "north_m_s": nan}, "wind.north_m_s: nan"),
        ({"fault": "motor_efficiency", "rotor": 1.5}, "motor_efficiency.rotor: 1.5 is not a whole number"),
        ({"fault": "link", "direction": "sideways"}, "link.direction: 'sideways'"),
        ({"fault": "link", "silent": 1}, "link.silent: 1 is not true or false"),
        ({"fault": "pilot", "mode": "upside_down"}, "pilot.mode: 'upside_down'"),
        ({"fault": "modes_refused", "modes": ["loiter"]}, "modes_refused.modes: 'loiter'"),
        ({"fault": "ekf_reset", "kind": "all"}, "ekf_reset.kind: 'all'"),
        ({"fault": "gps_loss", "duration_s": -1.0}, "gps_loss.duration_s: -1.0 is not in 0 to inf"),
        ({"fault": "gps_loss", "at_s": 3.0}, "gps_loss.at_s: unknown"),
    ],
)
def test_a_wrong_fault_is_refused_by_its_key(data, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        from_mapping(data)


def test_a_fault_that_does_not_fit_the_vehicle_is_refused(px4):
    with pytest.raises(ValueError, match="rotor: 7 is not in 0 to 3"):
        px4.inject(MotorEfficiency(rotor=7))
    with pytest.raises(ValueError, match="fault: 'rain'"):
        px4.faults.clear("rain")
