"""What leaves as a request of TIMESYNC, how often, what is kept of the answers, and what the line through them is."""

from collections.abc import Callable
from random import Random

import pytest
from scipy.stats import linregress

from daemon.autopilot.timesync import Exchange, TimeSync, fitted

TRIP_S = 0.002


def answer(sync: TimeSync, sent_s: float, arrival_s: float, remote_s: float) -> None:
    _, fields = sync.ask(sent_s)
    sync.receive({"tc1": round(remote_s * 1e9), "ts1": fields["ts1"]}, arrival_s)


def answered(sync: TimeSync, since_s: float, count: int, ahead_s: float = 50.0) -> float:
    """Exchanges each 0.1 s with a clock that is so far ahead; when the last one arrived."""
    for i in range(count):
        sent_s = since_s + 0.1 * i
        answer(sync, sent_s, sent_s + TRIP_S, sent_s + 0.5 * TRIP_S + ahead_s)
    return sent_s + TRIP_S


def test_ten_requests_a_second_leave_however_often_it_is_polled_and_are_requests_by_mavlinks_protocol() -> None:
    """tc1 is 0 in a request and in nothing else."""
    sync = TimeSync()
    asked = [message for i in range(200) for message in sync.poll(7.0 + 0.01 * i)]
    assert 18 <= len(asked) <= 20
    assert {name for name, _ in asked} == {"TIMESYNC"}
    assert {fields["tc1"] for _, fields in asked} == {0}
    assert len({fields["ts1"] for _, fields in asked}) == len(asked)


def test_four_answers_make_an_estimate_and_a_second_without_one_ends_it() -> None:
    sync = TimeSync()
    answered(sync, 1.0, 3)
    assert sync.sync is None
    arrival_s = answered(sync, 1.3, 1)
    assert sync.sync is not None
    sync.poll(arrival_s + 0.95)
    assert sync.sync is not None
    sync.poll(arrival_s + 1.05)
    assert sync.sync is None


def test_an_answer_six_seconds_late_is_still_known_and_one_of_seven_is_not() -> None:
    for late, known in ((60, True), (70, False)):
        sync = TimeSync()
        asked = [sync.ask(0.1 * i) for i in range(late + 1)]
        sync.receive({"tc1": 1_000_000_000, "ts1": asked[0][1]["ts1"]}, 0.1 * late)
        assert (sync.answered_s == 0.0) is known


@pytest.mark.parametrize("known", [2, 8])
@pytest.mark.parametrize("step_s", [-0.013, 0.013])
def test_a_step_of_a_clock_by_more_than_the_way_and_ten_milliseconds_is_seen_before_and_after_the_first_estimate(
    known: int, step_s: float
) -> None:
    """Half a way of 2 ms on either side, and the margin, are 12 ms."""
    sync = TimeSync()
    now_s = answered(sync, 1.0, known)
    answered(sync, now_s + 0.1, 4, ahead_s=50.0 + step_s)
    assert sync.sync is not None
    now_s += 0.4
    offset_s = now_s - (now_s + 50.0 + step_s)
    assert sync.sync.offset_at(round((now_s + 50.0 + step_s) * 1e6)) == pytest.approx(offset_s, abs=1e-6)


def test_requests_that_waited_and_are_answered_at_one_moment_of_the_autopilots_clock_are_an_estimate_too() -> None:
    """A simulated autopilot's clock has steps: what waited in the link meets one and the same reading."""
    sync = TimeSync()
    for i in range(4):
        answer(sync, 1.0 + 0.1 * i, 1.41, 51.405)
    assert sync.sync is not None
    assert sync.sync.drift == 0.0
    assert abs(sync.sync.offset_at(51_405_000) + 50.0) <= sync.sync.uncertainty_s


def exchanges(offset_s: Callable[[float], float], count: int, noise_s: float) -> list[Exchange]:
    """The quicker half comes first, so that all that counts is known."""
    random = Random(5)
    times = [100.0 + 0.1 * i for i in range(count)]
    return [
        Exchange(round(t * 1e6), offset_s(t) + random.gauss(0.0, noise_s), TRIP_S if i % 2 else 9.0, t)
        for i, t in enumerate(times)
    ]


@pytest.mark.parametrize("count", [8, 9, 30])
def test_the_line_is_the_one_of_least_squares_through_the_quicker_half(count: int) -> None:
    """Oracle: scipy; the uncertainty is half a round trip and the standard deviation of n points about two unknowns."""
    window = exchanges(lambda t: 3.0 + 0.01 * (t - 100.0), count, 2e-5)
    quick = [e for e in window if e.round_trip_s == TRIP_S]
    assert len(quick) == count // 2
    times = [(e.remote_us - window[-1].remote_us) * 1e-6 for e in quick]
    line = linregress(times, [e.offset_s for e in quick])
    residuals = [e.offset_s - line.intercept - line.slope * t for t, e in zip(times, quick, strict=True)]
    found = fitted(window, window[-1].remote_us, TRIP_S)
    assert found.stamp_us == window[-1].remote_us
    assert found.offset_s == pytest.approx(line.intercept, abs=1e-9)
    assert found.drift == pytest.approx(line.slope, rel=1e-6)
    noise_s = (sum(r * r for r in residuals) / (len(quick) - 2)) ** 0.5
    assert found.uncertainty_s == pytest.approx(0.5 * TRIP_S + noise_s, rel=1e-6)
