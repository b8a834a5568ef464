"""The session against the message orders that were recorded from PX4 1.17."""

from typing import Any

import pytest

from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError, LinkError, NotConnectedError
from daemon.autopilot.px4 import command_long
from daemon.autopilot.session import Px4Session, SessionParams
from daemon.autopilot.streams import STREAMS
from daemon.messages import FlightMode, LandedState, SystemStatus

HOLD, OFFBOARD, RETURN, LAND = 0x03040000, 0x00060000, 0x05040000, 0x06040000


def heartbeat(custom_mode: int = HOLD, *, armed: bool = True, system_status: int = 4, **more: Any) -> dict[str, Any]:
    fields = {
        "type": 2, "autopilot": 12, "base_mode": 157 if armed else 29, "custom_mode": custom_mode,
        "system_status": system_status, "mavlink_version": 3,
    }  # fmt: skip
    return fields | more


def current_mode(custom: int, intended: int | None = None) -> dict[str, Any]:
    return {"standard_mode": 0, "custom_mode": custom, "intended_custom_mode": custom if intended is None else intended}


def odometry(stamp_us: int, x: float = 0.0, **more: Any) -> dict[str, Any]:
    fields = {
        "time_usec": stamp_us, "frame_id": 1, "child_frame_id": 1, "x": x, "y": 0.0, "z": 0.0,
        "q": [1.0, 0.0, 0.0, 0.0], "vx": 0.0, "vy": 0.0, "vz": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0,
        "yawspeed": 0.0, "pose_covariance": [0.04] * 21, "velocity_covariance": [0.01] * 21, "reset_counter": 11,
    }  # fmt: skip
    return fields | more


def ack(command: int, result: int, **more: Any) -> dict[str, Any]:
    return {"command": command, "result": result, "target_system": 1, "target_component": 195} | more


@pytest.fixture
def session() -> Px4Session:
    session = Px4Session(SessionParams(system_id=1, component_id=195))
    session.receive("HEARTBEAT", heartbeat(), 0.0)
    session.take_outgoing()
    return session


def requested_ids(session: Px4Session, command: int = 511) -> set[int]:
    return {int(f["param1"]) for _, f in session.take_outgoing() if f.get("command") == command}


def test_the_first_message_asks_for_the_whole_table_once() -> None:
    session = Px4Session()
    session.receive("ATTITUDE", {}, 1.0)
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}
    session.receive("HEARTBEAT", heartbeat(), 1.01)
    assert session.take_outgoing() == []


def test_connected_begins_with_the_heartbeat_that_brings_mode_and_arming() -> None:
    session = Px4Session()
    session.receive("ODOMETRY", odometry(1000), 1.0)
    assert not session.status.value.connected
    session.receive("HEARTBEAT", heartbeat(LAND), 1.5)
    status = session.status.value
    assert (status.connected, status.mode, status.intended_mode) == (True, FlightMode.LAND, FlightMode.LAND)
    assert (status.armed, status.system_status, status.heartbeat_s) == (True, SystemStatus.ACTIVE, 1.5)


@pytest.mark.parametrize("autopilot", [3, 8])
def test_heartbeats_of_others_do_not_connect(autopilot: int) -> None:
    session = Px4Session()
    session.receive("HEARTBEAT", heartbeat(autopilot=autopilot), 1.0)
    assert not session.status.value.connected


def test_silence_is_a_lost_link_and_its_end_asks_for_the_streams_again(session: Px4Session) -> None:
    session.receive("ODOMETRY", odometry(1000), 0.4)
    session.poll(0.9)
    assert session.status.value.connected
    session.poll(0.91)
    assert not session.status.value.connected
    session.receive("ODOMETRY", odometry(2000), 3.0)
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}
    assert not session.status.value.connected
    session.receive("HEARTBEAT", heartbeat(RETURN, system_status=5), 3.2)
    assert session.status.value.connected
    assert session.status.value.mode is FlightMode.RETURN


