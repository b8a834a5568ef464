"""Modes, commands and decoders against numbers recorded from PX4 1.17."""

from math import isnan, nan

import pytest

from daemon.autopilot import decode, events
from daemon.autopilot.port import Command, CommandKind
from daemon.autopilot.px4 import (
    attitude_target,
    encode_command,
    is_armed,
    is_requestable,
    mode_from_custom,
    set_message_interval,
    set_mode,
)
from daemon.messages import FlightMode, Setpoint

RECORDED_MODES = {
    50593792: FlightMode.HOLD,
    0x02040000: FlightMode.TAKEOFF,
    0x05040000: FlightMode.RETURN,
    0x06040000: FlightMode.LAND,
    0x00060000: FlightMode.OFFBOARD,
    0x00030000: FlightMode.POSITION,
}
# Not recorded: px4_custom_mode.h.
DOCUMENTED_MODES = {
    0x01030000: FlightMode.ORBIT,
    0x02030000: FlightMode.POSITION_SLOW,
    0x0A040000: FlightMode.VTOL_TAKEOFF,
    0x13040000: FlightMode.GUIDED_COURSE,
    0x000A0000: FlightMode.TERMINATION,
    0x000B0000: FlightMode.ALTITUDE_CRUISE,
}


def asked_word(mode: FlightMode) -> int:
    """PX4 makes its word of main mode and sub-mode of a request: px4_custom_mode.h."""
    _, fields = set_mode(mode, armed=True)
    return int(fields["param2"]) << 16 | int(fields["param3"]) << 24


@pytest.mark.parametrize(("custom_mode", "mode"), (RECORDED_MODES | DOCUMENTED_MODES).items())
def test_custom_modes_are_named(custom_mode: int, mode: FlightMode) -> None:
    assert mode_from_custom(custom_mode) is mode
    assert asked_word(mode) == custom_mode


def test_every_mode_that_can_be_asked_for_comes_back_from_its_word() -> None:
    modes = [mode for mode in FlightMode if is_requestable(mode)]
    assert len(modes) == len(FlightMode) - 2
    assert all(mode_from_custom(asked_word(mode)) is mode for mode in modes)


def test_unknown_and_external_words_do_not_pass_for_a_mode() -> None:
    assert mode_from_custom(42 << 16) is FlightMode.UNKNOWN
    assert mode_from_custom(4 << 16 | 12 << 24) is FlightMode.EXTERNAL
    assert not is_requestable(FlightMode.UNKNOWN)


def test_base_mode_of_the_recordings_tells_armed() -> None:
    assert [is_armed(base) for base in (29, 157, 129, 209, 1)] == [False, True, True, True, False]


def test_offboard_is_asked_for_as_recorded() -> None:
    name, fields = set_mode(FlightMode.OFFBOARD, armed=True)
    assert name == "COMMAND_LONG"
    assert (fields["command"], fields["param1"], fields["param2"], fields["param3"]) == (176, 129.0, 6.0, 0.0)
    assert all(isnan(fields[f"param{index}"]) for index in (4, 5, 6, 7))
    assert set_mode(FlightMode.HOLD, armed=False)[1]["param1"] == 1.0


def test_takeoff_carries_only_its_altitude() -> None:
    fields = encode_command(Command(CommandKind.TAKEOFF, altitude_amsl_m=494.4))[1]
    assert (fields["command"], fields["param7"]) == (22, 494.4)
    assert all(isnan(fields[f"param{index}"]) for index in range(1, 7))


def test_arm_and_disarm_differ_in_the_first_parameter() -> None:
    arm, disarm = encode_command(Command(CommandKind.ARM))[1], encode_command(Command(CommandKind.DISARM))[1]
    assert (arm["command"], arm["param1"], disarm["command"], disarm["param1"]) == (400, 1.0, 400, 0.0)


def test_message_interval_is_in_microseconds() -> None:
    fields = set_message_interval(115, 50.0)[1]
    assert (fields["command"], fields["param1"], fields["param2"], fields["param7"]) == (511, 115.0, 20000.0, 0.0)


def test_rates_leave_in_radians_with_the_attitude_masked() -> None:
    name, fields = attitude_target(Setpoint((0.1, -0.2, 0.3), 0.49))
    assert name == "SET_ATTITUDE_TARGET"
    assert fields["type_mask"] == 128
    assert (fields["body_roll_rate"], fields["body_pitch_rate"], fields["body_yaw_rate"]) == (0.1, -0.2, 0.3)
    assert fields["thrust"] == 0.49


