from dataclasses import replace
from math import inf, isfinite, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.estimation import ekf, estimator
from daemon.estimation.estimator import EstimatorParameters
from daemon.estimation.fusion import FusionParameters, flight_filter
from daemon.estimation.ukf import Unscented
from daemon.messages import ZERO3, ExternalPose, Imu, MavFrame

PARAMETERS = EstimatorParameters()


def test_before_the_first_message_nothing_is_known():
    _, estimate = estimator.step(estimator.initial(PARAMETERS), None, None, ZERO3, 5.0, parameters=PARAMETERS)
    assert estimate.newest is None
    assert estimate.age_s == inf
    assert estimate.position_variance_m2 == inf


def test_the_state_is_stamped_with_the_time_at_which_it_was_true_and_ages(circling):
    state = estimator.initial(PARAMETERS)
    for i in range(50):
        sample = circling(10.0 + 0.01 * i)
        state, estimate = estimator.step(state, sample, None, ZERO3, sample.arrival_s, parameters=PARAMETERS)
    assert estimate.newest.time_s == pytest.approx(sample.arrival_s - PARAMETERS.clock.telemetry_latency_s)
    _, later = estimator.step(state, sample, None, ZERO3, sample.arrival_s + 0.3, parameters=PARAMETERS)
    assert later.newest is estimate.newest
    assert later.age_s == pytest.approx(0.3 + PARAMETERS.clock.telemetry_latency_s)
    assert later.refused is None


def test_a_refused_message_is_named_once_counted_and_leaves_the_state(circling):
    state = estimator.initial(PARAMETERS)
    good = circling(10.0)
    state, before = estimator.step(state, good, None, ZERO3, good.arrival_s, parameters=PARAMETERS)
    bad = replace(circling(10.01), velocity_m_s=(nan, 0.0, 0.0))
    state, estimate = estimator.step(state, bad, None, ZERO3, bad.arrival_s, parameters=PARAMETERS)
    assert estimate.refused == "not_finite"
    assert estimate.newest is before.newest
    state, again = estimator.step(state, bad, None, ZERO3, bad.arrival_s + 0.01, parameters=PARAMETERS)
    assert again.refused is None
    counted = estimator.refusals(state, bad.arrival_s, parameters=PARAMETERS)
    assert counted.pop("not_finite") == 1.0
    assert set(counted.values()) == {0.0}


def test_velocities_in_the_body_give_the_same_state(circling):
    results = []
    for in_body in (False, True):
        state = estimator.initial(PARAMETERS)
        for i in range(20):
            m = circling(10.0 + 0.01 * i)
            if in_body:
                velocity = frames.rotate_inverse(m.attitude_wb, m.velocity_m_s)
                m = replace(m, velocity_m_s=velocity, child_frame_id=MavFrame.BODY_FRD)
            state, estimate = estimator.step(state, m, None, ZERO3, m.arrival_s, parameters=PARAMETERS)
        results.append(estimate.newest.velocity_ned_m_s)
    assert results[0] == pytest.approx(results[1])


def test_the_commanded_acceleration_explains_hard_manoeuvres(message):
    """30 m/s2 over a gap of 60 ms: 1.8 m/s that look like a jump to who does not know the command."""
    samples = [message(1_000_000 + 10_000 * i) for i in range(20)]
    after = message(1_250_000, position_m=(0.054, 0.0, 0.0), velocity_m_s=(1.8, 0.0, 0.0), reset_counter=12)
    seen = {}
    for commanded in (ZERO3, (30.0, 0.0, 0.0)):
        state = estimator.initial(PARAMETERS)
        for m in [*samples, after]:
            state, estimate = estimator.step(state, m, None, commanded, m.arrival_s, parameters=PARAMETERS)
        seen[commanded] = estimate.reset
    assert seen[ZERO3].kinds == {"velocity_ne"}
    assert seen[30.0, 0.0, 0.0] is None


