"""When the autopilot is connected, lost or rebooted, which samples count, and what is asked for again."""

from typing import Any

import pytest
from support.session_rig import HOLD, LAND, RETURN, ack, current_mode, heartbeat, odometry, requested_ids

from daemon.autopilot.session import Px4Session
from daemon.autopilot.streams import STREAMS
from daemon.messages import FlightMode, LandedState, SystemStatus


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
    session.poll(1.9)
    assert session.status.value.connected
    session.poll(1.91)
    assert not session.status.value.connected
    session.receive("ODOMETRY", odometry(2000), 3.0)
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}
    assert not session.status.value.connected
    session.receive("HEARTBEAT", heartbeat(RETURN, system_status=5), 3.2)
    assert session.status.value.connected
    assert session.status.value.mode is FlightMode.RETURN


@pytest.mark.parametrize("hot", [True, False])
def test_after_two_tenths_of_silence_the_mode_is_asked_for_at_once_and_counts_when_it_is_told(
    session: Px4Session, hot: bool
) -> None:
    session.receive("ODOMETRY", odometry(1000), 1.0)
    session.poll(1.19)
    assert session.status.value.heard
    session.poll(1.21)
    assert (session.status.value.heard, session.status.value.connected) == (False, True)
    session.take_outgoing()
    if hot:
        session.receive_sample("ODOMETRY", odometry(700_000), 1.7)
        session.poll(1.7)
    else:
        session.receive("EXTENDED_SYS_STATE", {"landed_state": 2}, 1.7)
    assert requested_ids(session, 512) == {0}
    session.receive("EXTENDED_SYS_STATE", {"landed_state": 2}, 1.75)
    assert requested_ids(session, 512) == set(), "it has a tenth of a second to answer"
    assert not session.status.value.heard, "the mode may be another one since"
    session.receive("CURRENT_MODE", current_mode(RETURN), 1.76)
    assert session.status.value.heard


def test_before_the_first_heartbeat_nothing_is_heard() -> None:
    session = Px4Session()
    session.receive("ODOMETRY", odometry(1000), 1.0)
    session.poll(1.0)
    assert not session.status.value.heard


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


def listen(
    session: Px4Session, *, answers: int, mode_period: int, imu_period: int = 2, first: int = 0, knows_time: bool = True
) -> set[int]:
    """A period of every stream as PX4 sends it, two with so many ticks of 10 ms between; what is asked for again."""
    asked: set[int] = set()
    for _ in range(answers):
        session.receive("COMMAND_ACK", ack(511, 0), 0.01 * first)
    for tick in range(first, first + 205):
        now_s = 0.01 * tick
        session.receive("ODOMETRY", odometry(1000 + tick * 10_000), now_s)
        session.receive("HIGHRES_IMU", imu(tick * 10_000), now_s) if tick % imu_period == 0 else None
        session.receive("CURRENT_MODE", current_mode(HOLD), now_s) if tick % mode_period == 7 else None
        if tick % 20 == 0:
            session.receive("EXTENDED_SYS_STATE", {"landed_state": 1}, now_s)
            session.receive("SYS_STATUS", {"battery_remaining": 100}, now_s)
        session.poll(now_s)
        for name, fields in session.take_outgoing():
            if name == "TIMESYNC" and knows_time:
                session.receive(name, {"tc1": fields["ts1"] + 7_000_000_000, "ts1": fields["ts1"]}, now_s)
            asked |= {int(fields["param1"])} if fields.get("command") == 511 else set()
    return asked


def test_an_autopilot_that_does_not_answer_timesync_is_told_of(session: Px4Session) -> None:
    """By its answers alone it is known that what comes is of now."""
    assert listen(session, answers=len(STREAMS), mode_period=50, knows_time=False) == set()
    assert session.slow_streams.value == ("answers to TIMESYNC",)
    session.receive("TIMESYNC", {"tc1": 0, "ts1": 5_276_000_000}, 2.05)
    listen(session, answers=0, mode_period=50, first=205)
    assert session.slow_streams.value == ()


def test_streams_that_come_too_slowly_are_named_and_asked_for_again(session: Px4Session) -> None:
    assert listen(session, answers=len(STREAMS), mode_period=50, imu_period=4) == {105}
    assert session.monitor.slow == session.slow_streams.value == ("HIGHRES_IMU",)


def test_current_mode_at_the_autopilots_own_rate_is_one_of_them(session: Px4Session) -> None:
    """0.5 Hz unasked, 2 Hz when asked for: a pilot's switch shows up to 2 s late, or within 28 ms."""
    assert listen(session, answers=len(STREAMS), mode_period=200) == {436}
    assert session.slow_streams.value == ("CURRENT_MODE",)
    assert listen(session, answers=1, mode_period=50, first=205) == set()
    assert session.slow_streams.value == ()


def test_all_streams_are_asked_for_again_when_an_acknowledgement_is_missing(session: Px4Session) -> None:
    """PX4 says nothing of its origin until that moves: a request for this stream that was lost shows in no rate."""
    assert listen(session, answers=len(STREAMS) - 1, mode_period=50) == {stream.message_id for stream in STREAMS}
    assert session.slow_streams.value == ()


def test_the_origin_is_asked_for_after_each_reset_of_the_estimate(session: Px4Session) -> None:
    asked = []
    for tick, counter in enumerate((11, 11, 12, 12, 0)):
        session.receive("ODOMETRY", odometry(1000 + 10_000 * tick, reset_counter=counter), 0.01 * tick)
        session.poll(0.01 * tick)
        asked.append(requested_ids(session, 512))
    assert asked == [set(), set(), {49}, set(), {49}]


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


def test_places_that_never_came_are_asked_for_again(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(HOLD), 0.1)
    session.receive("ODOMETRY", odometry(1000), 2.0)
    session.poll(2.1)
    assert requested_ids(session, 512) == {242, 49}


def test_samples_on_the_hot_path_alone_bring_a_lost_link_back(session: Px4Session) -> None:
    session.poll(1.6)
    session.take_outgoing()
    session.receive_sample("ODOMETRY", odometry(1000), 2.0)
    session.poll(2.02)
    assert requested_ids(session) == {stream.message_id for stream in STREAMS}


def test_a_stamp_that_stands_still_passes_on_for_others_to_judge(session: Px4Session) -> None:
    for _ in range(3):
        session.receive("ODOMETRY", odometry(60_000_000), 0.1)
    assert session.odometry.version == 3


@pytest.mark.parametrize("told", [True, False])
def test_streams_are_not_blamed_for_a_standstill_of_ours(session: Px4Session, told: bool) -> None:
    listen(session, answers=len(STREAMS), mode_period=50)
    if told:
        session.stood_still(5.0)
    session.poll(5.0)
    assert session.slow_streams.value == ()
    listen(session, answers=0, mode_period=50, first=500)
    assert session.slow_streams.value == ()
