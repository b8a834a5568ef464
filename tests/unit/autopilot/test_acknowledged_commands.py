"""How commands, mode requests and parameter reads end: by their answers in PX4's recorded order, or without one."""

from math import nan

import pytest
from support.session_rig import HOLD, LAND, ack, current_mode, heartbeat

from daemon.autopilot.port import CommandRefusedError, CommandTimeoutError, LinkError, NotConnectedError
from daemon.autopilot.px4 import command_long
from daemon.autopilot.session import Px4Session
from daemon.messages import FlightMode


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
    session.mode_requested(FlightMode.HOLD, 2.1)
    session.receive("COMMAND_ACK", ack(176, 0), 2.101)
    session.receive("COMMAND_ACK", ack(176, 1), 2.102)
    refusal = session.status.value.mode_refusal
    assert refusal is not None
    assert refusal.mode is FlightMode.HOLD


def test_acks_meant_for_somebody_else_are_not_ours(session: Px4Session) -> None:
    session.mode_requested(FlightMode.OFFBOARD, 1.0)
    session.receive("COMMAND_ACK", ack(176, 1, target_system=255, target_component=190), 1.001)
    assert session.status.value.mode_refusal is None


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
    session.poll(1.6)
    assert [type(error) for error in outcome.calls] == [NotConnectedError]


def test_parameters_arrive_or_are_unknown_or_time_out(session: Px4Session) -> None:
    got: list[object] = []
    session.read_parameter("MPC_THR_HOVER", 0.0, 1.0, got.append)
    assert session.take_outgoing()[0][1]["param_id"] == "MPC_THR_HOVER"
    session.receive("PARAM_VALUE", {"param_id": "OTHER", "param_value": 3.0, "param_type": 9}, 0.1)
    session.receive("PARAM_VALUE", {"param_id": "MPC_THR_HOVER", "param_value": 0.5, "param_type": 9}, 0.1)
    session.read_parameter("NO_SUCH_PARAM", 0.1, 1.0, got.append)
    session.receive("PARAM_ERROR", {"param_id": "NO_SUCH_PARAM", "error": 1}, 0.2)
    assert got == [0.5, None]
    session.read_parameter("SLOW", 0.2, 0.3, got.append)
    session.poll(0.46)
    assert any(fields.get("param_id") == "SLOW" for _, fields in session.take_outgoing())
    session.poll(0.5)
    assert [type(answer) for answer in got[2:]] == [CommandTimeoutError]


@pytest.mark.parametrize("value", [None, nan])
def test_what_does_not_say_the_value_of_a_parameter_is_no_answer(session: Px4Session, value: float | None) -> None:
    got: list[object] = []
    session.read_parameter("MPC_THR_HOVER", 0.0, 0.3, got.append)
    session.receive("PARAM_VALUE", {"param_id": "MPC_THR_HOVER", "param_value": value, "param_type": 9}, 0.1)
    session.receive("PARAM_ERROR", {"param_id": "MPC_THR_HOVER", "error": 8}, 0.1)
    assert got == []
    session.receive("PARAM_VALUE", {"param_id": "MPC_THR_HOVER", "param_value": 0.5, "param_type": 9}, 0.2)
    assert got == [0.5]


def test_a_read_ends_with_the_link_and_with_a_later_one_of_its_name(session: Px4Session) -> None:
    got: list[object] = []
    session.read_parameter("MPC_THR_HOVER", 0.0, 5.0, got.append)
    session.read_parameter("MPC_THR_HOVER", 0.1, 5.0, got.append)
    session.poll(1.6)
    assert [type(answer) for answer in got] == [CommandTimeoutError, NotConnectedError]


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
    assert refusal is None or refusal.mode is not FlightMode.LAND  # which has no ack of its own
    session.receive("COMMAND_ACK", ack(176, 0), 1.302)
    session.receive("COMMAND_ACK", ack(176, 2), 1.303)
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


def test_a_command_that_was_withdrawn_ends_and_is_not_sent_again(session: Px4Session) -> None:
    outcome, later = Outcome(), Outcome()
    session.start_command(command_long(22), 0.0, 5.0, outcome)
    session.withdraw_commands()
    assert [type(error) for error in outcome.calls] == [CommandTimeoutError]
    session.take_outgoing()
    session.receive("ATTITUDE", {}, 0.6)
    session.poll(0.6)
    assert not [f for _, f in session.take_outgoing() if f.get("command") == 22]
    session.start_command(command_long(22), 0.7, 5.0, later)
    session.receive("COMMAND_ACK", ack(22, 0), 0.8)
    assert (len(outcome.calls), later.calls) == (1, [None])


