from math import cos, pi, sin

import ahrs
import idyntree.swig as idyntree
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from daemon.estimation.mahony import (
    INTERNAL_STATE_SIZE,
    MahonyParameters,
    MahonyState,
    default_internal_state,
    from_internal_state,
    internal_state,
    measure,
    orientation_matrix,
    orientation_rpy,
    propagate,
    with_orientation,
)
from daemon.frames import rotate, rotate_inverse

Z_UP = (0.0, 0.0, 1.0)
G = 9.80665


def run(parameters, samples, state=None):
    state = state or MahonyState()
    for acc, gyro, mag in samples:
        state = propagate(measure(state, acc, gyro, mag, parameters=parameters), parameters=parameters)
    return state


def random_samples(seed, count, with_mag=True):
    rng = np.random.default_rng(seed)
    acc = rng.normal((0.5, -0.4, 9.5), 1.0, (count, 3))
    gyro = rng.normal((0.2, -0.1, 0.3), 0.5, (count, 3))
    mag = rng.normal((0.3, 0.1, -0.4), 0.05, (count, 3))
    return [
        (tuple(a.tolist()), tuple(w.tolist()), tuple(m.tolist()) if with_mag else None)
        for a, w, m in zip(acc, gyro, mag, strict=True)
    ]


def idyntree_filter(kp, ki, dt, confidence):
    oracle = idyntree.AttitudeMahonyFilter()
    oracle.setGainkp(kp)
    oracle.setGainki(ki)
    oracle.setTimeStepInSeconds(dt)
    if confidence is not None:
        oracle.useMagnetoMeterMeasurements(True)
        oracle.setConfidenceForMagnetometerMeasurements(confidence)
    oracle.setGravityDirection(idyntree.Direction(0.0, 0.0, 1.0))
    return oracle


def idyntree_run(oracle, samples):
    for sample in samples:
        oracle.updateFilterWithMeasurements(*(idyntree.Vector3.FromPython(v) for v in sample if v is not None))
        oracle.propagateStates()
    q = idyntree.Vector4()
    oracle.getOrientationEstimateAsQuaternion(q)
    return q.toNumPy()


def half_rate(**overrides):
    return MahonyParameters(
        kp_1_s=0.7,
        ki_1_s2=0.01,
        gravity_direction_w=Z_UP,
        magnetic_direction_w=(0.0, 0.0, 1.0),
        half_rate_gyro=True,
        **overrides,
    )


def test_numbers_of_idyntree_without_magnetometer():
    state = run(half_rate(), [((0.3, -0.2, 9.7), (0.1, 0.2, -0.3), None)] * 100)
    np.testing.assert_allclose(
        state.attitude_wb,
        (0.996019454467082, 0.021345687705538, 0.043294837739141, -0.074934404412218),
        rtol=0,
        atol=2e-15,
    )
    np.testing.assert_allclose(
        state.bias_b_rad_s, (2.003087925181701e-4, 3.800043479218708e-4, 1.640023899888981e-6), rtol=0, atol=1e-17
    )


def test_numbers_of_idyntree_with_magnetometer():
    parameters = half_rate(use_magnetometer=True, confidence_magnetometer=0.3)
    state = run(parameters, [((0.3, -0.2, 9.7), (0.1, 0.2, -0.3), (0.2, 0.1, 0.9))] * 100)
    np.testing.assert_allclose(
        state.attitude_wb,
        (0.996151003368298, 0.02446482262964, 0.038844559369596, -0.074670952514451),
        rtol=0,
        atol=2e-15,
    )


