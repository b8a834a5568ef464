"""A reset of the autopilot's frame, applied to filter states, measurements and poses: the same motion in new numbers.

Position and yaw shift; the velocity shifts in NED, so the body's velocity is turned with the yaw and then shifted. The
covariance stays: a turn by the yaw moves only what differs between the horizontal axes.
"""

from dataclasses import replace

import numpy as np

from daemon.estimation.filter_base import FilterState, Measurement, frozen
from daemon.estimation.lagged import Entry, LaggedState
from daemon.estimation.motion_model import Vector
from daemon.frames import add, from_rpy, from_yaw, is_finite, multiply, rotate, rotate_inverse, wrap_pi
from daemon.messages import ZERO3, ExternalPose, Reset, Vec3


def shifted_filter(lagged: LaggedState, reset: Reset) -> LaggedState:
    """The filter and its history. A reset that is not finite shifts nothing.

    A reset of the velocity says that positions and velocities of before did not fit: there the history ends.
    """
    if not is_finite((*reset.position_ned_m, *reset.velocity_ned_m_s, reset.yaw_rad)):
        return lagged
    kept = lagged.history if reset.velocity_ned_m_s == ZERO3 else lagged.history[-1:]
    history = tuple(Entry(_shifted_measurement(entry, reset), _shifted_state(entry.state, reset)) for entry in kept)
    return LaggedState(_shifted_state(lagged.state, reset), history)


def shifted_pose(pose: ExternalPose, reset: Reset) -> ExternalPose:
    """A pose from outside that was stamped before the reset."""
    attitude = pose.attitude_wb and multiply(from_yaw(reset.yaw_rad), pose.attitude_wb)
    return replace(pose, position_ned_m=add(pose.position_ned_m, reset.position_ned_m), attitude_wb=attitude)


def _shifted_state(state: FilterState, reset: Reset) -> FilterState:
    if not state.initialized:
        return state
    x = _shifted_vector(state.x, state.x, reset)
    return replace(state, x=x, predicted_x=_shifted_vector(state.predicted_x, state.predicted_x, reset))


def _shifted_measurement(entry: Entry, reset: Reset) -> Measurement:
    """What was not measured is filled up from the state, so that the velocity can be turned as a whole."""
    measurement = entry.measurement
    chosen = list(measurement.indices)
    full = entry.state.x.copy()
    full[chosen] = measurement.values
    return replace(measurement, values=_shifted_vector(full, entry.state.x, reset)[chosen])


def _shifted_vector(x: Vector, attitude_from: Vector, reset: Reset) -> Vector:
    roll, pitch, yaw = attitude_from[3:6].tolist()
    velocity: Vec3 = (float(x[6]), float(x[7]), float(x[8]))
    velocity_ned = add(rotate(from_rpy(roll, pitch, yaw), velocity), reset.velocity_ned_m_s)
    y = x.copy()
    y[0:3] += np.array(reset.position_ned_m)
    y[5] = wrap_pi(float(x[5]) + reset.yaw_rad)
    y[6:9] = rotate_inverse(from_rpy(roll, pitch, yaw + reset.yaw_rad), velocity_ned)
    return frozen(y)
