"""The clock against autopilots whose clock we know: its offset is the oracle."""

from itertools import pairwise, repeat
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.estimation import clock
from daemon.estimation.clock import ClockParameters, Verdict
from daemon.messages import ClockSync

PARAMETERS = ClockParameters()
LATENCY_S = PARAMETERS.telemetry_latency_s


def run(stamped, state=None, syncs=None):
    """Feed (stamp_us, arrival_s), and what TIMESYNC says; yield (verdict, loop time of the stamp, state)."""
    for (stamp_us, arrival_s), sync in zip(stamped, syncs or repeat(None)):  # noqa: B905  # the one is endless
        state, verdict = clock.observe(state, stamp_us, arrival_s, parameters=PARAMETERS, sync=sync)
        yield verdict, clock.loop_time_s(state, stamp_us, parameters=PARAMETERS), state


def grid(count, first_us=1_000_000):
    """Stamps of PX4 at 100 Hz: 8, 8, 8 and 16 ms."""
    stamp = first_us
    for i in range(count):
        yield stamp
        stamp += 16_000 if i % 4 == 3 else 8_000


def flight(count, *, rate=1.0, offset_s=50.0, seed=1, first_us=1_000_000):
    """(stamp, arrival, true loop time): a clock that runs ``rate`` of ours, 0 to 8 ms of waiting for the burst."""
    random = Random(seed)
    for stamp in grid(count, first_us):
        true_s = offset_s + stamp * 1e-6 / rate
        yield stamp, true_s + LATENCY_S + random.uniform(0.0, 0.008), true_s


@pytest.mark.parametrize("rate", [1.0, 1.0 - 20e-6, 0.99, 0.98, 1.01])
def test_the_time_of_a_sample_is_known_whatever_the_clocks_rate(rate):
    samples = list(flight(2000, rate=rate))
    errors = [found - true for (_, found, _), (_, _, true) in zip(run(s[:2] for s in samples), samples, strict=True)]
    assert max(abs(e) for e in errors[300:]) < 0.003


def test_the_drift_is_learned():
    *_, (_, _, state) = run(s[:2] for s in flight(2000, rate=0.98))
    assert state.drift == pytest.approx(1.0 / 0.98 - 1.0, abs=0.002)


def test_a_late_first_sample_does_not_spoil_what_follows():
    samples = [
        (stamp, arrival + (0.15 if i == 0 else 0.0), true) for i, (stamp, arrival, true) in enumerate(flight(200))
    ]
    found = [f for _, f, _ in run(s[:2] for s in samples)]
    assert found[20] == pytest.approx(samples[20][2], abs=0.008)


def test_late_samples_are_known_to_be_old():
    """The link held one sample back for 60 ms: its time is that of its stamp all the same."""
    samples = list(flight(500))
    late = [(s, a + (0.06 if i == 400 else 0.0)) for i, (s, a, _) in enumerate(samples)]
    found = [f for _, f, _ in run(late)]
    assert found[400] == pytest.approx(samples[400][2], abs=0.003)


def test_a_link_that_fills_up_slowly_shows_as_age():
    samples = list(flight(800))
    filling = [(s, a + min(0.1, max(0, i - 400) * 0.002)) for i, (s, a, _) in enumerate(samples)]
    found = [f for _, f, _ in run(filling)]
    ages = [a - f for (_, a), f in zip(filling, found, strict=True)]
    assert ages[455] > 0.1


def test_a_simulation_that_stood_still_costs_three_samples():
    samples = list(flight(600))
    halted = [(s, a + (0.12 if i >= 400 else 0.0)) for i, (s, a, _) in enumerate(samples)]
    verdicts = [(v, f) for v, f, _ in run(halted)]
    assert verdicts[402][0] is Verdict.STEPPED
    assert verdicts[450][1] == pytest.approx(samples[450][2] + 0.12, abs=0.008)


def test_a_long_halt_of_the_simulation_sets_no_clock_back():
    samples = list(flight(600))
    halted = [(s, a + (0.5 if i >= 400 else 0.0)) for i, (s, a, _) in enumerate(samples)]
    verdicts = [v for v, _, _ in run(halted)]
    assert verdicts[402] is Verdict.STEPPED
    assert Verdict.SET_BACK not in verdicts


def test_the_quickest_sample_of_a_step_sets_the_clock():
    samples = [(s, t + LATENCY_S) for s, _, t in flight(500)]
    halted = [(s, a + (0.12 if i >= 400 else 0.0) + (0.007 if i > 400 else 0.0)) for i, (s, a) in enumerate(samples)]
    results = list(run(halted))
    assert results[402][0] is Verdict.STEPPED
    assert results[402][1] == pytest.approx(halted[402][1] - LATENCY_S - 0.007, abs=0.001)