@pytest.mark.parametrize("confidence", [None, 0.0, 0.4, 1.0])
def test_random_sequences_as_idyntree(confidence):
    samples = random_samples(3, 300, with_mag=confidence is not None)
    parameters = half_rate(use_magnetometer=confidence is not None, confidence_magnetometer=confidence or 0.0)
    expected = idyntree_run(idyntree_filter(0.7, 0.01, 0.01, confidence), samples)
    np.testing.assert_allclose(run(parameters, samples).attitude_wb, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("with_mag", [False, True])
def test_random_sequences_as_ahrs(with_mag):
    """ahrs weighs each vector by 1 (here 1/2 x 1/2 with the magnetometer), updates the bias first, north is its y.

    Its field corrects the tilt as well, by its dip: here the field has none in the world of the estimate.
    """
    weight = 0.25 if with_mag else 0.5
    dt, kp, ki = 0.001, 0.8, 0.05
    samples = random_samples(5, 2000, with_mag)
    parameters = MahonyParameters(
        kp_1_s=kp / weight,
        ki_1_s2=ki / weight,
        time_step_s=dt,
        gravity_direction_w=Z_UP,
        use_magnetometer=with_mag,
        confidence_magnetometer=0.5 if with_mag else 0.0,
    )
    oracle = ahrs.filters.Mahony(k_P=kp, k_I=ki, Dt=dt, b0=np.zeros(3))
    turn = Rotation.from_euler("z", 90, degrees=True)
    q = turn.as_quat(scalar_first=True) if with_mag else np.array((1.0, 0.0, 0.0, 0.0))
    state = MahonyState()
    for acc, gyro, mag in samples:
        if with_mag:
            mag = rotate_inverse(state.attitude_wb, (mag[0], mag[1], 0.0))
            q = oracle.updateMARG(q, np.array(gyro), np.array(acc), np.array(mag))
        else:
            q = oracle.updateIMU(q, np.array(gyro), np.array(acc))
        state = run(parameters, [(acc, gyro, mag)], state)
    theirs = Rotation.from_quat(q, scalar_first=True)
    if with_mag:
        theirs = turn.inv() * theirs
    ours = Rotation.from_quat(state.attitude_wb, scalar_first=True)
    assert (ours.inv() * theirs).magnitude() < 3e-5  # one order of dt apart
    np.testing.assert_allclose(state.bias_b_rad_s, oracle.b, rtol=0, atol=3e-6)


def test_a_rate_of_one_for_a_second_turns_one_radian():
    parameters = MahonyParameters(kp_1_s=0.0)
    state = run(parameters, [((0.0, 0.0, -G), (0.0, 0.0, 1.0), None)] * 100)
    assert orientation_rpy(state) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)


def test_exactly_zero_gyro_still_corrects_a_wrong_tilt():
    parameters = MahonyParameters(kp_1_s=2.0)
    start = with_orientation(MahonyState(), (cos(0.2), sin(0.2), 0.0, 0.0))
    state = run(parameters, [((0.0, 0.0, -G), (0.0, 0.0, 0.0), None)] * 2000, start)
    assert orientation_rpy(state) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_level_in_frd_over_ned_is_the_default_rest():
    """Roll 0.3 rad at rest reads g (0, -sin, -cos) in FRD."""
    parameters = MahonyParameters(kp_1_s=4.0)
    state = run(parameters, [((0.0, -G * sin(0.3), -G * cos(0.3)), (0.0, 0.0, 0.0), None)] * 2000)
    assert orientation_rpy(state) == pytest.approx((0.3, 0.0, 0.0), abs=1e-6)


def test_magnetometer_turns_the_heading_to_north_and_leaves_the_tilt():
    parameters = MahonyParameters(kp_1_s=4.0, use_magnetometer=True, confidence_magnetometer=0.5)
    yaw = 0.7
    field_b = (0.2 * cos(yaw), -0.2 * sin(yaw), 0.4)  # north and down, seen from a body that heads to yaw
    state = run(parameters, [((0.0, 0.0, -G), (0.0, 0.0, 0.0), field_b)] * 20000)
    assert orientation_rpy(state) == pytest.approx((0.0, 0.0, yaw), abs=1e-5)


@pytest.mark.parametrize("dip", [0.0, pi / 3, -pi / 3])
@pytest.mark.parametrize("error", [0.5, pi / 2, 3.0])
def test_a_wrong_heading_is_corrected_without_a_tilt(dip, error):
    parameters = MahonyParameters(kp_1_s=4.0, use_magnetometer=True, confidence_magnetometer=0.5)
    state = with_orientation(MahonyState(), (cos(0.5 * error), 0.0, 0.0, sin(0.5 * error)))
    for _ in range(4000):
        state = run(parameters, [((0.0, 0.0, -G), (0.0, 0.0, 0.0), (cos(dip), 0.0, sin(dip)))], state)
        roll, pitch, yaw = orientation_rpy(state)
        assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert yaw == pytest.approx(0.0, abs=2e-3)


def test_the_field_turns_about_the_vertical_however_the_vehicle_is_tilted():
    parameters = MahonyParameters(use_magnetometer=True, confidence_magnetometer=1.0)
    state = with_orientation(MahonyState(), tuple(Rotation.from_rotvec((0.3, -0.6, 0.9)).as_quat(scalar_first=True)))
    seen = measure(state, (0.0, 0.0, -G), (0.0, 0.0, 0.0), (0.4, 0.1, 0.7), parameters=parameters)
    x, y, z = rotate(state.attitude_wb, seen.correction_b)
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert abs(z) > 0.002


