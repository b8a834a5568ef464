from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from daemon.estimation import ekf
from daemon.estimation.filter_base import FilterParameters, correct, initial, partial, predict, process, with_state
from daemon.estimation.filter_control import ControlParameters, VelocityControl
from daemon.estimation.motion_model import project
from daemon.estimation.ukf import Unscented

Z = [0.15 * i for i in range(15)]
PARAMETERS = FilterParameters(predictor=Unscented(alpha=1e-3, kappa=0.0, beta=2.0))
ORIGINAL = FilterParameters(predictor=Unscented(alpha=1e-3, kappa=0.0, beta=2.0, circular_mean=True))
ALL = [True] * 15


def started(parameters=PARAMETERS, variance=0.5):
    state = with_state(initial(parameters), Z, variance * np.eye(15))
    return replace(state, stamp_s=0.0)


def test_predicted_numbers():
    state = predict(started(), 0.1, ORIGINAL)
    expected = [0.0313150152456, 0.210992036382, 0.32716443995, 0.832147962651, 0.641802547246, 1.09114728587]
    np.testing.assert_allclose(state.x[:6], expected, rtol=0, atol=1e-9)
    diagonal = [0.541291396005, 0.53915526676, 0.533356521334, 0.630260758798, 0.53202702012, 0.548983434334]
    np.testing.assert_allclose(state.P.diagonal()[:6], diagonal, rtol=0, atol=1e-9)


def test_the_corrected_covariance_has_the_measurement_noise_in_it():
    """One direct measurement of variance R on a prior of about 0.5 leaves R P / (R + P), as it does in the EKF."""
    used = [i in (0, 1, 2, 5, 6) for i in range(15)]
    seen = partial(0.1, [1.1 * z for z in Z], 0.01 * np.eye(15), used, 5.0)
    state, record = correct(predict(started(), 0.1, PARAMETERS), seen)
    assert record.refused is None
    np.testing.assert_allclose(state.P.diagonal()[[0, 1, 2, 5, 6]], 0.0098, atol=5e-5)


def test_the_control_term_moves_it_as_it_moves_the_ekf_when_the_spread_is_small():
    control = ControlParameters(
        timeout_s=0.5,
        acceleration_limits=(1.0,) * 6,
        acceleration_gains=(0.8,) * 6,
        deceleration_limits=(1.3,) * 6,
        deceleration_gains=(1.0,) * 6,
    )
    command = VelocityControl(0.1, (1.0, 0.0, 0.5, 0.0, 0.0, 1.0))
    states = []
    for predictor in (PARAMETERS.predictor, ekf.predict):
        parameters = FilterParameters(predictor=predictor, control=control)
        states.append(predict(replace(started(parameters, 1e-6), control=command), 0.1, parameters))
    np.testing.assert_allclose(states[0].x, states[1].x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(states[0].P, states[1].P, rtol=0, atol=1e-6)
    np.testing.assert_allclose(states[0].x[12:], (0.08, -1.05, -0.7), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_random_sequences_as_filterpy(seed):
    rng = np.random.default_rng(seed)
    unscented = Unscented(alpha=0.3, kappa=0.5, beta=2.0)
    parameters = FilterParameters(predictor=unscented, covariance_epsilon=0.0)
    points = MerweScaledSigmaPoints(15, alpha=0.3, beta=2.0, kappa=0.5)
    dt = 0.02
    places: list[int] = []
    oracle = UnscentedKalmanFilter(
        15, 1, dt, hx=lambda x: x[places], fx=lambda x, h: np.array(project(x.tolist(), h)), points=points
    )
    state = replace(with_state(initial(parameters), 0.1 * rng.normal(size=15), 0.02 * np.eye(15)), stamp_s=0.0)
    oracle.x, oracle.P = state.x.copy(), state.P.copy()
    oracle.Q = parameters.process_noise_1_s * dt
    for k in range(1, 40):
        oracle.predict()
        oracle.sigmas_f = points.sigma_points(oracle.x, oracle.P)  # points that know the process noise
        places = sorted(rng.choice(15, size=int(rng.integers(1, 13)), replace=False).tolist())
        z = 0.1 * rng.normal(size=15)
        R = 0.05 * np.eye(15)
        oracle._dim_z = len(places)
        oracle.update(z[places], R=R[np.ix_(places, places)])
        state, record = process(state, partial(k * dt, z, R, [i in places for i in range(15)]), parameters)
        assert record.refused is None
        np.testing.assert_allclose(state.x, oracle.x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(state.P, oracle.P, rtol=0, atol=1e-10)


@pytest.mark.parametrize("variance", [1.0, 2.0, 2.5, 10.0, 1e4])
def test_angles_of_which_little_is_known_are_predicted_as_the_ekf_does(variance):
    """At rest in every axis the model's second order adds nothing to the mean; the rest is the same propagation."""
    P = np.diag([0.01] * 3 + [variance] * 3 + [0.01] * 9)
    states = []
    for predictor in (PARAMETERS.predictor, ekf.predict):
        parameters = FilterParameters(predictor=predictor)
        before = replace(with_state(initial(parameters), [0.0] * 15, P), stamp_s=0.0)
        states.append(predict(before, 0.01, parameters))
    ours, theirs = states
    assert ours.stamp_s == 0.01
    np.testing.assert_allclose(ours.x, theirs.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.P.diagonal(), theirs.P.diagonal(), rtol=1e-3 * variance)
    assert np.linalg.eigvalsh(ours.P).min() > 0.005


@pytest.mark.parametrize("variance", [0.5, 2.0, 10.0, 1e4])
def test_a_state_of_which_little_is_known_keeps_a_covariance(variance):
    after = predict(started(variance=variance), 0.1, PARAMETERS)
    assert after.stamp_s == 0.1
    assert np.linalg.eigvalsh(after.P).min() > 0.7 * variance
    assert np.abs(after.x[3:6]).max() <= np.pi


def test_angles_average_on_the_circle():
    x = [0.0] * 15
    x[5] = np.pi - 1e-3
    state = replace(with_state(initial(PARAMETERS), x, 0.1 * np.eye(15)), stamp_s=0.0)
    after = predict(state, 0.01, PARAMETERS)
    np.testing.assert_array_equal(after.P, after.P.T)
    assert abs(after.x[5]) == pytest.approx(np.pi - 1e-3, abs=1e-4)
    assert after.P[5, 5] == pytest.approx(0.1, rel=0.05)


def test_a_covariance_that_rounding_made_indefinite_is_repaired():
    P = 0.1 * np.eye(15)
    P[0, 1] = P[1, 0] = 0.1000001
    state = replace(with_state(initial(PARAMETERS), Z, P), stamp_s=0.0)
    after = predict(state, 0.01, PARAMETERS)
    assert after.x is not state.x
    assert np.linalg.eigvalsh(after.P).min() > -1e-7


@pytest.mark.parametrize("bad", [{"alpha": 0.0}, {"kappa": -15.0}, {"alpha": float("nan")}])
def test_points_that_would_coincide_are_refused(bad):
    with pytest.raises(ValueError, match="ukf"):
        Unscented(**bad)
