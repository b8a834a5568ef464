from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.estimation import ekf
from daemon.estimation.filter_base import (
    FilterParameters,
    Measurement,
    advance,
    correct,
    initial,
    partial,
    predict,
    process,
    process_noise,
    validate_delta,
    with_state,
)
from daemon.estimation.ukf import Unscented

PARAMETERS = FilterParameters(predictor=ekf.predict)
NAN, INF = float("nan"), float("inf")


def started(x=None, variance=0.1):
    state = with_state(initial(PARAMETERS), [0.0] * 15 if x is None else x, variance * np.eye(15))
    return replace(state, stamp_s=0.0)


def direct(indices, values, variance=0.01, stamp_s=0.0, threshold=INF):
    return Measurement(stamp_s, tuple(indices), np.array(values, float), variance * np.eye(len(indices)), threshold)


def test_the_first_measurement_initializes_what_it_holds():
    values = [0.1 * i for i in range(15)]
    used = [i in (0, 5) for i in range(15)]
    state, record = process(initial(PARAMETERS), partial(3.0, values, 0.2 * np.eye(15), used), PARAMETERS)
    assert record.refused is None
    assert state.initialized
    assert state.stamp_s == 3.0
    assert state.x[[0, 1, 5]].tolist() == pytest.approx([0.0, 0.0, 0.5])
    assert state.P.diagonal()[[0, 1, 5]].tolist() == pytest.approx([0.2, 1e-9, 0.2])


def test_a_partial_measurement_has_the_part_of_the_covariance_that_belongs_to_it():
    covariance = np.arange(225.0).reshape(15, 15)
    used = [i in (1, 4) for i in range(15)]
    measurement = partial(0.0, list(range(15)), covariance, used)
    assert measurement.indices == (1, 4)
    assert measurement.values.tolist() == [1.0, 4.0]
    assert measurement.covariance.tolist() == [[16.0, 19.0], [61.0, 64.0]]


def test_innovations_of_angles_take_the_short_way():
    x = [0.0] * 15
    x[5] = 3.1
    state, record = correct(started(x), direct([5], [-3.1], 0.1))
    assert record.innovation[0] == pytest.approx(2 * np.pi - 6.2)
    assert abs(state.x[5]) == pytest.approx(np.pi)


def test_values_that_are_not_finite_are_left_out_and_the_rest_counts():
    state, record = correct(started(), direct([0, 1, 2], [NAN, 1.0, INF]))
    assert record.indices == (1,)
    assert state.x[0] == 0.0
    assert state.x[1] > 0.9


