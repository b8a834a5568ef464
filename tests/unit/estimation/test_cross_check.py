from math import cos, pi, radians, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from daemon.estimation.cross_check import CrossCheckParameters, CrossCheckState, step, tilt_between
from daemon.frames import from_rpy, rotate_inverse
from daemon.messages import Imu

PARAMETERS = CrossCheckParameters()
BOUND_RAD = 0.17  # two thirds of what the supervisor acts on
LEVEL = (1.0, 0.0, 0.0, 0.0)
G = 9.80665
NO_FIELD = (0.0, 0.0, 0.0)


def imu(k, force=(0.0, 0.0, -G), rates=(0.0, 0.0, 0.0), period_us=10_000):
    return Imu(k * period_us, k * period_us * 1e-6, force, rates, NO_FIELD)


def run(samples, state=None):
    state = state or CrossCheckState()
    for sample, attitude in samples:
        state = step(state, sample, attitude, 0.02, parameters=PARAMETERS)
    return state


def test_agreement_at_rest_is_zero_whatever_the_heading():
    state = run((imu(k), from_rpy(0.0, 0.0, 0.01 * k)) for k in range(500))
    assert state.disagreement_rad == pytest.approx(0.0, abs=1e-12)


def test_an_attitude_that_leans_away_from_gravity_is_found_within_two_seconds():
    wrong = from_rpy(radians(15.0), 0.0, 1.0)
    state = run((imu(k), LEVEL if k < 300 else wrong) for k in range(500))
    assert state.disagreement_rad > BOUND_RAD
    back = run(((imu(k), LEVEL) for k in range(500, 800)), state)
    assert back.disagreement_rad < BOUND_RAD


def test_a_turn_that_the_gyro_sees_is_not_a_disagreement():
    """Roll at 0.5 rad/s to 0.4 rad and stay: force and gyro tell of the same turn."""
    rolls = [min(0.4, 0.005 * k) for k in range(600)]
    samples = []
    for k, roll in enumerate(rolls):
        rate = 0.5 if k and roll > rolls[k - 1] + 1e-9 else 0.0
        force = (0.0, -G * sin(roll), -G * cos(roll))
        samples.append((imu(k, force, (rate, 0.0, 0.0)), from_rpy(roll, 0.0, 0.0)))
    assert run(samples).disagreement_rad < 1e-3


def test_two_seconds_of_sideways_acceleration_stay_below_the_bound():
    """A rotorcraft that leans by 30 deg to accelerate reads force along its own z axis, as if it were level."""
    lean = radians(30.0)
    samples = [(imu(k), LEVEL) for k in range(100)]
    attitude = 0.0
    for k in range(100, 400):
        rate = lean / 0.2 if k < 120 else -lean / 0.2 if 300 <= k < 320 else 0.0
        attitude += rate * 0.01
        force = (0.0, 0.0, -G / cos(attitude))
        samples.append((imu(k, force, (rate, 0.0, 0.0)), from_rpy(attitude, 0.0, 0.0)))
    largest = 0.0
    state = CrossCheckState()
    for sample, q in samples:
        state = step(state, sample, q, 0.02, parameters=PARAMETERS)
        largest = max(largest, state.disagreement_rad)
    assert largest < 0.5 * BOUND_RAD


def test_force_far_from_g_corrects_nothing():
    hard = (6.0, 0.0, -2.0 * G)
    state = run((imu(k, hard), LEVEL) for k in range(50))
    settled = state.filter.attitude_wb
    state = run(((imu(k, hard), LEVEL) for k in range(50, 300)), state)
    assert state.filter.attitude_wb == pytest.approx(settled, abs=1e-5)  # the bias found so far goes on


def test_over_a_gap_the_filter_turns_as_the_autopilot_does():
    tilted = from_rpy(0.3, -0.2, 1.0)
    state = run((imu(k), LEVEL) for k in range(100))
    state = run([(imu(1000, rotate_inverse(tilted, (0.0, 0.0, -G))), tilted)], state)
    assert state.filter.attitude_wb == pytest.approx(tilted)
    assert state.disagreement_rad == pytest.approx(0.0, abs=1e-9)


def leaning(time_s):
    """Pitch and its rate: level for a second, then down to 30 deg and back within 0.6 s, at up to 160 deg/s."""
    phase = 2.0 * pi * (time_s - 1.0) / 0.6
    if not 0.0 < phase < 2.0 * pi:
        return 0.0, 0.0
    return -radians(15.0) * (1.0 - cos(phase)), -radians(15.0) * 2.0 * pi / 0.6 * sin(phase)