def test_a_burst_after_a_stall_of_the_link_is_not_a_step():
    samples = list(flight(600))
    held_s = samples[400][1] + 0.15
    burst = [(s, max(a, held_s + 1e-4 * (i - 400)) if i >= 400 else a) for i, (s, a, _) in enumerate(samples)]
    verdicts = [v for v, _, _ in run(burst)]
    assert set(verdicts) == {Verdict.GOOD}


def test_stamps_repeated_or_out_of_order_are_named():
    samples = [s[:2] for s in flight(100)]
    samples.insert(60, samples[59])
    samples.insert(80, samples[70])
    verdicts = [v for v, _, _ in run(samples)]
    assert verdicts[60] is Verdict.REPEATED
    assert verdicts[80] is Verdict.BACKWARDS
    assert verdicts.count(Verdict.GOOD) == 100


def test_a_single_stamp_from_the_future_changes_nothing():
    samples = [s[:2] for s in flight(100)]
    samples[50] = (samples[50][0] + 10_000_000, samples[50][1])
    results = list(run(samples))
    assert results[50][0] is Verdict.AHEAD
    assert results[51][0] is Verdict.GOOD
    assert results[51][1] == pytest.approx(results[49][1] + 0.02, abs=0.008)


@pytest.mark.parametrize("step_s", [5.0, -5.0, 1e6, -0.5])
def test_a_step_of_the_autopilots_clock_is_followed_after_three_samples(step_s):
    before = [s[:2] for s in flight(200, first_us=10_000_000)]
    after = [(s + round(step_s * 1e6), a) for s, a, _ in list(flight(400, first_us=10_000_000))[200:]]
    results = list(run(before + after))
    assert results[199 + PARAMETERS.step_samples][0] in (Verdict.STEPPED, Verdict.SET_BACK)
    truth = list(flight(400, first_us=10_000_000))[260][2]
    assert results[260][1] == pytest.approx(truth, abs=0.008)


def test_a_reboot_sets_the_clock_back():
    before = [s[:2] for s in flight(300, first_us=600_000_000)]
    down_s = before[-1][1] + 8.0
    after = [(s, a - 50.0 + down_s) for s, a, _ in flight(50, first_us=20_000)]
    verdicts = [v for v, _, _ in run(before + after)]
    assert verdicts[300:302] == [Verdict.BACKWARDS] * 2
    assert verdicts[302] is Verdict.SET_BACK
    assert set(verdicts[303:]) == {Verdict.GOOD}


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(st.integers(0, 2**64 - 1), st.floats(-1e9, 1e9)) | st.tuples(st.integers(0, 10**6), st.floats(0, 10)),
        max_size=40,
    )
)
def test_no_stamp_puts_a_sample_into_the_future(stamped):
    for (_, arrival), (verdict, found, _) in zip(stamped, run(stamped), strict=True):
        if verdict in (Verdict.GOOD, Verdict.STEPPED, Verdict.SET_BACK):
            assert found <= arrival - LATENCY_S + 0.01


WAY_S = 0.025  # what even the quickest sample takes here: more than the envelope believes


