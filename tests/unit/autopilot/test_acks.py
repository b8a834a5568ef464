"""Which request an acknowledgement of DO_SET_MODE answers, however late it comes and whatever was asked meanwhile."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.autopilot.acks import ModeAcks
from daemon.messages import FlightMode

HOLD, LAND, OFFBOARD = FlightMode.HOLD, FlightMode.LAND, FlightMode.OFFBOARD
Happening = FlightMode | int


def told(happenings: list[tuple[float, Happening]]) -> list[tuple[float, FlightMode]]:
    """The refusals that are told of requests (modes) and acks (results), each at its time in seconds."""
    acks, refused = ModeAcks(), []
    for at_s, happening in happenings:
        if isinstance(happening, FlightMode):
            acks.requested(happening, at_s)
        elif (mode := acks.ack(happening, at_s)) is not None:
            refused.append((at_s, mode))
    return refused


@pytest.mark.parametrize("late_s", [0.02, 0.056, 0.2, 0.6])
def test_a_late_refusal_is_not_that_of_a_mode_asked_for_meanwhile(late_s: float) -> None:
    at_s = 0.004 + late_s
    assert told([(0.0, OFFBOARD), (0.004, 0), (0.02, HOLD), (at_s, 1)]) == [(at_s, OFFBOARD)]


@pytest.mark.parametrize("late_s", [0.02, 0.056, 0.2, 0.6])
def test_the_first_ack_of_a_later_request_does_not_accept_an_earlier_one(late_s: float) -> None:
    begun = [(0.0, OFFBOARD), (0.004, 0), (0.006, HOLD), (0.01, 0)]
    at_s = 0.01 + late_s
    assert told([*begun, (at_s, 1)]) == [(at_s, OFFBOARD)]
    assert told([*begun, (at_s, 1), (at_s, 1)]) == [(at_s, OFFBOARD), (at_s, HOLD)]
    assert told([*begun, (at_s, 0), (at_s, 1)]) == [(at_s, HOLD)]


def test_a_refusal_that_may_be_of_either_of_two_modes_is_not_told() -> None:
    begun = [(0.0, OFFBOARD), (0.0, HOLD), (0.0, LAND), (0.1, 0), (0.1, 0), (0.1, 0)]
    assert told([*begun, (0.2, 1)]) == []
    assert told([*begun, (0.2, 1), (0.3, 0), (0.4, 1)]) == [(0.4, LAND)]


def test_a_refusal_without_a_first_ack_is_told_while_one_mode_alone_was_asked_for() -> None:
    assert told([(0.0, HOLD), (0.05, HOLD), (0.1, 1)]) == [(0.1, HOLD)]
    assert told([(0.0, OFFBOARD), (0.05, HOLD), (0.1, 1)]) == []
    assert told([(0.0, HOLD), (1.1, 1)]) == []
    assert told([(0.1, 1)]) == []


def test_what_is_in_progress_and_one_ack_too_many_change_nothing() -> None:
    assert told([(0.0, HOLD), (0.1, 0), (0.1, 5), (0.1, 1)]) == [(0.1, HOLD)]
    assert told([(0.0, HOLD), (0.1, 0), (0.1, 0), (0.1, 0), (0.2, LAND), (0.3, 0), (0.3, 1)]) == [(0.3, LAND)]


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from((OFFBOARD, HOLD, LAND)), st.booleans()), max_size=8), st.data())
def test_no_refusal_is_told_of_another_mode_than_the_one_refused(
    requests: list[tuple[FlightMode, bool]], data: st.DataObject
) -> None:
    """Requests, first acks and second acks each come in order, and no ack before its cause; else in any order."""
    asked = firsts = seconds = 0
    acks = ModeAcks()
    while seconds < len(requests):
        can = [asked < len(requests), firsts < asked, seconds < firsts]
        choice = data.draw(st.sampled_from([i for i, possible in enumerate(can) if possible]))
        if choice == 0:
            acks.requested(requests[asked][0], 0.0)
            asked += 1
        elif choice == 1:
            assert acks.ack(0, 0.5) is None
            firsts += 1
        else:
            mode, refused = requests[seconds]
            assert acks.ack(1 if refused else 0, 0.5) in ((mode, None) if refused else (None,))
            seconds += 1
