"""What waited for us while we stood still, or in a radio, does not pass for what the autopilot is doing now."""

import pytest
from support.session_rig import HOLD, OFFBOARD, RETURN, current_mode, heartbeat, odometry

from daemon.autopilot.session import Px4Session
from daemon.messages import FlightMode

AHEAD_NS = 7_000_000_000
STOOD_S = 3.0


def answered(session: Px4Session, now_s: float) -> None:
    """The autopilot answers every TIMESYNC request that leaves now."""
    session.poll(now_s)
    for name, fields in session.take_outgoing():
        if name == "TIMESYNC":
            session.receive(name, {"tc1": fields["ts1"] + AHEAD_NS, "ts1": fields["ts1"]}, now_s + 0.001)


@pytest.fixture
def flying(session: Px4Session) -> Px4Session:
    """In OFFBOARD, TIMESYNC answered ten times a second until 1.0 s; one request is under way."""
    for i in range(10):
        session.receive("HEARTBEAT", heartbeat(OFFBOARD), 0.1 * (i + 1))
        answered(session, 0.1 * (i + 1))
    session.poll(1.1)
    return session


@pytest.mark.parametrize("polled_first", [True, False])
@pytest.mark.parametrize("hot", [True, False])
def test_after_a_standstill_nothing_is_heard_nor_connected_until_timesync_answers_a_request_made_since(
    flying: Px4Session, polled_first: bool, hot: bool
) -> None:
    under_way = next(fields["ts1"] for name, fields in flying.take_outgoing() if name == "TIMESYNC")
    if polled_first:
        flying.poll(STOOD_S)
        assert not flying.status.value.connected
    if hot:
        flying.receive_sample("ODOMETRY", odometry(1_200_000), STOOD_S)
    flying.receive("HEARTBEAT", heartbeat(OFFBOARD), STOOD_S)
    flying.receive("CURRENT_MODE", current_mode(OFFBOARD), STOOD_S)
    flying.receive("TIMESYNC", {"tc1": under_way + AHEAD_NS, "ts1": under_way}, STOOD_S)
    flying.receive("HEARTBEAT", heartbeat(OFFBOARD), STOOD_S)
    assert (flying.status.value.heard, flying.status.value.connected) == (False, not polled_first)
    answered(flying, STOOD_S + 0.01)
    assert not flying.status.value.heard, "the mode is still of the past"
    flying.receive("HEARTBEAT", heartbeat(RETURN), STOOD_S + 0.02)
    status = flying.status.value
    assert (status.heard, status.connected, status.mode) == (True, True, FlightMode.RETURN)


@pytest.mark.parametrize("backlog_s", [0.0, 0.005])
def test_who_is_told_that_it_stood_still_hears_nothing_until_an_answer_to_what_it_asks_at_once(
    flying: Px4Session, backlog_s: float
) -> None:
    """Also where the clock did not see it pass: a machine that was suspended."""
    now_s = STOOD_S if backlog_s else 1.11
    flying.take_outgoing()
    flying.stood_still(now_s)
    asked = [fields["ts1"] for name, fields in flying.take_outgoing() if name == "TIMESYNC"]
    for _ in range(3):
        flying.receive_sample("ODOMETRY", odometry(1_200_000), now_s + backlog_s)
        flying.receive("CURRENT_MODE", current_mode(OFFBOARD), now_s + backlog_s)
        assert not flying.status.value.heard
    flying.receive("TIMESYNC", {"tc1": asked[-1] + AHEAD_NS, "ts1": asked[-1]}, now_s + 0.02)
    assert not flying.status.value.heard, "the mode is still of the past"
    flying.receive("CURRENT_MODE", current_mode(RETURN), now_s + 0.02)
    assert (flying.status.value.heard, flying.status.value.mode) == (True, FlightMode.RETURN)


def test_a_gap_that_no_message_waits_through_costs_nothing(flying: Px4Session) -> None:
    flying.receive("HEARTBEAT", heartbeat(OFFBOARD), 1.19)
    flying.receive("HEARTBEAT", heartbeat(HOLD), 1.38)
    assert flying.status.value.heard


def test_before_anything_was_ever_heard_nothing_is_asked_and_no_stream_is_missed() -> None:
    session = Px4Session()
    for i in range(100):
        session.poll(2.0 + 0.1 * i)
    assert session.take_outgoing() == []
    assert session.slow_streams.value == ()


def test_an_autopilot_that_never_answered_timesync_is_believed(session: Px4Session) -> None:
    session.poll(2.0)
    assert not session.status.value.connected
    session.receive("HEARTBEAT", heartbeat(RETURN), 3.0)
    assert (session.status.value.heard, session.status.value.connected) == (True, True)


def test_an_autopilot_that_does_not_answer_any_more_is_believed_after_five_seconds_of_messages_and_told_of(
    flying: Px4Session,
) -> None:
    """Else its vehicle could not be brought down any more."""
    heard_s = None
    for i in range(100):
        now_s = STOOD_S + 0.1 * i
        flying.receive("HEARTBEAT", heartbeat(RETURN), now_s)
        flying.poll(now_s)
        if flying.status.value.heard and heard_s is None:
            heard_s = now_s - STOOD_S
    assert heard_s == pytest.approx(5.0, abs=0.2)
    assert (flying.status.value.heard, flying.status.value.connected) == (True, True)
    assert "answers to TIMESYNC" in flying.slow_streams.value


def test_a_silence_within_these_seconds_begins_them_anew(flying: Px4Session) -> None:
    for i in range(100):
        now_s = STOOD_S + 0.1 * i + 1.0 * (i // 30)
        flying.receive("HEARTBEAT", heartbeat(RETURN), now_s)
        flying.poll(now_s)
        assert not flying.status.value.heard


@pytest.mark.parametrize("there_and_back_s", [1.5, 3.0])
def test_a_radio_that_takes_seconds_is_heard_as_late_as_that(flying: Px4Session, there_and_back_s: float) -> None:
    waiting: list[tuple[float, int]] = []
    heard_s = None
    for i in range(60):
        now_s = STOOD_S + 0.1 * i
        flying.receive("HEARTBEAT", heartbeat(RETURN), now_s)
        flying.poll(now_s)
        waiting += [(now_s, fields["ts1"]) for name, fields in flying.take_outgoing() if name == "TIMESYNC"]
        while waiting and waiting[0][0] + there_and_back_s <= now_s:
            ts1 = waiting.pop(0)[1]
            flying.receive("TIMESYNC", {"tc1": ts1 + AHEAD_NS, "ts1": ts1}, now_s)
        if flying.status.value.heard and heard_s is None:
            heard_s = now_s - STOOD_S
    assert heard_s == pytest.approx(there_and_back_s, abs=0.25)


def test_a_link_that_answers_late_but_steadily_is_heard(flying: Px4Session) -> None:
    """Half a second there and back, as over a mobile network: the requests overlap."""
    waiting: list[tuple[float, int]] = []
    for i in range(30):
        now_s = STOOD_S + 0.1 * i
        flying.receive("HEARTBEAT", heartbeat(RETURN), now_s)
        flying.poll(now_s)
        asked = [fields["ts1"] for name, fields in flying.take_outgoing() if name == "TIMESYNC"]
        waiting += [(now_s + 0.5, ts1) for ts1 in asked]
        while waiting and waiting[0][0] <= now_s:
            ts1 = waiting.pop(0)[1]
            flying.receive("TIMESYNC", {"tc1": ts1 + AHEAD_NS, "ts1": ts1}, now_s)
    assert flying.status.value.heard
