"""What EKF and UKF share: state, measurements, gate, correction, the cycle of prediction and correction.

After robot_localization's FilterBase (Moore, Stouch 2014). The two filters differ in the prediction only, which is the
``predictor`` of the parameters (``ekf.predict``, ``ukf.Unscented``): every measurement is a part of the state vector,
so it is linear, and there the unscented correction is the Kalman correction itself.

State in, state out: a ``FilterState`` is never changed, so a history of them costs nothing but memory. Each value of
the state is read from its field and set by ``with_state`` or ``dataclasses.replace``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, sqrt

import numpy as np
from scipy.linalg.lapack import dposv

from daemon.estimation.filter_control import Control, ControlAcceleration, ControlParameters, control_acceleration
from daemon.estimation.motion_model import ANGLES, POSE_SIZE, STATE_SIZE, TWIST_SIZE, Matrix, Vector
from daemon.frames import wrap_pi
from daemon.values import value

Predictor = Callable[[Vector, Matrix, float, ControlAcceleration, Matrix], tuple[Vector, Matrix]]
"""(x, P, dt_s, control acceleration, process noise of dt_s) -> (x, P) after dt_s."""

NO_CONTROL: ControlAcceleration = (None,) * TWIST_SIZE
PROCESS_NOISE_1_S = (0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015)
_MIN_VARIANCE = 1e-9  # no measurement is without error; keeps the innovation's covariance regular
_REPLACEMENT_DELTA_S = 0.01  # what robot_localization puts for an absurd step


def frozen(array: Matrix) -> Matrix:
    """The array itself, no longer writable."""
    array.flags.writeable = False
    return array


_IDENTITY = frozen(np.eye(STATE_SIZE))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterParameters:
    """What does not change in flight."""

    predictor: Predictor
    process_noise_1_s: Matrix = field(default_factory=lambda: frozen(np.diag(PROCESS_NOISE_1_S)))  # 15 x 15, a second
    initial_variance: float = 1e-9  # of what the first measurement does not hold
    dynamic_process_noise: bool = False  # pose noise grows with the squared norm of the six velocities
    sensor_timeout_s: float = 1.0 / 30.0  # after this silence the filter predicts without a measurement
    max_delta_s: float = 1e5  # a longer step is a broken clock
    covariance_epsilon: float = 1e-12  # onto the diagonal at each prediction, keeps P positive definite
    control: ControlParameters | None = None


@value
class FilterState:
    """Estimate ``x`` (15), covariance ``P`` (15 x 15) at ``stamp_s``; ``predicted_x`` is x before the correction."""

    x: Vector
    P: Matrix
    predicted_x: Vector
    stamp_s: float = -inf
    initialized: bool = False
    control: Control | None = None


@value
class Measurement:
    """Measured part of the state: values (m) at the places ``indices`` with covariance (m x m).

    ``mahalanobis_threshold`` in sigmas gates the whole message.
    """

    stamp_s: float
    indices: tuple[int, ...]
    values: Vector
    covariance: Matrix
    mahalanobis_threshold: float = inf
    source: str = ""


@value
class Correction:
    """What became of a measurement, for record and debugging.

    ``refused``: None when accepted, else empty, stamp, covariance, unpredicted, singular, mahalanobis, diverged,
    too_old.
    ``indices`` are the places that were used: values that are not finite are left out.
    """

    source: str
    stamp_s: float
    refused: str | None
    indices: tuple[int, ...] = ()
    innovation: tuple[float, ...] = ()
    mahalanobis: float = 0.0


def initial(parameters: FilterParameters) -> FilterState:
    """A filter that waits for its first measurement."""
    zero = frozen(np.zeros(STATE_SIZE))
    return FilterState(zero, frozen(_IDENTITY * parameters.initial_variance), zero)


def partial(
    stamp_s: float,
    values: Sequence[float],
    covariance: Matrix,
    update_vector: Sequence[bool],
    mahalanobis_threshold: float = inf,
    source: str = "",
) -> Measurement:
    """Measurement from a full vector of 15 with covariance 15 x 15: the part that ``update_vector`` names."""
    indices = tuple(i for i, used in enumerate(update_vector) if used)
    chosen = list(indices)
    return Measurement(
        stamp_s,
        indices,
        np.asarray(values, dtype=np.float64)[chosen],
        np.asarray(covariance, dtype=np.float64)[np.ix_(chosen, chosen)],
        mahalanobis_threshold,
        source,
    )


def with_state(state: FilterState, x: Sequence[float] | Vector, P: Matrix | None = None) -> FilterState:
    """The state set by hand, with another covariance if given. Raises ValueError on a shape or number it cannot be."""
    estimate = np.array(x, dtype=np.float64)
    covariance = state.P if P is None else np.array(P, dtype=np.float64)
    if estimate.shape != (STATE_SIZE,) or covariance.shape != (STATE_SIZE, STATE_SIZE):
        raise ValueError("filter: the state has 15 numbers, its covariance 15 x 15")
    if not (np.isfinite(estimate).all() and np.isfinite(covariance).all()):
        raise ValueError("filter: state and covariance must be finite")
    wrap_angles(estimate)
    return replace(state, x=frozen(estimate), P=frozen(covariance), initialized=True)


def validate_delta(delta_s: float, parameters: FilterParameters) -> float:
    """A step that a prediction may take: 0 for one back in time or not finite, 0.01 s for an absurd one."""
    if not isfinite(delta_s) or delta_s <= 0.0:
        return 0.0
    return delta_s if delta_s <= parameters.max_delta_s else _REPLACEMENT_DELTA_S


def process_noise(state: FilterState, parameters: FilterParameters) -> Matrix:
    """Process noise a second; with the dynamic option its pose block times the squared norm of the velocities."""
    if not parameters.dynamic_process_noise:
        return parameters.process_noise_1_s
    velocities = state.x[POSE_SIZE : POSE_SIZE + TWIST_SIZE]
    noise = parameters.process_noise_1_s.copy()
    noise[:POSE_SIZE, :POSE_SIZE] *= float(velocities @ velocities)
    return noise


def predict(state: FilterState, to_s: float, parameters: FilterParameters) -> FilterState:
    """The state carried to ``to_s`` by the motion model and the control term.

    Where that would not be finite, the same state comes back, its stamp unmoved.
    """
    dt_s = validate_delta(to_s - state.stamp_s, parameters)
    if dt_s == 0.0:
        return state
    acceleration = NO_CONTROL
    if parameters.control is not None:
        acceleration = control_acceleration(state.x.tolist(), state.control, to_s, parameters.control)
    x, P = parameters.predictor(state.x, state.P, dt_s, acceleration, process_noise(state, parameters) * dt_s)
    P.ravel()[:: STATE_SIZE + 1] += parameters.covariance_epsilon
    if not _is_sound(x, P):
        return state
    return replace(state, x=frozen(x), P=frozen(P), predicted_x=x, stamp_s=to_s)


def correct(state: FilterState, measurement: Measurement) -> tuple[FilterState, Correction]:
    """Kalman correction in Joseph form, gated by the Mahalanobis distance of the whole message."""
    usable = _usable(measurement)
    if isinstance(usable, str):
        return state, Correction(measurement.source, measurement.stamp_s, usable)
    indices, values, R = usable
    chosen = list(indices)
    innovation = values - state.x[chosen]
    for k, index in enumerate(indices):
        if index in ANGLES:
            innovation[k] = wrap_pi(float(innovation[k]))
    PHt = state.P[:, chosen]
    right = np.empty((len(chosen), STATE_SIZE + 1))
    right[:, :STATE_SIZE] = PHt.T
    right[:, STATE_SIZE] = innovation
    _, solved, info = dposv(PHt[chosen] + R, right, lower=1)
    gain = solved[:, :STATE_SIZE].T
    squared = float(innovation @ solved[:, STATE_SIZE])
    x, P, refused = state.x, state.P, None
    if info != 0 or not squared >= 0.0:
        refused, squared = "singular", 0.0
    elif squared >= measurement.mahalanobis_threshold**2:
        refused = "mahalanobis"
    else:
        x = state.x + gain @ innovation
        P = _joseph(state.P, chosen, gain, R)
        wrap_angles(x)
        if not _is_sound(x, P):
            refused = "diverged"
    record = Correction(
        measurement.source, measurement.stamp_s, refused, indices, tuple(innovation.tolist()), sqrt(squared)
    )
    return (state if refused else replace(state, x=frozen(x), P=frozen(P))), record


def process(
    state: FilterState, measurement: Measurement, parameters: FilterParameters
) -> tuple[FilterState, Correction]:
    """One cycle: predict to the measurement's stamp when that lies ahead, then correct. The first one initializes.

    A state that cannot be predicted takes no measurement: it would be believed as if no time had gone by.
    """
    if not isfinite(measurement.stamp_s):
        return state, Correction(measurement.source, measurement.stamp_s, "stamp")
    if not state.initialized:
        return _initialize(state, measurement)
    predicted = predict(state, measurement.stamp_s, parameters)
    if predicted is state and validate_delta(measurement.stamp_s - state.stamp_s, parameters) > 0.0:
        return state, Correction(measurement.source, measurement.stamp_s, "unpredicted")
    return correct(predicted, measurement)


def advance(state: FilterState, now_s: float, parameters: FilterParameters) -> FilterState:
    """Predict to now when no measurement came for the sensor time-out."""
    silent = state.initialized and now_s - state.stamp_s >= parameters.sensor_timeout_s
    return predict(state, now_s, parameters) if silent else state


def wrap_angles(x: Vector) -> None:
    """Wrap roll, pitch and yaw to [-pi, pi) in place."""
    for index in ANGLES:
        x[index] = wrap_pi(float(x[index]))


def _initialize(state: FilterState, measurement: Measurement) -> tuple[FilterState, Correction]:
    usable = _usable(measurement)
    if isinstance(usable, str):
        return state, Correction(measurement.source, measurement.stamp_s, usable)
    indices, values, R = usable
    x, P = state.x.copy(), state.P.copy()
    x[list(indices)] = values
    P[np.ix_(indices, indices)] = R
    wrap_angles(x)
    state = replace(state, x=frozen(x), P=frozen(P), predicted_x=x, stamp_s=measurement.stamp_s, initialized=True)
    return state, Correction(measurement.source, measurement.stamp_s, None, indices)


def _usable(measurement: Measurement) -> tuple[tuple[int, ...], Vector, Matrix] | str:
    """Finite part of the measurement with a covariance whose diagonal is positive, or why there is none."""
    indices, values, R = measurement.indices, measurement.values, measurement.covariance
    finite = np.isfinite(values)
    if not finite.all():
        indices = tuple(index for index, good in zip(indices, finite, strict=True) if good)
        values, R = values[finite], R[np.ix_(finite, finite)]
    if not indices:
        return "empty"
    if not np.isfinite(R).all():
        return "covariance"
    diagonal = R.diagonal()
    if diagonal.min() < _MIN_VARIANCE:
        R = R.copy()
        np.fill_diagonal(R, np.maximum(np.abs(diagonal), _MIN_VARIANCE))
    return indices, values, R


def _joseph(P: Matrix, chosen: list[int], gain: Matrix, R: Matrix) -> Matrix:
    """(I - K H) P (I - K H)^T + K R K^T, made symmetric to the last bit."""
    residual = _IDENTITY.copy()
    residual[:, chosen] -= gain
    corrected = residual @ P @ residual.T + gain @ R @ gain.T
    return 0.5 * (corrected + corrected.T)


def _is_sound(x: Vector, P: Matrix) -> bool:
    return bool(isfinite(float(x.sum())) and isfinite(float(P.sum())) and P.diagonal().min() >= 0.0)
