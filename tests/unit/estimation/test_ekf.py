from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from daemon.estimation import ekf
from daemon.estimation.filter_base import FilterParameters, correct, initial, partial, predict, process, with_state
from daemon.estimation.filter_control import ControlParameters, VelocityControl
from daemon.estimation.motion_model import jacobian, project

Z = [0.15 * i for i in range(15)]
PARAMETERS = FilterParameters(predictor=ekf.predict)
CONTROL = ControlParameters(
    timeout_s=0.5,
    acceleration_limits=(1.0,) * 6,
    acceleration_gains=(0.8,) * 6,
    deceleration_limits=(1.3,) * 6,
    deceleration_gains=(1.0,) * 6,
)
COMMAND = VelocityControl(0.1, (1.0, 0.0, 0.5, 0.0, 0.0, 1.0))


def seen(values, stamp_s=0.1, variance=0.01, places=(0, 1, 2, 5, 6), threshold=5.0):
    used = [i in places for i in range(15)]
    return partial(stamp_s, values, variance * np.eye(15), used, threshold)


def started(parameters=PARAMETERS):
    state, _ = process(initial(parameters), seen(Z, 0.0, 1e-9, range(15)), parameters)
    np.testing.assert_allclose(state.x[:3], Z[:3])
    return with_state(state, state.x, 0.5 * np.eye(15))


def test_predicted_numbers():
    state = predict(started(), 0.1, PARAMETERS)
    expected = [0.0972142487992, 0.304202568334, 0.382278613562, 0.73128117594, 0.663297752225, 1.00906867236]
    expected += [1.08, 1.245, 1.41, 1.35, 1.5, 1.65, 1.8, 1.95, 2.1]
    np.testing.assert_allclose(state.x, expected, rtol=0, atol=1e-9)
    diagonal = [0.532606013103, 0.521778853414, 0.527281396525, 0.603847186517, 0.530859197282, 0.531987878554]
    diagonal += [0.5075, 0.5075, 0.509, 0.501, 0.501, 0.502, 0.501, 0.501, 0.5015]
    np.testing.assert_allclose(state.P.diagonal(), diagonal, rtol=0, atol=1e-9)


def test_corrected_numbers():
    state, record = correct(predict(started(), 0.1, PARAMETERS), seen([1.1 * z for z in Z]))
    assert record.refused is None
    expected = [0.00219305006844, 0.167278281761, 0.331187449331, 0.700173871298, 0.633784273399, 0.828488504444]
    expected += [0.991551181678, 1.23818217627, 1.39787453558, 1.35, 1.49080750199, 1.63097008258]
    expected += [1.79176019369, 1.94966080479, 2.09939674306]
    np.testing.assert_allclose(state.x, expected, rtol=0, atol=1e-9)
    diagonal = [0.00981220020236, 0.00980971901038, 0.00981319197067, 0.574795205011, 0.500657828606]
    diagonal += [0.00981100288779, 0.00980498435748]
    np.testing.assert_allclose(state.P.diagonal()[:7], diagonal, rtol=0, atol=1e-9)


def test_the_same_message_fifty_metres_off_is_refused_whole():
    before, _ = correct(predict(started(), 0.1, PARAMETERS), seen([1.1 * z for z in Z]))
    after, record = correct(before, seen([1.1 * Z[0] + 50.0, *(1.1 * z for z in Z[1:])]))
    assert record.refused == "mahalanobis"
    assert record.mahalanobis > 5.0
    assert after is before


def test_predicted_numbers_with_control():
    parameters = FilterParameters(predictor=ekf.predict, control=CONTROL)
    state = predict(replace(started(parameters), control=COMMAND), 0.1, parameters)
    expected = [0.0891729230458, 0.286574217101, 0.371345255754, 0.710408500277, 0.654419215866, 0.995125910286]
    expected += [0.908, 0.945, 1.13, 1.22, 1.37, 1.585, 0.08, -1.05, -0.7]
    np.testing.assert_allclose(state.x, expected, rtol=0, atol=1e-9)


def test_predictions_keep_the_covariance_symmetric_to_the_last_bit():
    state = started()
    for k in range(1, 20):
        state = predict(state, 0.03 * k, PARAMETERS)
        np.testing.assert_array_equal(state.P, state.P.T)


@pytest.mark.parametrize("seed", range(4))
def test_random_sequences_as_filterpy(seed):
    """filterpy's algebra over the motion model, whose Jacobian finite differences check elsewhere."""
    rng = np.random.default_rng(seed)
    parameters = FilterParameters(predictor=ekf.predict, covariance_epsilon=0.0)
    oracle = ExtendedKalmanFilter(15, 15)
    state = with_state(initial(parameters), 0.1 * rng.normal(size=15), 0.2 * np.eye(15))
    state = replace(state, stamp_s=0.0)
    oracle.x, oracle.P = state.x.copy(), state.P.copy()
    for k in range(1, 60):
        dt = 0.02
        before = oracle.x.tolist()
        oracle.F, oracle.Q = jacobian(before, dt), parameters.process_noise_1_s * dt
        oracle.predict_x = lambda u=0, x=before, h=dt: setattr(oracle, "x", np.array(project(x, h)))
        oracle.predict()
        places = sorted(rng.choice(15, size=int(rng.integers(1, 13)), replace=False).tolist())
        z = 0.3 * rng.normal(size=15)
        mix = 0.1 * rng.normal(size=(15, 15))
        R = mix @ mix.T + 0.05 * np.eye(15)
        H = np.eye(15)[places]
        oracle.update(
            z[places],
            lambda x, h=H: h,
            lambda x, h=H: h @ x,
            R=R[np.ix_(places, places)],
        )
        state, record = process(state, partial(k * dt, z, R, [i in places for i in range(15)]), parameters)
        assert record.refused is None
        np.testing.assert_allclose(state.x, oracle.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.P, oracle.P, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(state.P, state.P.T)