def test_a_clock_that_begins_anew_is_a_reboot(session: Px4Session) -> None:
    session.receive("ODOMETRY", odometry(60_000_000, x=5.0), 0.1)
    session.receive("EXTENDED_SYS_STATE", {"vtol_state": 0, "landed_state": 2}, 0.1)
    session.receive("ODOMETRY", odometry(59_990_000, x=4.0), 0.11)
    assert session.odometry.value is not None
    assert session.odometry.value.position_m[0] == 5.0  # overtaken, not a reboot
    assert session.status.value.boot_count == 0
    session.receive("ODOMETRY", odometry(3_000_000, x=1.0), 4.2)
    status = session.status.value
    assert (status.boot_count, status.connected, status.landed) == (1, False, LandedState.UNDEFINED)
    assert session.odometry.value.position_m[0] == 1.0
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}


def test_the_hot_path_leaves_a_reboot_to_the_sessions_thread(session: Px4Session) -> None:
    assert session.receive_sample("ODOMETRY", odometry(60_000_000), 0.1)
    assert not session.receive_sample("ODOMETRY", odometry(3_000_000), 4.2)
    assert session.status.value.boot_count == 0


@pytest.mark.parametrize("step_us", [50_000, 200_000, 2_000_000, 30_000_000])
def test_a_clock_that_is_set_back_costs_two_samples_and_is_no_reboot(session: Px4Session, step_us: int) -> None:
    for i in range(20):
        stamp_us = 60_000_000 + 10_000 * i - (step_us if i >= 10 else 0)
        session.receive("ODOMETRY", odometry(stamp_us, x=float(i)), 0.01 * i)
        assert session.odometry.value is not None
        assert session.odometry.value.position_m[0] == (9.0 if i in (10, 11) else float(i))
    assert session.status.value.boot_count == 0


def test_what_timesync_says_is_in_the_clocks_cell_until_the_link_is_lost(session: Px4Session) -> None:
    for i in range(60):
        now_s = 0.02 * i
        session.poll(now_s)
        for name, fields in session.take_outgoing():
            if name == "TIMESYNC":
                answer = {"tc1": fields["ts1"] + 7_001_000_000, "ts1": fields["ts1"]}
                session.receive("TIMESYNC", answer, now_s + 0.002)
    assert session.clock.value is not None
    assert session.clock.value.offset_s == pytest.approx(-7.0, abs=1e-6)
    session.poll(3.0)
    assert session.clock.value is None


def test_the_autopilots_own_time_requests_are_answered_at_once(session: Px4Session) -> None:
    session.receive("TIMESYNC", {"tc1": 0, "ts1": 5_276_000_000}, 1.25)
    assert session.take_outgoing() == [("TIMESYNC", {"tc1": 1_250_000_000, "ts1": 5_276_000_000})]


@pytest.mark.parametrize("late_s", [0.0, 0.013])
def test_the_second_ack_of_a_mode_command_counts(session: Px4Session, late_s: float) -> None:
    assert session.mode_message(FlightMode.OFFBOARD) is not None
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 0), 1.002)
    assert session.status.value.mode_refusal is None
    session.receive("COMMAND_ACK", ack(176, 1), 1.002 + late_s)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert (refusal.mode, refusal.reason, refusal.time_s) == (
        FlightMode.OFFBOARD,
        "temporarily rejected",
        1.002 + late_s,
    )


def test_the_event_after_the_ack_adds_the_reason(session: Px4Session) -> None:
    session.mode_requested(FlightMode.POSITION, 18.009)
    session.receive("COMMAND_ACK", ack(176, 0), 18.012)
    session.receive("COMMAND_ACK", ack(176, 1), 18.021)
    session.receive("EVENT", {"id": 27280279, "arguments": "0000030002"}, 18.025)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert refusal.reason == "temporarily rejected; switching to this mode is currently not possible"
    assert refusal.time_s == 18.021


