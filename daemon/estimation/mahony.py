"""Mahony's explicit complementary filter: attitude and gyro bias from gyro, accelerometer and, by choice, magnetometer.

Mahony, Hamel, Pflimlin 2008, "Nonlinear complementary filters on the special orthogonal group", eq. 32 and 48:
``w_mes = sum k_i/2 (v_i x v_hat_i)``; ``q <- q exp((w_gyro - b + kp w_mes) dt)``; ``b <- b - ki w_mes dt``, with the
bias of before the update in the first equation.

A step is ``measure`` then ``propagate``; both take and give a ``MahonyState``. The filter holds in any world frame:
``gravity_direction_w`` says what a normalized accelerometer reads at rest when body and world axes coincide.
"""

from dataclasses import dataclass, replace
from math import hypot, isfinite

from daemon.frames import (
    Matrix3,
    add,
    clamp,
    cross,
    dot,
    integrate,
    is_finite,
    norm,
    normalized,
    rotate,
    rotate_inverse,
    scale,
    subtract,
    to_matrix,
    to_rpy,
)
from daemon.messages import IDENTITY, ZERO3, Quat, Vec3
from daemon.values import value

INTERNAL_STATE_SIZE = 10
_TINY = 1e-12  # a vector shorter than this has no direction
_OPPOSITE = -0.9999  # cosine; within 0.8 deg of upside down the paper's law has next to no way out
_GYRO_LIMIT_RAD_S = 1e3  # thirty times what a gyro of 2000 deg/s can read: not a measurement
_STEP_LIMIT_S = 10.0  # after a longer silence the attitude has to be set anew


@dataclass(frozen=True, slots=True, kw_only=True)
class MahonyParameters:
    """Gains and conventions of the filter. Raises ValueError on a value that the filter cannot run with.

    ``magnetic_direction_w``: the field's direction in the world, which corrects the tilt too. None turns the field's
    horizontal part to the world's x axis (north) about its z axis: the magnetometer corrects the heading only.
    ``half_rate_gyro``: iDynTree's integration, at half the rate (1 rad/s for 1 s turns 0.5 rad).
    """

    kp_1_s: float = 1.0
    ki_1_s2: float = 0.0
    time_step_s: float = 0.01
    use_magnetometer: bool = False
    confidence_magnetometer: float = 0.0  # 0 to 1; the accelerometer has the rest, and all of it without a field
    gravity_direction_w: Vec3 = (0.0, 0.0, -1.0)  # specific force at rest, FRD in NED
    magnetic_direction_w: Vec3 | None = None
    half_rate_gyro: bool = False

    def __post_init__(self) -> None:
        gains = (self.kp_1_s, self.ki_1_s2, self.time_step_s)
        if not is_finite(gains) or min(gains) < 0.0 or self.time_step_s == 0.0:
            raise ValueError("mahony: kp_1_s and ki_1_s2 must be >= 0 and time_step_s > 0")
        if not 0.0 <= self.confidence_magnetometer <= 1.0:
            raise ValueError("mahony: confidence_magnetometer must be within 0 and 1")
        if _direction(self.gravity_direction_w) is None:
            raise ValueError("mahony: gravity_direction_w has no direction")
        if self.magnetic_direction_w is not None and _direction(self.magnetic_direction_w) is None:
            raise ValueError("mahony: magnetic_direction_w has no direction")


@value(eq=True)
class MahonyState:
    """The ten numbers of the filter, and the measurement that the next ``propagate`` will use.

    ``refused`` names what of the last measurement could not be used: gyro, accelerometer, magnetometer.
    """

    attitude_wb: Quat = IDENTITY
    rates_b_rad_s: Vec3 = ZERO3
    bias_b_rad_s: Vec3 = ZERO3
    gyro_b_rad_s: Vec3 = ZERO3
    correction_b: Vec3 = ZERO3
    refused: tuple[str, ...] = ()


def measure(
    state: MahonyState,
    accelerometer_b: Vec3,
    gyro_b_rad_s: Vec3,
    magnetometer_b: Vec3 | None = None,
    *,
    parameters: MahonyParameters,
    accelerometer_weight: float = 1.0,
) -> MahonyState:
    """Take a measurement: the gyro, and the vectorial error of accelerometer and magnetometer against the attitude.

    Accelerometer and magnetometer in any unit (they are normalized). ``accelerometer_weight`` in [0, 1] takes trust
    from the accelerometer while the vehicle accelerates. A vector that is not finite or has no length corrects nothing
    (a gyro that is not finite or beyond 1000 rad/s: the last one goes on), and is named in ``refused``.
    """
    refused: list[str] = []
    attitude = state.attitude_wb
    correction, confidence = ZERO3, 0.0
    if parameters.use_magnetometer and magnetometer_b is not None:
        mag = _direction(magnetometer_b)
        if mag is None:
            refused.append("magnetometer")
        else:
            confidence = parameters.confidence_magnetometer
            correction = scale(_field_error(attitude, mag, parameters), 0.5 * confidence)
    acc = _direction(accelerometer_b)
    if acc is None or not isfinite(accelerometer_weight):
        refused.append("accelerometer")
    else:
        expected = rotate_inverse(attitude, _unit(parameters.gravity_direction_w))
        weight = 0.5 * (1.0 - confidence) * clamp(accelerometer_weight, 0.0, 1.0)
        correction = add(scale(_vertical_error(acc, expected), weight), correction)
    gyro = gyro_b_rad_s
    if not norm(gyro) <= _GYRO_LIMIT_RAD_S:  # NaN is not
        refused.append("gyro")
        gyro = state.gyro_b_rad_s
    return MahonyState(attitude, state.rates_b_rad_s, state.bias_b_rad_s, gyro, correction, tuple(refused))


