"""TIMESYNC against autopilots whose clock is known: their offset is the oracle."""

from random import Random

import pytest

from daemon.autopilot.timesync import STALE_S, TimeSync

OFFSET_S = 123.0


class Remote:
    """A clock that shows ``rate`` of our time since ``OFFSET_S``, in steps of ``grid_s``, behind a link."""

    def __init__(self, rate: float = 1.0, grid_s: float = 0.0, up_s: float = 0.0001, down_s: float = 0.0001) -> None:
        self.rate, self.grid_s, self.up_s, self.down_s = rate, grid_s, up_s, down_s
        self.step_s = 0.0

    def shows_s(self, time_s: float) -> float:
        shown = (time_s - OFFSET_S) * self.rate + self.step_s
        return shown // self.grid_s * self.grid_s if self.grid_s else shown


def exchange(
    sync: TimeSync, remote: Remote, now_s: float, up_s: float | None = None, down_s: float | None = None
) -> None:
    up, down = remote.up_s if up_s is None else up_s, remote.down_s if down_s is None else down_s
    for _, fields in sync.poll(now_s):
        tc1 = round(remote.shows_s(now_s + up) * 1e9)
        sync.receive({"tc1": tc1, "ts1": fields["ts1"]}, now_s + up + down)


def run(sync: TimeSync, remote: Remote, since_s: float, seconds: float, random: Random | None = None, jitter_s=0.0):
    for i in range(round(seconds * 50)):
        up = remote.up_s + random.uniform(0.0, jitter_s) if random else None
        down = remote.down_s + random.uniform(0.0, jitter_s) if random else None
        exchange(sync, remote, since_s + 0.02 * i, up, down)
    return since_s + seconds


def error_s(sync: TimeSync, remote: Remote, now_s: float) -> float:
    """Where our time stands when the remote shows what it shows, minus now."""
    assert sync.sync is not None
    shown = (now_s - OFFSET_S) * remote.rate + remote.step_s
    return shown + sync.sync.offset_at(round(shown * 1e6)) - now_s


@pytest.mark.parametrize("rate", [1.0, 1.0 + 50e-6, 0.98, 0.99])
def test_the_offset_is_known_whatever_the_rate(rate: float) -> None:
    sync, remote = TimeSync(), Remote(rate)
    now_s = run(sync, remote, 200.0, 6.0)
    assert abs(error_s(sync, remote, now_s)) < 0.0002
    assert sync.sync is not None and sync.sync.uncertainty_s < 0.0005
    assert sync.sync.drift == pytest.approx(1.0 / rate - 1.0, abs=2e-4)


def test_a_clock_that_moves_in_steps_is_known_to_half_a_step() -> None:
    sync, remote = TimeSync(), Remote(0.985, grid_s=0.004)
    now_s = run(sync, remote, 200.0, 6.0)
    assert -0.001 < error_s(sync, remote, now_s) < 0.005


def test_slow_exchanges_do_not_count() -> None:
    sync, remote, random = TimeSync(), Remote(up_s=0.002, down_s=0.002), Random(3)
    now_s = 200.0
    for i in range(300):
        slow = random.uniform(0.0, 0.08) if i % 10 < 4 else 0.0
        exchange(sync, remote, now_s, up_s=0.002 + slow)
        now_s += 0.02
    assert abs(error_s(sync, remote, now_s)) < 0.0005


def test_a_noisy_link_shows_no_drift_that_is_not_there() -> None:
    worst = 0.0
    for seed in range(20):
        sync, remote = TimeSync(), Remote(up_s=0.01, down_s=0.01)
        now_s = run(sync, remote, 200.0, 6.0, Random(seed), 0.01)
        assert sync.sync is not None
        worst = max(worst, abs(error_s(sync, remote, now_s)))
        assert abs(error_s(sync, remote, now_s)) < sync.sync.uncertainty_s
    assert worst < 0.006


@pytest.mark.parametrize("step_s", [-2.0, -0.2, 0.2, 2.0, -0.05])
def test_a_step_is_noticed_with_the_next_answer_and_followed_after_four(step_s: float) -> None:
    sync, remote = TimeSync(), Remote()
    now_s = run(sync, remote, 200.0, 5.0)
    remote.step_s = step_s
    while sync.sync is not None:
        exchange(sync, remote, now_s)
        now_s += 0.02
        assert now_s < 205.15
    now_s = run(sync, remote, now_s, 0.5)
    assert abs(error_s(sync, remote, now_s)) < 0.0005