def synced(samples, *, since=0, until=10**9, off_s=0.0, rate=1.0, offset_s=50.0):
    """What TIMESYNC says of ``flight``, off by some error, as of up to 0.1 s before; None outside of the indices."""
    drift = 1.0 / rate - 1.0
    asked = [stamp_us // 100_000 * 100_000 for stamp_us, _, _ in samples]
    said = [ClockSync(us, offset_s + us * 1e-6 * drift + off_s, drift, 0.001, 0.002) for us in asked]
    return [sync if since <= i < until else None for i, sync in enumerate(said)]


def slow_way(count, **how):
    return [(stamp, arrival + WAY_S - LATENCY_S, true) for stamp, arrival, true in flight(count, **how)]


@pytest.mark.parametrize("rate", [1.0, 0.985])
def test_timesync_sees_what_the_quickest_sample_took(rate):
    samples = slow_way(600, rate=rate)
    found = [f for _, f, _ in run([s[:2] for s in samples], syncs=synced(samples, rate=rate))]
    assert max(abs(f - true) for f, (_, _, true) in zip(found[300:], samples[300:], strict=True)) < 1e-3
    alone = [f for _, f, _ in run([s[:2] for s in samples])]
    assert alone[-1] - samples[-1][2] == pytest.approx(WAY_S - LATENCY_S, abs=0.003)


@pytest.mark.parametrize(("since", "until"), [(400, 10**9), (0, 400)], ids=["comes", "goes"])
def test_the_clock_does_not_jump_when_timesync_comes_or_goes(since, until):
    samples = slow_way(1200)
    found = [f for _, f, _ in run([s[:2] for s in samples], syncs=synced(samples, since=since, until=until))]
    errors = [f - true for f, (_, _, true) in zip(found, samples, strict=True)]
    steps = [abs(b - a) for a, b in pairwise(errors[300:])]
    assert max(steps) < 0.002  # the envelope alone has steps of 1 ms
    synced_s, alone_s = (errors[-1], errors[395]) if since else (errors[395], errors[-1])
    assert synced_s == pytest.approx(0.0, abs=0.001)
    assert alone_s == pytest.approx(WAY_S - LATENCY_S, abs=0.003)


def test_a_timesync_that_puts_samples_into_the_future_is_not_believed():
    samples = slow_way(600)
    found = [f for _, f, _ in run([s[:2] for s in samples], syncs=synced(samples, off_s=0.06))]
    assert found[-1] - samples[-1][2] == pytest.approx(WAY_S - LATENCY_S, abs=0.003)


def test_an_uncertain_or_old_timesync_is_not_believed():
    samples = slow_way(600)
    for age_us, uncertain_s in ((0, 0.101), (1_010_000, 0.001)):
        syncs = [ClockSync(stamp_us - age_us, 50.0, 0.0, uncertain_s, 0.002) for stamp_us, _, _ in samples]
        found = [f for _, f, _ in run([s[:2] for s in samples], syncs=syncs)]
        assert found[-1] - samples[-1][2] == pytest.approx(WAY_S - LATENCY_S, abs=0.003)


@pytest.mark.parametrize("step_s", [0.2, -0.2, 0.05, -0.05, 3.0, -3.0])
def test_a_step_with_timesync_still_of_the_clock_before_costs_no_age(step_s):
    """The next exchange, up to 0.1 s later, tells of the step; until then TIMESYNC is wrong by it."""
    samples = slow_way(900, first_us=10_000_000)
    syncs = synced(samples, until=500)
    stepped = [(s + (round(step_s * 1e6) if i >= 500 else 0), a) for i, (s, a, _) in enumerate(samples)]
    syncs[500:510] = [syncs[499]] * 10
    results = list(run(stepped, syncs=syncs))
    assert sum(verdict in (Verdict.STEPPED, Verdict.SET_BACK) for verdict, _, _ in results[500:]) == 1
    for i in range(504, 520):
        assert results[i][1] == pytest.approx(samples[i][2], abs=0.01)


@pytest.mark.parametrize("ramp_s", [0.0, 2.0, 10.0])
@pytest.mark.parametrize("rate", [1.0, 0.985])
@pytest.mark.parametrize("delay_s", [0.03, 0.1, 0.3])
def test_what_a_link_that_became_slow_adds_is_age_while_timesync_tells_the_clock(delay_s, rate, ramp_s):
    samples, begins, ends = list(flight(3000, rate=rate)), 600, 2400
    syncs = synced(samples, rate=rate)
    since_s = samples[begins][1]
    late = []
    for i, (stamp, arrival, true) in enumerate(samples):
        grown = min(1.0, (arrival - since_s) / ramp_s) if ramp_s else 1.0
        added_s = delay_s * grown if begins <= i < ends else 0.0
        late.append((stamp, max(arrival + added_s, late[-1][1] if late else 0.0), true))
    results = list(run([s[:2] for s in late], syncs=syncs))
    assert {verdict for verdict, _, _ in results[begins:ends]} == {Verdict.GOOD}
    assert max(abs(found - true) for (_, found, _), (_, _, true) in zip(results, late, strict=True)) < 0.01


def test_a_clock_that_stood_still_is_followed_as_soon_as_timesync_no_longer_holds_to_it():
    samples = slow_way(900)
    stood = [(s, a + (0.15 if i >= 500 else 0.0)) for i, (s, a, _) in enumerate(samples)]
    syncs = synced(samples, until=520)
    results = list(run(stood, syncs=syncs))
    assert [verdict for verdict, _, _ in results].count(Verdict.STEPPED) == 1
    for i in range(525, 900):
        assert results[i][1] == pytest.approx(samples[i][2] + 0.15, abs=0.02)