def propagate(state: MahonyState, *, parameters: MahonyParameters, dt_s: float | None = None) -> MahonyState:
    """Turn the attitude for one time step (``dt_s`` in place of the parameter when given) and update the bias.

    A step that is not within 0 and 10 s leaves the state as it is.
    """
    dt = parameters.time_step_s if dt_s is None else dt_s
    if not 0.0 < dt <= _STEP_LIMIT_S:
        return state
    rates = subtract(state.gyro_b_rad_s, state.bias_b_rad_s)
    turning = add(rates, scale(state.correction_b, parameters.kp_1_s))
    attitude = integrate(state.attitude_wb, turning, 0.5 * dt if parameters.half_rate_gyro else dt)
    bias = subtract(state.bias_b_rad_s, scale(state.correction_b, parameters.ki_1_s2 * dt))
    return MahonyState(attitude, rates, bias, state.gyro_b_rad_s, state.correction_b, state.refused)


def internal_state(state: MahonyState) -> tuple[float, ...]:
    """The ten numbers ``[q, w, b]``: attitude, angular velocity less bias, gyro bias."""
    return (*state.attitude_wb, *state.rates_b_rad_s, *state.bias_b_rad_s)


def default_internal_state() -> tuple[float, ...]:
    """The ten numbers that a new filter has: no rotation, no rate, no bias."""
    return internal_state(MahonyState())


def from_internal_state(numbers: tuple[float, ...]) -> MahonyState:
    """State from the ten numbers. Raises ValueError unless ten finite ones with a quaternion that has a length."""
    if len(numbers) != INTERNAL_STATE_SIZE or not is_finite(numbers):
        raise ValueError("mahony: the internal state is ten finite numbers [q, w, b]")
    q0, q1, q2, q3, w0, w1, w2, b0, b1, b2 = numbers
    state = with_orientation(MahonyState(), (q0, q1, q2, q3))
    return replace(state, rates_b_rad_s=(w0, w1, w2), bias_b_rad_s=(b0, b1, b2))


def with_orientation(state: MahonyState, attitude_wb: Quat) -> MahonyState:
    """The state with another attitude, normalized. Raises ValueError on one that is not finite or has no length."""
    if not is_finite(attitude_wb) or hypot(*attitude_wb) < _TINY:
        raise ValueError("mahony: the orientation is a finite quaternion with a length")
    return replace(state, attitude_wb=normalized(attitude_wb))


def orientation_matrix(state: MahonyState) -> Matrix3:
    """Attitude as rotation matrix by rows, body to world."""
    return to_matrix(state.attitude_wb)


def orientation_rpy(state: MahonyState) -> Vec3:
    """Attitude as roll, pitch, yaw in radians."""
    return to_rpy(state.attitude_wb)


def _unit(v: Vec3) -> Vec3:
    return scale(v, 1.0 / norm(v))


def _direction(v: Vec3) -> Vec3 | None:
    length = norm(v)
    return _unit(v) if isfinite(length) and length > _TINY else None


def _vertical_error(measured_b: Vec3, expected_b: Vec3) -> Vec3:
    """Measured times expected vertical; of opposite ones, where that vanishes, a unit about an axis across."""
    if dot(measured_b, expected_b) > _OPPOSITE:
        return cross(measured_b, expected_b)
    return _unit(cross(expected_b, (1.0, 0.0, 0.0) if abs(expected_b[0]) < 0.7 else (0.0, 1.0, 0.0)))


def _field_error(attitude_wb: Quat, magnetometer_b: Vec3, parameters: MahonyParameters) -> Vec3:
    """Measured times expected field, in the body: of the whole vectors, or of their horizontal parts in the world."""
    if parameters.magnetic_direction_w is not None:
        return cross(magnetometer_b, rotate_inverse(attitude_wb, _unit(parameters.magnetic_direction_w)))
    north, east, _ = rotate(attitude_wb, magnetometer_b)
    return rotate_inverse(attitude_wb, (0.0, 0.0, -east * hypot(north, east)))