ODOMETRY = {
    "time_usec": 6168000, "frame_id": 1, "child_frame_id": 1, "x": 0.0217, "y": 0.0134, "z": -0.0289,
    "q": [0.999985, 0.000217, 0.000345, -0.00546], "vx": 0.0276, "vy": 0.0152, "vz": -0.0062,
    "rollspeed": -0.0013, "pitchspeed": 0.0019, "yawspeed": -0.0029,
    "pose_covariance": [0.031, 0, 0, 0, 0, 0, 0.0308, 0, 0, 0, 0, 0.00517, 0, 0, 0, 0.00042, 0, 0, 0.00042, 0, 0.0377],
    "velocity_covariance": [0.0148, 0, 0, 0, 0, 0, 0.0147, 0, 0, 0, 0, 0.0013, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    "reset_counter": 11, "estimator_type": 8, "quality": 0,
}  # fmt: skip


def test_odometry_comes_out_as_recorded() -> None:
    odometry = decode.odometry(ODOMETRY, 7.5)
    assert (odometry.stamp_us, odometry.arrival_s, odometry.reset_counter) == (6168000, 7.5, 11)
    assert (odometry.frame_id, odometry.child_frame_id) == (1, 1)
    assert odometry.position_m == (0.0217, 0.0134, -0.0289)
    assert odometry.velocity_m_s == (0.0276, 0.0152, -0.0062)
    assert odometry.attitude_wb == (0.999985, 0.000217, 0.000345, -0.00546)
    assert odometry.rates_frd_rad_s == (-0.0013, 0.0019, -0.0029)
    assert odometry.position_variance_m2 == (0.031, 0.0308, 0.00517)
    assert odometry.velocity_variance_m2_s2 == (0.0148, 0.0147, 0.0013)


def test_a_missing_number_is_nan_not_zero() -> None:
    odometry = decode.odometry(ODOMETRY | {"x": None, "pose_covariance": [None] * 21}, 0.0)
    assert isnan(odometry.position_m[0])
    assert all(isnan(value) for value in odometry.position_variance_m2)
    assert decode.home_ned({"x": None, "y": 0.0, "z": 0.0}) is None
    assert decode.home_ned({"x": nan, "y": 0.0, "z": 0.0}) is None


def test_global_position_and_battery_units() -> None:
    place = decode.global_position({"lat": 473977438, "lon": 85455942, "alt": 489386}, "lat", "lon", "alt")
    assert place.latitude_deg == pytest.approx(47.3977438, abs=1e-9)
    assert place.longitude_deg == pytest.approx(8.5455942, abs=1e-9)
    assert place.altitude_amsl_m == pytest.approx(489.386)
    assert decode.battery_fraction({"battery_remaining": 45}) == pytest.approx(0.45)
    assert decode.battery_fraction({"battery_remaining": -1}) is None


@pytest.mark.parametrize(
    ("event_id", "arguments", "mode", "intended"),
    [
        (31382480, "0000060006", FlightMode.RETURN, FlightMode.OFFBOARD),
        (30481910, "0000060006050001", FlightMode.HOLD, FlightMode.OFFBOARD),
        (26528394, "000004030705", FlightMode.LAND, FlightMode.HOLD),
    ],
)
def test_failsafe_events_name_the_modes_that_telemetry_showed_afterwards(
    event_id: int, arguments: str, mode: FlightMode, intended: FlightMode
) -> None:
    for raw in (arguments, list(bytes.fromhex(arguments).ljust(40, b"\0"))):
        event = events.decode({"id": event_id, "arguments": raw})
        assert (event.mode, event.intended_mode) == (mode, intended)


def test_a_refusal_names_only_the_checks_that_forbid_the_mode() -> None:
    reasons = events.Reasons()
    for event_id, arguments in (
        (27825120, "008000120100000000802a0180803a0180"),
        (30612409, "7c007e0011"),  # no valid position: Hold yes, Offboard no
        (19865031, "0040000014"),  # no offboard signal
    ):
        reasons.note(events.decode({"id": event_id, "arguments": arguments}), 1.0)
    reasons.note(events.decode({"id": 16910493, "arguments": ""}), 2.0)
    assert reasons.why(1, FlightMode.HOLD, 2.0) == (
        "temporarily rejected; arming denied: resolve system health failures first; no valid position estimate"
    )
    assert reasons.why(1, FlightMode.OFFBOARD, 3.0) == "temporarily rejected; no offboard signal"
    reasons.note(events.decode({"id": 27825120, "arguments": "00"}), 4.0)
    assert reasons.why(2, FlightMode.OFFBOARD, 4.0) == "denied"


def test_what_the_autopilot_says_twice_is_told_once() -> None:
    reasons = events.Reasons()
    for time_s in (2.0, 2.05):
        reasons.note(events.decode({"id": 16910493, "arguments": ""}), time_s)
    assert reasons.why(1, FlightMode.HOLD, 2.1) == (
        "temporarily rejected; arming denied: resolve system health failures first"
    )
