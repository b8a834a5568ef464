"""The control term of the Kalman filters: what was commanded becomes the acceleration of the prediction."""

from collections.abc import Sequence
from dataclasses import dataclass

from daemon.estimation.motion_model import TWIST_SIZE
from daemon.frames import clamp, from_rpy, is_finite, rotate_inverse
from daemon.messages import ZERO3, Vec3

Twist = tuple[float, float, float, float, float, float]
AxisFlags = tuple[bool, bool, bool, bool, bool, bool]
ControlAcceleration = tuple[float | None, ...]

_ONES: Twist = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
_STANDSTILL: Twist = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_SAME_SIGN_MARGIN = 0.01  # m/s and rad/s; robot_localization's


@dataclass(frozen=True, slots=True)
class VelocityControl:
    """Velocity and angular velocity in the body that were commanded at ``stamp_s``."""

    stamp_s: float
    target: Twist


@dataclass(frozen=True, slots=True)
class AccelerationControl:
    """Acceleration in the world (NED) that was commanded at ``stamp_s``."""

    stamp_s: float
    acceleration_ned_m_s2: Vec3


Control = VelocityControl | AccelerationControl


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlParameters:
    """Axes under control (vx vy vz wx wy wz), and what acceleration a command can cause on each.

    Limits in m/s^2 and rad/s^2; gains in 1/s turn a velocity error into an acceleration.
    """

    axes: AxisFlags = (True, True, True, True, True, True)
    timeout_s: float = 0.2
    acceleration_limits: Twist = _ONES
    acceleration_gains: Twist = _ONES
    deceleration_limits: Twist = _ONES
    deceleration_gains: Twist = _ONES


def control_acceleration(
    x: Sequence[float], control: Control | None, at_s: float, parameters: ControlParameters
) -> ControlAcceleration:
    """Acceleration on each of the six velocity axes of the body, None where the command has no say.

    A command that is older than the time-out or not finite counts as zero: zero velocity of a velocity command, zero
    acceleration of an acceleration command. The latter says nothing of the angular axes.
    """
    timed_out = control is None or not at_s - control.stamp_s < parameters.timeout_s
    if isinstance(control, AccelerationControl):
        stale = timed_out or not is_finite(control.acceleration_ned_m_s2)
        wanted = ZERO3 if stale else control.acceleration_ned_m_s2
        return _from_acceleration(x, wanted, parameters)
    stale = control is None or timed_out or not is_finite(control.target)
    target = _STANDSTILL if control is None or stale else control.target
    return tuple(
        _from_velocity(x[6 + axis], target[axis], axis, parameters) if parameters.axes[axis] else None
        for axis in range(TWIST_SIZE)
    )


def controlled(x: Sequence[float], acceleration: ControlAcceleration, dt_s: float) -> list[float]:
    """The state with the control term in it: linear accelerations replaced, angular velocities pushed on."""
    y = list(x)
    for axis in range(3):
        linear, angular = acceleration[axis], acceleration[axis + 3]
        if linear is not None:
            y[12 + axis] = linear
        if angular is not None:
            y[9 + axis] += angular * dt_s
    return y


def _from_velocity(state: float, control: float, axis: int, parameters: ControlParameters) -> float:
    error = control - state
    same_sign = abs(error) <= abs(control) + _SAME_SIGN_MARGIN
    set_point = control if same_sign else 0.0
    if abs(set_point) < abs(state):
        limit, gain = parameters.deceleration_limits[axis], parameters.deceleration_gains[axis]
    else:
        limit, gain = parameters.acceleration_limits[axis], parameters.acceleration_gains[axis]
    return clamp(gain * error, -limit, limit)


def _from_acceleration(x: Sequence[float], wanted_ned: Vec3, parameters: ControlParameters) -> ControlAcceleration:
    """In the turning body ``d/dt v = R^T a - w x v`` (transport theorem): the motion model has the left side only."""
    ax, ay, az = rotate_inverse(from_rpy(x[3], x[4], x[5]), wanted_ned)
    vx, vy, vz, wx, wy, wz = x[6:12]
    transport = (wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx)
    linear = tuple(
        clamp(a, -limit, limit) - c if used else None
        for a, c, limit, used in zip(
            (ax, ay, az), transport, parameters.acceleration_limits, parameters.axes, strict=False
        )
    )
    return (*linear, None, None, None)
