"""Prediction of the extended Kalman filter: the state by the motion model, its covariance by the Jacobian."""

import numpy as np

from daemon.estimation.filter_control import ControlAcceleration, controlled
from daemon.estimation.motion_model import Matrix, Vector, jacobian, project


def predict(
    x: Vector, P: Matrix, dt_s: float, acceleration: ControlAcceleration, noise: Matrix
) -> tuple[Vector, Matrix]:
    """State (15) and covariance (15 x 15) after ``dt_s``; ``noise`` is the process noise of that time."""
    moving = controlled(x.tolist(), acceleration, dt_s)
    F = jacobian(moving, dt_s)
    predicted = F @ P @ F.T + noise
    return np.array(project(moving, dt_s)), 0.5 * (predicted + predicted.T)
