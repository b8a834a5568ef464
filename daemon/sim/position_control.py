"""PX4's outer loops: position, velocity and attitude controllers with their default gains.

Structure of ``PositionControl`` and ``AttitudeControl`` of PX4 1.17: a cascade of P (position) and PID (velocity),
acceleration to thrust vector and heading, tilt limit, quaternion attitude P. Runs at the estimator's 125 Hz.
"""

from dataclasses import dataclass
from math import asin, atan2, hypot, isfinite, radians, sin, sqrt, tan

from daemon.frames import add, clamp, from_rpy, from_yaw, rotate, rotate_inverse, scale, wrap_pi, yaw_of
from daemon.messages import ZERO3, Quat, Setpoint, Vec3
from daemon.sim.estimator import STEP_S, Estimate, Jump
from daemon.sim.vehicle import SIM_GRAVITY_M_S2

_POSITION_P = (0.95, 0.95, 1.0)
_VELOCITY_P = (1.8, 1.8, 4.0)
_VELOCITY_I = (0.4, 0.4, 2.0)
_VELOCITY_D = (0.2, 0.2, 0.0)
_ATTITUDE_P = (4.0, 4.0, 2.8)  # MC_ROLL_P, MC_PITCH_P, MC_YAW_P
_YAW_WEIGHT = 0.4  # MC_YAW_WEIGHT
_RATE_LIMIT_RAD_S = (radians(220.0), radians(220.0), radians(200.0))
_INTEGRAL_LIMIT_M_S2 = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """Where and how fast; a NaN position leaves that axis to its velocity."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    yaw_rad: float


class PositionControl:
    """The cascade with its integrals; ``hover_thrust``: MPC_THR_HOVER."""

    def __init__(self, hover_thrust: float, min_thrust: float) -> None:
        self.hover_thrust = hover_thrust
        self._min_thrust = min_thrust
        self._integral: Vec3 = ZERO3
        self._last_velocity: Vec3 | None = None

    def restart(self) -> None:
        """Forget the integrals."""
        self._integral, self._last_velocity = ZERO3, None

    def shift(self, jump: Jump) -> None:
        """A reset of the estimator is no motion."""
        if self._last_velocity is not None:
            self._last_velocity = add(self._last_velocity, jump.velocity_ned_m_s)

    def run(self, wanted: Wanted, estimate: Estimate, tilt_limit_rad: float) -> Setpoint:
        """Body rates and thrust."""
        acceleration = self._acceleration(wanted, estimate)
        attitude, thrust = self._thrust(acceleration, wanted.yaw_rad, tilt_limit_rad)
        return Setpoint(attitude_rates(attitude, estimate.attitude_wb), thrust)

    def _acceleration(self, wanted: Wanted, estimate: Estimate) -> Vec3:
        velocity = estimate.velocity_ned_m_s
        last, self._last_velocity = self._last_velocity or velocity, velocity
        result, integral = [0.0, 0.0, 0.0], list(self._integral)
        for i in range(3):
            speed = wanted.velocity_ned_m_s[i]
            if isfinite(wanted.position_ned_m[i]):
                speed += _POSITION_P[i] * (wanted.position_ned_m[i] - estimate.position_ned_m[i])
            error = speed - velocity[i]
            slope = (velocity[i] - last[i]) / STEP_S
            result[i] = _VELOCITY_P[i] * error + integral[i] - _VELOCITY_D[i] * slope
            grown = integral[i] + _VELOCITY_I[i] * error * STEP_S
            integral[i] = clamp(grown, -_INTEGRAL_LIMIT_M_S2, _INTEGRAL_LIMIT_M_S2)
        self._integral = (integral[0], integral[1], integral[2])
        return (result[0], result[1], result[2])

    def _thrust(self, acceleration: Vec3, yaw_rad: float, tilt_limit_rad: float) -> tuple[Quat, float]:
        ax, ay, az = acceleration
        up = max(SIM_GRAVITY_M_S2 - az, 0.3)  # specific force upwards; never upside down
        sideways = hypot(ax, ay)
        widest = tan(tilt_limit_rad) * SIM_GRAVITY_M_S2
        if sideways > widest:
            ax, ay = ax * widest / sideways, ay * widest / sideways
        cosine = SIM_GRAVITY_M_S2 / sqrt(ax * ax + ay * ay + SIM_GRAVITY_M_S2 * SIM_GRAVITY_M_S2)
        thrust = self.hover_thrust * up / SIM_GRAVITY_M_S2 / cosine
        return attitude_of((ax, ay, -SIM_GRAVITY_M_S2), yaw_rad), clamp(thrust, self._min_thrust, 1.0)


def attitude_of(thrust_direction_ned: Vec3, yaw_rad: float) -> Quat:
    """Attitude with the thrust along a direction (upwards) and a heading."""
    tx, ty, tz = rotate_inverse(from_yaw(yaw_rad), thrust_direction_ned)
    length = sqrt(tx * tx + ty * ty + tz * tz)
    roll = asin(clamp(ty / length, -1.0, 1.0))
    pitch = atan2(-tx, -tz)
    return from_rpy(roll, pitch, yaw_rad)


def attitude_rates(wanted_wb: Quat, attitude_wb: Quat) -> Vec3:
    """PX4's attitude P (``AttitudeControl::update``): thrust axis at full gain, heading about it at its own."""
    tilt_error, yaw_error = _split(wanted_wb, attitude_wb)
    rates = add(
        (_ATTITUDE_P[0] * tilt_error[0], _ATTITUDE_P[1] * tilt_error[1], 0.0),
        scale(rotate_inverse(attitude_wb, (0.0, 0.0, 1.0)), _ATTITUDE_P[2] * yaw_error),
    )
    lx, ly, lz = _RATE_LIMIT_RAD_S
    return (clamp(rates[0], -lx, lx), clamp(rates[1], -ly, ly), clamp(rates[2], -lz, lz))


def _split(wanted_wb: Quat, attitude_wb: Quat) -> tuple[Vec3, float]:
    """Shortest turn of the thrust axis (body frame, about x and y) and the error of the heading, as 2 sin(half)."""
    zx, zy, zz = rotate_inverse(attitude_wb, rotate(wanted_wb, (0.0, 0.0, 1.0)))
    sine = hypot(zx, zy)
    angle = atan2(sine, zz)
    factor = 2.0 * sin(0.5 * angle) / sine if sine > 1e-9 else (1.0 if zz > 0.0 else 0.0)
    yaw = wrap_pi(yaw_of(wanted_wb) - yaw_of(attitude_wb))
    return (-zy * factor, zx * factor, 0.0), 2.0 * sin(0.5 * _YAW_WEIGHT * yaw) / _YAW_WEIGHT