def test_nothing_is_known_when_answers_stop() -> None:
    sync, remote = TimeSync(), Remote()
    now_s = run(sync, remote, 200.0, 2.0)
    assert sync.sync is not None
    sync.poll(now_s + STALE_S)
    assert sync.sync is None


def test_answers_to_others_and_second_answers_are_not_taken() -> None:
    sync = TimeSync()
    for i in range(8):
        ((_, fields),) = sync.poll(1.0 + 0.11 * i)
        sync.receive({"tc1": 5_000_000_000, "ts1": fields["ts1"] + 1}, 1.0 + 0.11 * i)
        assert sync.sync is None
    sync.receive({"tc1": 5_000_000_000, "ts1": fields["ts1"]}, 1.8)
    for _ in range(8):
        sync.receive({"tc1": 5_000_000_000, "ts1": fields["ts1"]}, 1.8)
    assert sync.sync is None


def test_the_round_trip_is_what_the_link_takes_now() -> None:
    sync, remote = TimeSync(), Remote(up_s=0.004, down_s=0.012)
    now_s = run(sync, remote, 200.0, 4.0)
    assert sync.sync is not None and sync.sync.round_trip_s == pytest.approx(0.016)
    remote.down_s = 0.212
    now_s = run(sync, remote, now_s, 0.5)
    assert sync.sync.round_trip_s == pytest.approx(0.216), "half a second after it became slow"
    remote.down_s = 0.012
    run(sync, remote, now_s, 0.5)
    assert sync.sync.round_trip_s == pytest.approx(0.016), "and half a second after it ended"


def test_two_exchanges_in_five_that_are_held_up_do_not_make_the_link_slow() -> None:
    sync, remote = TimeSync(), Remote(up_s=0.004, down_s=0.012)
    now_s = run(sync, remote, 200.0, 4.0)
    for i in range(30):
        exchange(sync, remote, now_s + 0.11 * i, down_s=0.09 if i % 5 < 2 else None)
        assert sync.sync is not None and sync.sync.round_trip_s == pytest.approx(0.016)


def slowed(up_s: float, down_s: float, ramp_s: float, rate: float) -> tuple[TimeSync, float]:
    """A quick link that becomes slower after 6 s; the largest error of the clock in the 12 s after that."""
    sync, remote = TimeSync(), Remote(rate, up_s=0.002, down_s=0.002)
    now_s = run(sync, remote, 200.0, 6.0)
    since_s, worst, arrivals = now_s, 0.0, []
    while now_s < since_s + 12.0:
        grown = min(1.0, (now_s - since_s) / ramp_s) if ramp_s else 1.0
        for _, fields in sync.poll(now_s):
            at_s = now_s + remote.up_s + grown * up_s
            arrivals.append((at_s + remote.down_s + grown * down_s, round(remote.shows_s(at_s) * 1e9), fields["ts1"]))
        while arrivals and arrivals[0][0] <= now_s:
            arrival_s, tc1, ts1 = arrivals.pop(0)
            sync.receive({"tc1": tc1, "ts1": ts1}, arrival_s)
        worst = max(worst, abs(error_s(sync, remote, now_s)))
        now_s += 0.02
    return sync, worst


@pytest.mark.parametrize("rate", [1.0, 1.0 + 50e-6, 0.985])
@pytest.mark.parametrize("ramp_s", [0.0, 3.0, 10.0])
@pytest.mark.parametrize(("up_s", "down_s"), [(0.1, 0.0), (0.0, 0.1), (0.3, 0.0), (0.0, 0.3), (0.15, 0.15)])
def test_a_link_that_becomes_slow_in_one_direction_moves_no_clock(
    up_s: float, down_s: float, ramp_s: float, rate: float
) -> None:
    sync, worst = slowed(up_s, down_s, ramp_s, rate)
    assert worst < 0.003
    assert sync.sync is not None and sync.sync.round_trip_s == pytest.approx(0.004 + up_s + down_s, abs=1e-4)