def test_the_cross_check_runs_on_the_imu(message):
    state = estimator.initial(PARAMETERS)
    tilted = (frames.from_rpy(0.4, 0.0, 0.0), frames.from_rpy(0.0, 0.0, 0.0))
    disagreements = []
    for i in range(1500):
        stamp = 1_000_000 + 10_000 * i
        # the autopilot says level from 1 s on, the accelerometer goes on to say 23 degrees of roll
        odometry = message(stamp, attitude_wb=tilted[0 if i < 100 else 1], reset_counter=0 if i < 100 else 1)
        force = frames.rotate_inverse(tilted[0], (0.0, 0.0, -9.80665))
        imu = Imu(stamp, odometry.arrival_s, force, ZERO3, (0.2, 0.0, 0.4))
        state, estimate = estimator.step(state, odometry, imu, ZERO3, odometry.arrival_s, parameters=PARAMETERS)
        disagreements.append(estimate.disagreement_rad)
    assert disagreements[99] < 0.01
    assert disagreements[-1] == pytest.approx(0.4, abs=0.05)


def test_a_commanded_acceleration_that_is_no_number_counts_as_none(circling):
    state = estimator.initial(PARAMETERS)
    for i in range(20):
        m = circling(10.0 + 0.01 * i)
        state, estimate = estimator.step(state, m, None, (nan, 0.0, inf), m.arrival_s, parameters=PARAMETERS)
        assert estimate.refused is None
        assert estimate.newest.position_ned_m == pytest.approx(m.position_m)


def test_an_unknown_variance_is_told_and_leaves_no_trace_once_it_is_known(message):
    state = estimator.initial(PARAMETERS)
    unknown = []
    for i in range(30):
        m = message(1_000_000 + 10_000 * i)
        m = replace(m, position_variance_m2=(nan, nan, nan)) if 10 <= i < 20 else m
        state, estimate = estimator.step(state, m, None, ZERO3, m.arrival_s, parameters=PARAMETERS)
        unknown.append(estimate.position_variance_m2 == inf)
    assert unknown == [False] * 10 + [True] * 10 + [False] * 10
    assert estimate.quality.variance_growth_m2_s == pytest.approx(0.0)


@pytest.mark.parametrize("predict", [ekf.predict, Unscented()])
def test_the_filter_flies_through_resets_by_choice(circling, predict):
    parameters = EstimatorParameters(fusion=FusionParameters(filter=flight_filter(predict)))
    state = estimator.initial(parameters)
    errors = []
    for i in range(150):
        m = circling(10.0 + 0.01 * i)
        if i >= 100:
            m = replace(m, position_m=frames.add(m.position_m, (11.0, 0.0, -2.0)), reset_counter=m.reset_counter + 2)
        known = frames.scale((m.position_m[0] - (11.0 if i >= 100 else 0.0), m.position_m[1], 0.0), -1.0)
        state, estimate = estimator.step(state, m, None, known, m.arrival_s, parameters=parameters)
        errors.append(frames.norm(frames.subtract(estimate.newest.position_ned_m, m.position_m)))
        assert all(c.refused is None for c in estimate.corrections)
    assert estimate.shift.position_ned_m == pytest.approx((11.0, 0.0, -2.0), abs=0.01)
    assert max(errors[20:]) < 0.05


def test_a_pose_from_outside_counts_for_the_filter(message):
    parameters = EstimatorParameters(fusion=FusionParameters())
    state = estimator.initial(parameters)
    for i in range(200):
        m = message(1_000_000 + 10_000 * i)
        pose = ExternalPose(m.arrival_s - 0.01, (0.3, 0.0, 0.0), None, (1e-4, 1e-4, 1e-4))
        state, estimate = estimator.step(state, m, None, ZERO3, m.arrival_s, parameters=parameters, pose=pose)
    assert 0.2 < estimate.newest.position_ned_m[0] <= 0.31