@pytest.mark.parametrize("field", [None, (float("nan"),) * 3, (0.0, 0.0, 0.0)])
def test_without_a_field_the_accelerometer_has_all_the_weight(field):
    parameters = MahonyParameters(kp_1_s=4.0, use_magnetometer=True, confidence_magnetometer=1.0)
    start = with_orientation(MahonyState(), (cos(0.25), sin(0.25), 0.0, 0.0))
    state = run(parameters, [((0.0, 0.0, -G), (0.0, 0.0, 0.0), field)] * 1000, start)
    assert orientation_rpy(state) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_standing_gyro_bias_is_found():
    bias = (0.02, -0.03, 0.0)
    parameters = MahonyParameters(kp_1_s=2.0, ki_1_s2=0.5)
    state = run(parameters, [((0.0, 0.0, -G), bias, None)] * 20000)
    assert state.bias_b_rad_s == pytest.approx(bias, abs=1e-6)
    assert state.rates_b_rad_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("attitude", [(0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.6, 0.8, 0.0)])
def test_a_filter_that_is_exactly_upside_down_finds_its_way_back(attitude):
    state = with_orientation(MahonyState(), attitude)
    state = run(MahonyParameters(kp_1_s=1.0), [((0.0, 0.0, -G), (0.0, 0.0, 0.0), None)] * 3000, state)
    assert rotate(state.attitude_wb, Z_UP) == pytest.approx(Z_UP, abs=1e-3)


def test_a_weight_of_zero_lets_the_gyro_alone():
    parameters = MahonyParameters(kp_1_s=4.0)
    state = measure(MahonyState(), (3.0, 0.0, -9.0), (0.0, 0.0, 0.0), parameters=parameters, accelerometer_weight=0.0)
    assert propagate(state, parameters=parameters).attitude_wb == (1.0, 0.0, 0.0, 0.0)


def test_internal_state_goes_out_and_in():
    state = run(half_rate(), random_samples(1, 50))
    numbers = internal_state(state)
    assert len(numbers) == INTERNAL_STATE_SIZE
    again = from_internal_state(numbers)
    assert internal_state(again) == pytest.approx(numbers, abs=1e-15)
    assert default_internal_state() == (1.0, *(0.0,) * 9)


@pytest.mark.parametrize("numbers", [(1.0,) * 9, (0.0,) * 10, (float("nan"),) * 10])
def test_an_impossible_internal_state_is_refused(numbers):
    with pytest.raises(ValueError, match="mahony"):
        from_internal_state(numbers)


@pytest.mark.parametrize(
    "bad",
    [
        {"kp_1_s": -1.0},
        {"time_step_s": 0.0},
        {"ki_1_s2": float("nan")},
        {"confidence_magnetometer": 1.1},
        {"gravity_direction_w": (0.0, 0.0, 0.0)},
        {"magnetic_direction_w": (0.0, 0.0, 0.0)},
    ],
)
def test_impossible_parameters_are_refused(bad):
    with pytest.raises(ValueError, match="mahony"):
        MahonyParameters(**bad)


def test_orientation_in_the_three_forms_agrees_with_scipy():
    state = with_orientation(MahonyState(), (0.4, -0.3, 0.8, 0.2))
    rotation = Rotation.from_quat(state.attitude_wb, scalar_first=True)
    np.testing.assert_allclose(orientation_matrix(state), rotation.as_matrix(), atol=1e-14)
    yaw, pitch, roll = rotation.as_euler("ZYX")
    assert orientation_rpy(state) == pytest.approx((roll, pitch, yaw), abs=1e-14)


def test_a_bad_measurement_is_named_and_corrects_nothing():
    parameters = MahonyParameters(use_magnetometer=True, confidence_magnetometer=0.5)
    first = measure(MahonyState(), (0.0, 0.0, -G), (0.1, 0.0, 0.0), (0.2, 0.0, 0.4), parameters=parameters)
    nan = float("nan")
    state = measure(first, (nan, 0.0, -G), (nan, 0.0, 0.0), (0.0, 0.0, 0.0), parameters=parameters)
    assert set(state.refused) == {"accelerometer", "gyro", "magnetometer"}
    assert state.correction_b == (0.0, 0.0, 0.0)
    assert state.gyro_b_rad_s == (0.1, 0.0, 0.0)


anything = st.floats(width=64)
vectors = st.tuples(anything, anything, anything)


@settings(deadline=None, max_examples=200)
@given(acc=vectors, gyro=vectors, mag=vectors, dt=anything, weight=anything)
def test_whatever_comes_in_a_unit_quaternion_comes_out(acc, gyro, mag, dt, weight):
    parameters = MahonyParameters(use_magnetometer=True, confidence_magnetometer=0.5, ki_1_s2=0.1)
    state = measure(MahonyState(), acc, gyro, mag, parameters=parameters, accelerometer_weight=weight)
    state = propagate(state, parameters=parameters, dt_s=dt)
    assert np.linalg.norm(state.attitude_wb) == pytest.approx(1.0, abs=1e-9)
    assert np.all(np.isfinite(internal_state(state)))
    assert all(abs(angle) <= pi for angle in orientation_rpy(state))