def test_two_good_acks_are_no_refusal_and_a_new_request_forgets_an_old_refusal(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 0), 1.001)
    session.receive("COMMAND_ACK", ack(176, 2), 1.002)
    assert session.status.value.mode_refusal is not None
    session.mode_requested(FlightMode.HOLD, 2.0)
    assert session.status.value.mode_refusal is None
    session.receive("COMMAND_ACK", ack(176, 0), 2.001)
    session.receive("COMMAND_ACK", ack(176, 0), 2.002)
    assert session.status.value.mode_refusal is None


def test_a_lone_first_ack_does_not_shift_the_acks_of_the_next_request(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 0), 1.001)
    session.mode_requested(FlightMode.HOLD, 1.2)
    session.receive("COMMAND_ACK", ack(176, 0), 1.201)
    session.receive("COMMAND_ACK", ack(176, 1), 1.202)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert refusal.mode is FlightMode.HOLD


def test_acks_meant_for_somebody_else_are_not_ours(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 1, target_system=255, target_component=190), 1.001)
    assert session.status.value.mode_refusal is None


def test_mode_is_the_newest_of_three_messages(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD), 1.0)
    assert session.status.value.mode is FlightMode.OFFBOARD
    session.receive("EVENT", {"id": 31382480, "arguments": "0000060006"}, 2.0)
    status = session.status.value
    assert (status.mode, status.intended_mode) == (FlightMode.RETURN, FlightMode.OFFBOARD)
    session.receive("HEARTBEAT", heartbeat(RETURN, system_status=5), 2.5)
    status = session.status.value
    assert (status.mode, status.intended_mode) == (FlightMode.RETURN, FlightMode.OFFBOARD)
    session.receive("CURRENT_MODE", current_mode(HOLD), 3.0)
    assert (session.status.value.mode, session.status.value.intended_mode) == (FlightMode.HOLD, FlightMode.HOLD)


def test_a_pilots_mode_seen_first_in_the_heartbeat_is_not_taken_for_a_failsafe(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD), 1.0)
    session.receive("HEARTBEAT", heartbeat(HOLD), 1.1)
    assert session.status.value.intended_mode is FlightMode.HOLD


class Outcome:
    def __init__(self) -> None:
        self.calls: list[LinkError | None] = []

    def __call__(self, error: LinkError | None) -> None:
        self.calls.append(error)


def test_a_command_ends_with_its_ack(session: Px4Session) -> None:
    outcome = Outcome()
    session.start_command(command_long(400, 1.0), 1.0, 3.0, outcome)
    assert [fields["command"] for _, fields in session.take_outgoing()] == [400]
    session.receive("COMMAND_ACK", ack(22, 0), 1.01)
    assert outcome.calls == []
    session.receive("COMMAND_ACK", ack(400, 0), 1.02)
    assert outcome.calls == [None]


def test_a_refused_arming_waits_for_the_event_that_explains_it(session: Px4Session) -> None:
    outcome = Outcome()
    session.start_command(command_long(400, 1.0), 0.0, 3.0, outcome)
    session.receive("COMMAND_ACK", ack(400, 1), 0.027)
    session.poll(0.028)
    session.receive("EVENT", {"id": 16910493, "arguments": ""}, 0.031)
    assert outcome.calls == []
    session.poll(0.08)
    (error,) = outcome.calls
    assert isinstance(error, CommandRefusedError)
    assert str(error) == "temporarily rejected; arming denied: resolve system health failures first"


def test_an_unanswered_command_is_repeated_and_then_given_up(session: Px4Session) -> None:
    outcome, repeats = Outcome(), []
    session.start_command(command_long(22), 0.0, 1.2, outcome)
    session.take_outgoing()
    for tick in range(1, 30):
        session.receive("ATTITUDE", {}, tick * 0.05)
        session.poll(tick * 0.05)
        repeats += [f["confirmation"] for _, f in session.take_outgoing() if f.get("command") == 22]
    assert repeats == [1, 2]
    assert [type(error) for error in outcome.calls] == [CommandTimeoutError]


