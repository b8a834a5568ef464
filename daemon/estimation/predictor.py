"""From the last state to the moment at which a command acts."""

from dataclasses import dataclass
from math import exp

from daemon.frames import clip_norm, integrate, is_finite
from daemon.messages import EstimatedState, Quat, Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictorParameters:
    """The rate loop per body axis (roll, pitch, yaw): dead time, then a first-order lag, fitted on PX4's SIH quadrotor.

    ``horizon_s`` bounds the prediction; ``rates_max_rad_s`` and ``acceleration_max_m_s2`` bound what is believed.
    """

    rate_dead_time_s: Vec3 = (0.034, 0.034, 0.115)
    rate_time_constant_s: Vec3 = (0.052, 0.053, 0.315)
    horizon_s: float = 0.5
    rates_max_rad_s: float = 20.0
    acceleration_max_m_s2: float = 40.0


def predict(
    state: EstimatedState,
    to_time_s: float,
    rates_command_frd_rad_s: Vec3,
    acceleration_ned_m_s2: Vec3,
    *,
    parameters: PredictorParameters,
) -> EstimatedState:
    """The state at ``to_time_s``, at most ``horizon_s`` ahead and never back; finite whatever the arguments.

    The body rates go from the measured ones to the command by the rate loop's dead time and lag; the attitude turns by
    their mean. ``acceleration_ned_m_s2`` is the vehicle's own (thrust and gravity together), taken as constant.
    A command that is not finite counts as none: rates stay, acceleration is zero.
    """
    dt = to_time_s - state.time_s
    if not dt > 0.0:
        return state
    dt = min(dt, parameters.horizon_s)
    measured = clip_norm(state.rates_frd_rad_s, parameters.rates_max_rad_s)
    command = _bounded(rates_command_frd_rad_s, parameters.rates_max_rad_s, measured)
    acceleration = _bounded(acceleration_ned_m_s2, parameters.acceleration_max_m_s2, (0.0, 0.0, 0.0))
    dead, lag = parameters.rate_dead_time_s, parameters.rate_time_constant_s
    px, mx = _axis(measured[0], command[0], dt, dead[0], lag[0])
    py, my = _axis(measured[1], command[1], dt, dead[1], lag[1])
    pz, mz = _axis(measured[2], command[2], dt, dead[2], lag[2])
    position, velocity = moved(state.position_ned_m, state.velocity_ned_m_s, acceleration, dt)
    attitude: Quat = integrate(state.attitude_wb, (mx, my, mz), dt)
    return EstimatedState(state.time_s + dt, position, velocity, attitude, (px, py, pz), state.position_variance_m2)


def moved(position_ned_m: Vec3, velocity_ned_m_s: Vec3, acceleration_ned_m_s2: Vec3, dt_s: float) -> tuple[Vec3, Vec3]:
    """Position and velocity after ``dt_s`` of constant acceleration."""
    (x, y, z), (vx, vy, vz), (ax, ay, az) = position_ned_m, velocity_ned_m_s, acceleration_ned_m_s2
    half = 0.5 * dt_s
    wx, wy, wz = vx + ax * dt_s, vy + ay * dt_s, vz + az * dt_s
    return (x + (vx + wx) * half, y + (vy + wy) * half, z + (vz + wz) * half), (wx, wy, wz)


def _bounded(vector: Vec3, limit: float, otherwise: Vec3) -> Vec3:
    """The vector no longer than ``limit``; ``otherwise`` when it is not finite."""
    return clip_norm(vector, limit) if is_finite(vector) else otherwise


def _axis(measured: float, command: float, dt_s: float, dead_time_s: float, lag_s: float) -> tuple[float, float]:
    """Rate at the end of ``dt_s`` and mean rate over it."""
    acting = dt_s - dead_time_s
    if acting <= 0.0:
        return measured, measured
    if lag_s <= 0.0:
        return command, (measured * dead_time_s + command * acting) / dt_s
    left = exp(-acting / lag_s)
    end = command + (measured - command) * left
    turned = measured * dead_time_s + command * acting + (measured - command) * lag_s * (1.0 - left)
    return end, turned / dt_s