@pytest.mark.parametrize("gap_s", [0.06, 0.12, 0.2, 0.3, 0.45])
@pytest.mark.parametrize("end_s", [1.1, 1.15, 1.2, 1.25, 1.3, 1.4, 1.5])
def test_a_turn_in_a_gap_is_not_a_disagreement(gap_s, end_s):
    largest, state = 0.0, CrossCheckState()
    for k in range(0, 500, 2):
        time_s = 0.01 * k
        pitch, rate = leaning(time_s)
        if end_s - gap_s < time_s < end_s:
            continue
        sample = imu(k, (G * sin(pitch), 0.0, -G * cos(pitch)), (0.0, rate, 0.0))
        state = step(state, sample, from_rpy(0.0, pitch, 0.0), 0.02, parameters=PARAMETERS)
        largest = max(largest, state.disagreement_rad)
    assert largest < radians(3.0)


def test_after_a_gap_nothing_is_taken_until_an_attitude_of_after_it_is_there():
    before, after = LEVEL, from_rpy(0.0, -0.6, 0.0)
    state = run((imu(k), before) for k in range(100))
    stale = step(state, imu(130), before, 0.29, parameters=PARAMETERS)
    assert stale is state
    state = step(stale, imu(132), after, 0.02, parameters=PARAMETERS)
    assert tilt_between(state.filter.attitude_wb, after) < 0.01


@pytest.mark.parametrize("kept", [lambda k: k % 20 == 0, lambda k: k % 50 < 20], ids=["5 Hz", "0.3 s lost of each 0.5"])
def test_gaps_that_go_on_and_on_hide_no_disagreement(kept):
    """From 1 s on the autopilot leans by 25 deg, and the accelerometer does not."""
    wrong = from_rpy(radians(25.0), 0.0, 1.0)
    state = run((imu(k), LEVEL if k < 100 else wrong) for k in range(6000) if kept(k))
    assert state.disagreement_rad > radians(18.0)


def test_a_disagreement_that_was_there_before_a_gap_is_there_after_it():
    wrong = from_rpy(radians(25.0), 0.0, 1.0)
    state = run((imu(k), LEVEL if k < 100 else wrong) for k in range(400))
    known = state.disagreement_rad
    turned = from_rpy(radians(25.0), 0.0, 2.0)  # the heading has been reset besides
    state = run([(imu(440), turned)], state)
    assert state.disagreement_rad == pytest.approx(known, rel=0.1)


def test_the_same_sample_counts_once():
    sample = imu(1)
    state = run([(imu(0), LEVEL), (sample, LEVEL)])
    assert step(state, sample, from_rpy(1.0, 0.0, 0.0), 0.02, parameters=PARAMETERS) is state


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e300])
def test_bad_numbers_leave_it_finite(bad):
    state = run((imu(k), LEVEL) for k in range(10))
    for k, sample in enumerate(
        (imu(10, (bad, 0.0, -G)), imu(11, rates=(0.0, bad, 0.0)), imu(12), imu(13, (bad,) * 3, (bad,) * 3)), start=1
    ):
        state = step(state, sample, (bad, 0.0, 0.0, 0.0) if k == 3 else LEVEL, 0.02, parameters=PARAMETERS)
    assert np.isfinite((*state.filter.attitude_wb, state.disagreement_rad, state.force_m_s2)).all()


@pytest.mark.parametrize("attitude", [(0.0,) * 4, (float("nan"),) * 4, (1e300,) * 4, None])
def test_it_does_not_start_from_an_attitude_that_is_none(attitude):
    state = CrossCheckState()
    assert step(state, imu(0), attitude, 0.02, parameters=PARAMETERS) is state


def test_tilt_between_as_scipy_says():
    rng = np.random.default_rng(1)
    for _ in range(50):
        a, b = Rotation.random(2, rng=rng)
        down = np.array((0.0, 0.0, 1.0))
        expected = np.arccos(np.clip(a.inv().apply(down) @ b.inv().apply(down), -1.0, 1.0))
        found = tilt_between(tuple(a.as_quat(scalar_first=True)), tuple(b.as_quat(scalar_first=True)))
        assert found == pytest.approx(expected, abs=1e-7)
    assert tilt_between(LEVEL, (0.0, 1.0, 0.0, 0.0)) == pytest.approx(pi)