def test_a_command_without_an_autopilot_is_refused_at_once_and_one_that_waits_ends_with_the_link(
    session: Px4Session,
) -> None:
    with pytest.raises(NotConnectedError):
        Px4Session().start_command(command_long(400, 1.0), 0.0, 1.0, Outcome())
    outcome = Outcome()
    session.start_command(command_long(400, 1.0), 0.0, 10.0, outcome)
    session.poll(0.6)
    assert [type(error) for error in outcome.calls] == [NotConnectedError]


def test_parameters_arrive_or_are_unknown_or_time_out(session: Px4Session) -> None:
    got: list[float | int | None] = []
    session.read_parameter("MPC_THR_HOVER", 0.0, 1.0, got.append)
    assert session.take_outgoing()[0][1]["param_id"] == "MPC_THR_HOVER"
    session.receive("PARAM_VALUE", {"param_id": "OTHER", "param_value": 3.0, "param_type": 9}, 0.1)
    session.receive("PARAM_VALUE", {"param_id": "MPC_THR_HOVER", "param_value": 0.5, "param_type": 9}, 0.1)
    session.read_parameter("NO_SUCH_PARAM", 0.1, 1.0, got.append)
    session.receive("PARAM_ERROR", {"param_id": "NO_SUCH_PARAM", "error": 1}, 0.2)
    session.read_parameter("SLOW", 0.2, 0.3, got.append)
    session.poll(0.46)
    assert any(fields.get("param_id") == "SLOW" for _, fields in session.take_outgoing())
    session.poll(0.5)
    assert got == [0.5, None, None]


def test_streams_that_come_too_slowly_are_named_and_asked_for_again(session: Px4Session) -> None:
    for tick in range(220):
        now_s = 0.01 * tick
        session.receive("ODOMETRY", odometry(1000 + tick * 10_000), now_s)
        session.receive("HIGHRES_IMU", imu(tick * 10_000), now_s) if tick % 4 == 0 else None
        if tick % 20 == 0:
            session.receive("EXTENDED_SYS_STATE", {"landed_state": 1}, now_s)
            session.receive("SYS_STATUS", {"battery_remaining": 100}, now_s)
        session.poll(now_s)
    assert session.monitor.slow == ("HIGHRES_IMU",)
    assert [int(f["param1"]) for _, f in session.take_outgoing() if f.get("command") == 511] == [105]


def imu(stamp_us: int) -> dict[str, Any]:
    names = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "xmag", "ymag", "zmag")
    return {"time_usec": stamp_us} | dict.fromkeys(names, 0.0)


def test_a_malformed_message_is_counted_and_changes_nothing(session: Px4Session) -> None:
    before = session.status.value
    session.receive("ODOMETRY", {"time_usec": 1}, 0.1)
    session.receive("HEARTBEAT", {"autopilot": "x"}, 0.1)
    session.receive("EXTENDED_SYS_STATE", {"landed_state": 77}, 0.1)
    session.receive("ODOMETRY", odometry(5) | {"pose_covariance": []}, 0.1)
    assert session.malformed == {"ODOMETRY": 2, "HEARTBEAT": 1, "EXTENDED_SYS_STATE": 1}
    assert session.status.value == before
    assert session.odometry.value is None


def test_status_takes_places_and_battery(session: Px4Session) -> None:
    session.receive("SYS_STATUS", {"battery_remaining": 45}, 0.1)
    session.receive("GPS_GLOBAL_ORIGIN", {"latitude": 473977436, "longitude": 85455940, "altitude": 489397}, 0.1)
    session.receive(
        "HOME_POSITION",
        {"latitude": 473977436, "longitude": 85455940, "altitude": 489397, "x": -0.0028, "y": 0.0026, "z": -0.039},
        0.1,
    )
    status = session.status.value
    assert status.battery_fraction == pytest.approx(0.45)
    assert status.home == status.global_origin
    assert status.home_ned_m == (-0.0028, 0.0026, -0.039)