@pytest.mark.parametrize("variance", [(0.04, 0.05, 0.08), (0.04, 0.31, 0.08)])
def test_the_largest_variance_is_told_at_once(message, variance):
    state = estimator.initial(PARAMETERS)
    m = message(position_variance_m2=variance)
    _, estimate = estimator.step(state, m, None, ZERO3, m.arrival_s, parameters=PARAMETERS)
    assert estimate.position_variance_m2 == max(variance)


anything = st.floats() | st.sampled_from([nan, inf, -inf, 1e300, -1e300, 0.0, 1.0])
vector = st.tuples(anything, anything, anything)
near = st.floats(-100.0, 100.0)
near_vector = st.tuples(near, near, near)
quaternion = st.tuples(anything, anything, anything, anything) | st.floats(-4.0, 4.0).map(frames.from_yaw)
telemetry = st.fixed_dictionaries(
    {
        "stamp_us": st.integers(0, 2**64 - 1) | st.integers(1_000_000, 1_200_000),
        "arrival_s": anything | st.floats(4.0, 5.0),
        "frame_id": st.sampled_from([1, 1, 1, 0, 12]),
        "child_frame_id": st.sampled_from([1, 1, 12, 7]),
        "position_m": vector | near_vector | near_vector,
        "velocity_m_s": vector | st.just((0.0, 0.0, 0.0)),
        "attitude_wb": quaternion,
        "rates_frd_rad_s": vector | st.just((0.0, 0.0, 0.0)),
        "position_variance_m2": vector,
        "reset_counter": st.integers(0, 255),
    }
)


@pytest.mark.parametrize("parameters", [PARAMETERS, EstimatorParameters(fusion=FusionParameters())], ids=["own", "ekf"])
@settings(deadline=None, max_examples=100)
@given(stream=st.lists(st.tuples(telemetry, vector), max_size=12))
def test_no_telemetry_makes_the_estimate_infinite(message, parameters, stream):
    state = estimator.initial(parameters)
    now_s = 4.0
    for changes, acceleration in stream:
        now_s += 0.01
        state, estimate = estimator.step(state, message(**changes), None, acceleration, now_s, parameters=parameters)
        if estimate.newest is not None:
            newest = estimate.newest
            numbers = (
                newest.time_s,
                estimate.age_s,
                *newest.position_ned_m,
                *newest.velocity_ned_m_s,
                *newest.attitude_wb,
                *newest.rates_frd_rad_s,
                *estimate.shift.position_ned_m,
                *estimate.shift.velocity_ned_m_s,
                estimate.shift.yaw_rad,
                estimate.quality.innovation,
                estimate.quality.variance_growth_m2_s,
            )
            assert all(isfinite(v) for v in numbers)
            assert estimate.age_s >= 0.0


def test_after_a_pause_the_second_opinion_starts_from_an_attitude_of_now_not_of_before(message):
    """A process that stood still: the IMU's first sample after it comes before the first ODOMETRY."""

    def at(time_s, roll_rad):
        q = frames.exp((roll_rad, 0.0, 0.0))
        specific_force = frames.rotate_inverse(q, (0.0, 0.0, -9.80665))
        odometry = message(round(time_s * 1e6), attitude_wb=q)
        return odometry, Imu(odometry.stamp_us, odometry.arrival_s, specific_force, ZERO3, ZERO3)

    state, last = estimator.initial(PARAMETERS), None
    for i in range(100):
        last, imu = at(10.0 + 0.01 * i, 0.5)
        state, _ = estimator.step(state, last, imu, ZERO3, last.arrival_s, parameters=PARAMETERS)
    for i in range(5):
        _, imu = at(14.0 + 0.01 * i, 0.0)
        state, _ = estimator.step(state, last, imu, ZERO3, imu.arrival_s, parameters=PARAMETERS)
    for i in range(5, 300):
        odometry, imu = at(14.0 + 0.01 * i, 0.0)
        state, estimate = estimator.step(state, odometry, imu, ZERO3, imu.arrival_s, parameters=PARAMETERS)
        assert estimate.disagreement_rad < 0.01
    assert estimate.age_s < 0.1