@pytest.mark.parametrize(
    ("measurement", "reason"),
    [
        (direct([0], [NAN]), "empty"),
        (direct([], []), "empty"),
        (direct([0], [1.0], NAN), "covariance"),
        (direct([0], [1.0], stamp_s=NAN), "stamp"),
        (direct([0], [9.0], threshold=3.0), "mahalanobis"),
        (Measurement(0.0, (0, 1), np.zeros(2), np.array([[1.0, 5.0], [5.0, 1.0]])), "singular"),
        (direct([0], [1e150]), "diverged"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_cannot_be_taken_is_refused_by_name_and_changes_nothing(measurement, reason):
    P = 0.1 * np.eye(15)
    P[0, 12] = P[12, 0] = 1e200 if reason == "diverged" else 0.0
    before = replace(with_state(initial(PARAMETERS), [0.0] * 15, P), stamp_s=0.0)
    after, record = process(before, measurement, PARAMETERS)
    assert record.refused == reason
    assert after is before


@pytest.mark.parametrize(("variance", "taken_as"), [(-0.3, 0.3), (0.0, 1e-9), (1e-30, 1e-9)])
def test_an_impossible_variance_is_made_possible(variance, taken_as):
    bad, _ = correct(started(), direct([0], [1.0], variance))
    good, _ = correct(started(), direct([0], [1.0], taken_as))
    np.testing.assert_allclose(bad.P, good.P, atol=1e-18)


def test_the_gate_is_on_the_whole_message_and_strict():
    """Innovations 3 and 4 over a sigma of 1 each: 5 sigma together."""
    state = started(variance=0.5)
    message = direct([0, 1], [3.0, 4.0], 0.5)
    _, record = correct(state, replace(message, mahalanobis_threshold=5.0))
    assert record.refused == "mahalanobis"
    _, record = correct(state, replace(message, mahalanobis_threshold=5.0001))
    assert record.refused is None
    assert record.mahalanobis == pytest.approx(5.0)


def test_dynamic_process_noise_scales_the_pose_by_the_squared_speed():
    parameters = FilterParameters(predictor=ekf.predict, dynamic_process_noise=True)
    x = [0.0] * 15
    x[6], x[7], x[11] = 1.0, 2.0, 2.0
    noise = process_noise(started(x), parameters)
    np.testing.assert_allclose(noise.diagonal()[:6], 9.0 * np.array((0.05, 0.05, 0.06, 0.03, 0.03, 0.06)))
    np.testing.assert_allclose(noise.diagonal()[6:], PARAMETERS.process_noise_1_s.diagonal()[6:])
    assert process_noise(started(), parameters).diagonal()[:6].tolist() == [0.0] * 6


@pytest.mark.parametrize(
    ("delta_s", "valid_s"), [(0.02, 0.02), (0.0, 0.0), (-1.0, 0.0), (NAN, 0.0), (INF, 0.0), (1e5, 1e5), (2e5, 0.01)]
)
def test_steps_are_validated(delta_s, valid_s):
    assert validate_delta(delta_s, PARAMETERS) == valid_s


def test_a_measurement_back_in_time_corrects_without_a_prediction():
    x = [0.0] * 15
    x[6] = 1.0
    before = replace(started(x), stamp_s=1.0)
    after, _ = process(before, direct([1], [0.0], stamp_s=0.5), PARAMETERS)
    assert after.x[0] == 0.0
    assert after.stamp_s == 1.0


def test_silence_is_bridged_by_prediction_after_the_sensor_timeout_only():
    x = [0.0] * 15
    x[6] = 1.0
    state = started(x)
    assert advance(state, 0.03, PARAMETERS) is state
    ahead = advance(state, 0.05, PARAMETERS)
    assert ahead.stamp_s == 0.05
    assert ahead.x[0] == pytest.approx(0.05)
    waiting = initial(PARAMETERS)
    assert advance(waiting, 9.0, PARAMETERS) is waiting


def test_predicted_state_is_kept_beside_the_corrected_one():
    x = [0.0] * 15
    x[6] = 1.0
    state, _ = process(started(x), direct([0], [5.0], stamp_s=0.1), PARAMETERS)
    assert state.predicted_x[0] == pytest.approx(0.1)
    assert state.x[0] > 4.0


def test_epsilon_goes_onto_the_diagonal_of_each_prediction():
    parameters = replace(PARAMETERS, covariance_epsilon=0.001)
    plain = predict(started(), 0.1, replace(PARAMETERS, covariance_epsilon=0.0))
    np.testing.assert_allclose(predict(started(), 0.1, parameters).P - plain.P, 0.001 * np.eye(15), atol=1e-15)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_prediction_that_overflows_leaves_the_estimate_and_takes_no_measurement():
    x = [0.0] * 15
    x[12] = 1e308
    before = started(x)
    parameters = replace(PARAMETERS, max_delta_s=1e6)
    after = predict(before, 1e5, parameters)
    assert after.x is before.x
    assert after.P is before.P
    assert after.stamp_s == 0.0
    state, record = process(before, direct([0], [5.0], stamp_s=1e5), parameters)
    assert record.refused == "unpredicted"
    assert (state.x[0], state.stamp_s) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "P"),
    [([0.0] * 14, None), ([NAN] * 15, None), ([0.0] * 15, np.eye(14)), ([0.0] * 15, INF * np.ones((15, 15)))],
)
def test_an_impossible_state_set_by_hand_is_refused(x, P):
    with pytest.raises(ValueError, match="filter"):
        with_state(initial(PARAMETERS), x, P)


def test_a_state_set_by_hand_before_any_measurement_takes_the_first():
    state, record = process(with_state(initial(PARAMETERS), [0.0] * 15, np.eye(15)), direct([0], [5.0]), PARAMETERS)
    assert record.refused is None
    assert state.x[0] == pytest.approx(5.0, abs=0.1)


def test_a_state_set_by_hand_has_wrapped_angles():
    x = [0.0] * 15
    x[3:6] = [4.0, -4.0, 7.0]
    np.testing.assert_allclose(
        with_state(initial(PARAMETERS), x).x[3:6], (4.0 - 2 * np.pi, 2 * np.pi - 4.0, 7.0 - 2 * np.pi)
    )


anything = st.floats(width=64)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(deadline=None, max_examples=100)
@given(
    predictor=st.sampled_from([ekf.predict, Unscented()]),
    messages=st.lists(
        st.tuples(anything, st.lists(st.integers(0, 14), unique=True), st.lists(anything, min_size=15, max_size=15)),
        max_size=6,
    ),
    variance=anything,
)
def test_whatever_comes_in_the_state_stays_finite_and_its_variances_positive(predictor, messages, variance):
    parameters = FilterParameters(predictor=predictor)
    state = initial(parameters)
    for stamp_s, indices, values in messages:
        state, _ = process(state, direct(indices, [values[i] for i in indices], variance, stamp_s), parameters)
        assert np.isfinite(state.x).all()
        assert np.isfinite(state.P).all()
        assert (state.P.diagonal() >= 0.0).all()
        assert (np.abs(state.x[3:6]) <= np.pi).all()