@pytest.mark.parametrize("mode", [HOLD, LAND])
def test_no_command_is_repeated_once_the_mode_has_changed(session: Px4Session, mode: int) -> None:
    outcome = Outcome()
    session.start_command(command_long(400, 1.0), 0.0, 1.0, outcome)
    session.take_outgoing()
    session.receive("CURRENT_MODE", current_mode(mode), 0.4)
    session.poll(0.6)
    repeats = [f for _, f in session.take_outgoing() if f.get("command") == 400]
    assert len(repeats) == (mode == HOLD)
    assert outcome.calls == []
    session.receive("COMMAND_ACK", ack(400, 0), 0.7)
    assert outcome.calls == [None]


def test_a_mode_can_be_asked_for_while_nothing_is_heard_but_not_of_a_stranger(session: Px4Session) -> None:
    assert Px4Session().mode_message(FlightMode.HOLD) is None
    session.poll(10.0)
    assert not session.status.value.connected
    message = session.mode_message(FlightMode.HOLD)
    assert message is not None
    assert message[1]["param1"] == 129.0


def repeats_of(session: Px4Session, command: int) -> list[float]:
    return [fields["param1"] for _, fields in session.take_outgoing() if fields.get("command") == command]


def test_who_is_disarmed_after_an_arming_that_showed_is_not_armed_again_for_a_lost_ack(session: Px4Session) -> None:
    outcome = Outcome()
    session.receive("HEARTBEAT", heartbeat(armed=False), 0.1)
    session.start_command(command_long(400, 1.0), 0.1, 2.0, outcome)
    assert repeats_of(session, 400) == [1.0]
    session.receive("HEARTBEAT", heartbeat(armed=True), 0.25)
    assert outcome.calls == [None], "what shows needs no ack"
    session.receive("HEARTBEAT", heartbeat(armed=False), 0.4)
    for tick in range(5, 20):
        session.receive("ATTITUDE", {}, tick * 0.1)
        session.poll(tick * 0.1)
    assert repeats_of(session, 400) == []


def test_a_disarming_is_repeated_until_it_shows(session: Px4Session) -> None:
    outcome = Outcome()
    session.start_command(command_long(400, 0.0), 0.0, 2.0, outcome)
    repeats_of(session, 400)
    for tick in range(1, 7):
        session.receive("ATTITUDE", {}, tick * 0.1)
        session.poll(tick * 0.1)
    assert repeats_of(session, 400) == [0.0]
    session.receive("HEARTBEAT", heartbeat(armed=False), 0.65)
    assert outcome.calls == [None]


def test_nothing_is_repeated_for_what_may_be_of_the_past(session: Px4Session) -> None:
    session.start_command(command_long(22), 0.0, 5.0, Outcome())
    repeats_of(session, 22)
    session.poll(0.6)
    assert repeats_of(session, 22) == [], "nothing is heard"
    session.receive("ATTITUDE", {}, 1.0)
    session.poll(1.0)
    assert repeats_of(session, 22) == [], "what comes does not tell who has the vehicle"
    session.receive("HEARTBEAT", heartbeat(), 1.1)
    session.poll(1.1)
    assert len(repeats_of(session, 22)) == 1


@pytest.mark.parametrize("read_late", [True, False])
def test_words_that_came_while_we_stood_still_are_told(session: Px4Session, read_late: bool) -> None:
    """Of an acknowledgement at 0.1 s and the event behind it, until 0.5 s; ``read_late``: they waited in the socket."""
    outcome, words = Outcome(), {"id": 16910493, "arguments": ""}
    session.poll(0.05)
    session.start_command(command_long(400, 1.0), 0.06, 5.0, outcome)
    session.receive("COMMAND_ACK", ack(400, 1), 0.1)
    if not read_late:
        session.receive("EVENT", words, 0.105)
    session.poll(0.5)
    if read_late:
        session.receive("EVENT", words, 0.501)
    session.poll(0.6)
    (error,) = outcome.calls
    assert str(error) == "temporarily rejected; arming denied: resolve system health failures first"