def test_events_are_kept_as_words(session: Px4Session) -> None:
    session.receive("EVENT", {"id": 22400324, "arguments": ""}, 0.1)
    session.receive("EVENT", {"id": 17154777, "arguments": "0800000014"}, 0.1)
    assert session.take_events() == ["manual control lost"]
    assert session.take_events() == []


def test_places_that_never_came_are_asked_for_again(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(HOLD), 0.1)
    session.receive("ODOMETRY", odometry(1000), 2.0)
    session.poll(2.1)
    assert requested_ids(session, 512) == {242, 49}


def test_a_second_ack_that_comes_very_late_still_refuses(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 0), 1.001)
    session.receive("COMMAND_ACK", ack(176, 1), 1.2)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert refusal.mode is FlightMode.OFFBOARD
    session.mode_requested(FlightMode.HOLD, 3.0)
    session.receive("COMMAND_ACK", ack(176, 1), 4.5)
    assert session.status.value.mode_refusal is None  # too late to be an answer to it


def test_an_ack_that_never_came_does_not_blame_the_wrong_mode(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 0), 1.001)
    session.mode_requested(FlightMode.HOLD, 1.2)
    session.receive("COMMAND_ACK", ack(176, 0), 1.201)
    session.receive("COMMAND_ACK", ack(176, 0), 1.202)
    session.mode_requested(FlightMode.LAND, 1.3)
    session.receive("COMMAND_ACK", ack(176, 2), 1.301)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert (refusal.mode, refusal.reason) == (FlightMode.LAND, "denied")


def test_a_command_in_progress_is_waited_for_and_not_repeated(session: Px4Session) -> None:
    outcome = Outcome()
    session.start_command(command_long(22), 0.0, 5.0, outcome)
    session.take_outgoing()
    session.receive("COMMAND_ACK", ack(22, 5), 0.1)
    for tick in range(1, 20):
        session.receive("ATTITUDE", {}, tick * 0.1)
        session.poll(tick * 0.1)
    assert not [f for _, f in session.take_outgoing() if f.get("command") == 22]
    session.receive("COMMAND_ACK", ack(22, 0), 2.0)
    assert outcome.calls == [None]


def test_a_later_command_of_the_same_number_ends_the_earlier(session: Px4Session) -> None:
    arm, disarm = Outcome(), Outcome()
    session.start_command(command_long(400, 1.0), 0.0, 5.0, arm)
    session.start_command(command_long(400, 0.0), 0.1, 5.0, disarm)
    assert [type(error) for error in arm.calls] == [CommandTimeoutError]
    session.receive("COMMAND_ACK", ack(400, 0), 0.2)
    assert disarm.calls == [None]


def test_samples_on_the_hot_path_alone_bring_a_lost_link_back(session: Px4Session) -> None:
    session.poll(1.0)
    session.take_outgoing()
    session.receive_sample("ODOMETRY", odometry(1000), 2.0)
    session.poll(2.02)
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}


def test_an_intended_mode_that_is_not_told_is_the_mode(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD, 0), 1.0)
    assert session.status.value.intended_mode is FlightMode.OFFBOARD


def test_a_stamp_that_stands_still_passes_on_for_others_to_judge(session: Px4Session) -> None:
    for _ in range(3):
        session.receive("ODOMETRY", odometry(60_000_000), 0.1)
    assert session.odometry.version == 3


def test_a_mode_can_be_asked_for_while_nothing_is_heard_but_not_of_a_stranger(session: Px4Session) -> None:
    assert Px4Session().mode_message(FlightMode.HOLD) is None
    session.poll(10.0)
    assert not session.status.value.connected
    message = session.mode_message(FlightMode.HOLD)
    assert message is not None
    assert message[1]["param1"] == 129.0


def test_the_event_of_a_disarming_shows_before_the_next_heartbeat(session: Px4Session) -> None:
    assert session.status.value.armed
    session.receive("EVENT", {"id": 32794487, "arguments": "04"}, 0.2)
    assert not session.status.value.armed
