"""The reference filter on six degrees of freedom, with a quaternion error state.

``x = [dp, dphi, v, w, a, alpha]``, third order on each axis (Fossen 2021, 12.1):
``jerk = W^3 r - (2 zeta + 1) W^2 v - (2 zeta + 1) W a`` with r the error of the goal against the nominal pose. After
each step dp and dphi go into the nominal pose and are zero again. As ``dphi`` multiplies from the right, the angular
velocity and acceleration are those about the body's axes, all the way: the original names them world-frame, which is
right only near the identity. What flies is ``FilterPlan``; this is the whole form, for six axes that can all be held.
"""

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import cast

import numpy as np
from scipy.linalg import expm

from daemon.frames import add, conjugate, exp, log, multiply, normalized, subtract
from daemon.guidance.saturation import Cascade, cascade, step_axis
from daemon.guidance.waypoint_modes import Pose, WaypointMode, goal_pose
from daemon.messages import ZERO3, Quat, Vec3
from daemon.values import value


class Integrator(Enum):
    """How a step is integrated: the matrix exponential, or the original's forward Euler."""

    EXACT = "exact"
    EULER = "euler"


class RotationError(Enum):
    """Error of two attitudes: the rotation vector, or the original's 2 vec(q), which is short for large angles."""

    LOGARITHM = "logarithm"
    VECTOR_PART = "vector_part"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisLimits:
    """Bounds of each of three axes: velocity, acceleration, jerk (SI, or their angular counterparts)."""

    velocity: float
    acceleration: float
    jerk: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterParameters:
    """Natural frequency (rad/s) and damping per axis: three of position in NED, three of rotation in the body.

    With limits (both or none) the filter takes its saturated form, which is integrated exactly in any case.
    """

    omega_rad_s: tuple[float, ...] = (1.0,) * 6
    zeta: tuple[float, ...] = (1.0,) * 6
    dt_s: float = 0.01
    integrator: Integrator = Integrator.EXACT
    rotation_error: RotationError = RotationError.LOGARITHM
    linear_limits: AxisLimits | None = None
    angular_limits: AxisLimits | None = None


@value
class FilterState:
    """Nominal pose and its derivatives: linear ones in NED, angular ones about the body's axes."""

    pose: Pose
    velocity_ned_m_s: Vec3 = ZERO3
    rates_frd_rad_s: Vec3 = ZERO3
    acceleration_ned_m_s2: Vec3 = ZERO3
    angular_acceleration_frd_rad_s2: Vec3 = ZERO3


def step(state: FilterState, goal: Pose, parameters: FilterParameters) -> FilterState:
    """The filter one ``dt_s`` later."""
    ahead = subtract(goal.position_ned_m, state.pose.position_ned_m)
    turn = rotation_error(state.pose.attitude_wb, goal.attitude_wb, parameters.rotation_error)
    p = parameters
    dp, v, a = _three_axes(p, 0, ahead, state.velocity_ned_m_s, state.acceleration_ned_m_s2, p.linear_limits)
    angular = (state.rates_frd_rad_s, state.angular_acceleration_frd_rad_s2)
    dphi, w, alpha = _three_axes(p, 3, turn, *angular, p.angular_limits)
    attitude = normalized(multiply(state.pose.attitude_wb, exp(dphi)))
    return FilterState(Pose(add(state.pose.position_ned_m, dp), attitude), v, w, a, alpha)


def set_reference(state: FilterState, mode: WaypointMode, wanted: Pose) -> Pose:
    """A new goal in flight: taken in its mode as seen from the filter's pose; the filter's state is not touched."""
    return goal_pose(mode, wanted, state.pose)


def snap(goal: Pose) -> FilterState:
    """The filter at rest in the goal: velocities and accelerations are zero too."""
    return FilterState(goal)


def rotation_error(nominal_wb: Quat, goal_wb: Quat, form: RotationError) -> Vec3:
    """Rotation from the nominal attitude to the goal about the body's axes, rad; the shorter way."""
    turn = multiply(conjugate(nominal_wb), goal_wb)
    if form is RotationError.LOGARITHM:
        return log(turn)
    sign = 2.0 if turn[0] >= 0.0 else -2.0
    return (sign * turn[1], sign * turn[2], sign * turn[3])


def _three_axes(
    parameters: FilterParameters, first: int, error: Vec3, rate: Vec3, acceleration: Vec3, limits: AxisLimits | None
) -> tuple[Vec3, Vec3, Vec3]:
    """Step of three axes: increment, rate and acceleration after it."""
    axes = [
        _axis(parameters, first + i, error[i], rate[i], acceleration[i])
        if limits is None
        else _saturated_axis(_gains(parameters, first + i, limits), error[i], rate[i], acceleration[i])
        for i in range(3)
    ]
    increments, rates, accelerations = zip(*axes, strict=True)
    return cast(Vec3, increments), cast(Vec3, rates), cast(Vec3, accelerations)


def _axis(parameters: FilterParameters, axis: int, error: float, v: float, a: float) -> Vec3:
    """One linear step of one axis."""
    omega, zeta, dt = parameters.omega_rad_s[axis], parameters.zeta[axis], parameters.dt_s
    if parameters.integrator is Integrator.EULER:
        c = 2.0 * zeta + 1.0
        return (v * dt, v + a * dt, a + (omega**3 * error - c * omega**2 * v - c * omega * a) * dt)
    (xr, xv, xa), (vr, vv, va), (ar, av, aa) = _exact(omega, zeta, dt)
    return (xr * error + xv * v + xa * a, vr * error + vv * v + va * a, ar * error + av * v + aa * a)


@lru_cache(maxsize=64)
def _exact(omega: float, zeta: float, dt: float) -> tuple[Vec3, ...]:
    """Rows (increment, rate, acceleration) over columns (error, rate, acceleration) of one exact step."""
    c = 2.0 * zeta + 1.0
    error, rate, acceleration = [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [omega**3, -c * omega**2, -c * omega]
    transition = expm(np.array([error, rate, acceleration]) * dt)
    transition[0] = np.array([1.0, 0.0, 0.0]) - transition[0]  # the increment is what the error lost
    return tuple((float(row[0]), float(row[1]), float(row[2])) for row in transition)


@lru_cache(maxsize=64)
def _gains(parameters: FilterParameters, axis: int, limits: AxisLimits) -> Cascade:
    return cascade(
        omega_rad_s=parameters.omega_rad_s[axis],
        zeta=parameters.zeta[axis],
        speed_high_m_s=limits.velocity,
        speed_low_m_s=-limits.velocity,
        acceleration_m_s2=limits.acceleration,
        jerk_m_s3=limits.jerk,
        dt_s=parameters.dt_s,
    )


def _saturated_axis(gains: Cascade, error: float, v: float, a: float) -> Vec3:
    """One saturated step of one axis: the jerk is constant over it."""
    jerk, dt = step_axis(gains, error, v, a), gains.dt_s
    return (
        v * dt + 0.5 * a * dt * dt + jerk * dt**3 / 6.0,
        v + a * dt + 0.5 * jerk * dt * dt,
        a + jerk * dt,
    )
