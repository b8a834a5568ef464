"""Prediction of the unscented Kalman filter: 31 sigma points through the motion model.

Wan, van der Merwe 2000, with scaled points. Departures from robot_localization, which leaves R out of the corrected
covariance, corrects with points that lack the process noise, and ignores the control term: here the correction is the
base's, and the control term moves all points alike, as it does the mean in the EKF. It also averages angles by sines
and cosines. With points as near and weights as large as these the cosine is 1 less half the variance, so that mean goes
too far and turns round at 2 rad2: here it is the mean of the differences to the central point.
"""

from dataclasses import dataclass

import numpy as np

from daemon.estimation.filter_control import ControlAcceleration, controlled
from daemon.estimation.motion_model import ANGLES, STATE_SIZE, Matrix, Vector, project
from daemon.frames import wrap_pi

_EIGENVALUE_FLOOR = 1e-12  # of a covariance that rounding has made indefinite


@dataclass(frozen=True, slots=True, kw_only=True)
class Unscented:
    """Spread of the sigma points; call it to predict. Raises ValueError when the points would coincide.

    ``circular_mean``: angles as robot_localization averages them, for its numbers.
    """

    alpha: float = 1e-3
    kappa: float = 0.0
    beta: float = 2.0
    circular_mean: bool = False

    def __post_init__(self) -> None:
        if not self.alpha * self.alpha * (STATE_SIZE + self.kappa) > 0.0:
            raise ValueError("ukf: alpha must not be 0 and kappa be above -15")

    def __call__(
        self, x: Vector, P: Matrix, dt_s: float, acceleration: ControlAcceleration, noise: Matrix
    ) -> tuple[Vector, Matrix]:
        """State (15) and covariance (15 x 15) after ``dt_s``; ``noise`` is the process noise of that time."""
        spread = self.alpha * self.alpha * (STATE_SIZE + self.kappa)
        center = x.tolist()
        push = np.array(controlled(center, acceleration, dt_s)) - x
        root = _square_root(spread * P)
        offsets = np.concatenate((root.T, -root.T))
        first = np.array(project((x + push).tolist(), dt_s))
        others = np.array([project(point, dt_s) for point in (x + push + offsets).tolist()])
        # Differences to the first point: the weights are as large as 1e6 and cancel, sums of the points would not do.
        apart = others - first
        apart[:, 3:6] = (apart[:, 3:6] + np.pi) % (2.0 * np.pi) - np.pi
        weight = 0.5 / spread
        average = weight * apart.sum(axis=0)
        mean = _circular(average, apart, weight) if self.circular_mean else average
        # The sum over all points about the mean, with what cancels in it left out.
        missed = np.outer(average - mean, mean)
        covariance = weight * apart.T @ apart + noise - missed - missed.T
        covariance += (self.beta - self.alpha * self.alpha) * np.outer(mean, mean)
        predicted = first + mean
        for index in ANGLES:
            predicted[index] = wrap_pi(float(predicted[index]))
        return predicted, 0.5 * (covariance + covariance.T)


def _circular(average: Vector, apart: Matrix, weight: float) -> Vector:
    """The weighted mean of all points, of angles by their sines and cosines."""
    mean = average.copy()
    for index in ANGLES:
        sines = weight * np.sin(apart[:, index]).sum()
        cosines = 1.0 - 2.0 * weight * (np.sin(0.5 * apart[:, index]) ** 2).sum()
        mean[index] = np.arctan2(sines, cosines)
    return mean


def _square_root(P: Matrix) -> Matrix:
    """Lower triangular L with L L^T = P; for a matrix that is not positive definite, a root of its nearest one."""
    try:
        return np.asarray(np.linalg.cholesky(P), dtype=np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (P + P.T))
        return np.asarray(vectors * np.sqrt(np.maximum(values, _EIGENVALUE_FLOOR)), dtype=np.float64)
