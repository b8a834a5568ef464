"""From the last state to the moment at which a command acts."""

from dataclasses import dataclass
from math import exp

from daemon.frames import clip_norm, integrate, is_finite
from daemon.messages import ZERO3, EstimatedState, Vec3
from daemon.values import value


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


@value
class SentRates:
    """Body rates commanded at ``time_s`` of the loop clock, in force until the next ones."""

    time_s: float
    rates_frd_rad_s: Vec3


def predict(
    state: EstimatedState,
    to_time_s: float,
    acceleration_ned_m_s2: Vec3,
    commands: tuple[SentRates, ...] = (),
    *,
    parameters: PredictorParameters,
) -> EstimatedState:
    """The state at ``to_time_s``, at most ``horizon_s`` ahead and never back; finite whatever the arguments.

    ``acceleration_ned_m_s2`` is the vehicle's own (thrust and gravity together), taken as constant. ``commands`` are
    the rates sent of late, oldest first: each acts after the rate loop's dead time and lag, before that the measured
    rates stay. The attitude turns by the mean rates. What is not finite counts as none.
    """
    dt = to_time_s - state.time_s
    if not dt > 0.0:
        return state
    dt = min(dt, parameters.horizon_s)
    acceleration = acceleration_ned_m_s2 if is_finite(acceleration_ned_m_s2) else ZERO3
    acceleration = clip_norm(acceleration, parameters.acceleration_max_m_s2)
    position, velocity = moved(state.position_ned_m, state.velocity_ned_m_s, acceleration, dt)
    mean, rates = _turned(state, commands, dt, parameters)
    attitude = integrate(state.attitude_wb, mean, dt)
    return EstimatedState(state.time_s + dt, position, velocity, attitude, rates, state.position_variance_m2)


def remembered(
    commands: tuple[SentRates, ...], now_s: float, rates_frd_rad_s: Vec3, *, parameters: PredictorParameters
) -> tuple[SentRates, ...]:
    """The commands with one more, without those that have been superseded for longer than any prediction looks back."""
    oldest = now_s - parameters.horizon_s - max(parameters.rate_dead_time_s)
    first = 0
    while first + 1 < len(commands) and commands[first + 1].time_s < oldest:
        first += 1
    return (*commands[first:], SentRates(now_s, rates_frd_rad_s))


def moved(position_ned_m: Vec3, velocity_ned_m_s: Vec3, acceleration_ned_m_s2: Vec3, dt_s: float) -> tuple[Vec3, Vec3]:
    """Position and velocity after ``dt_s`` of constant acceleration."""
    (x, y, z), (vx, vy, vz), (ax, ay, az) = position_ned_m, velocity_ned_m_s, acceleration_ned_m_s2
    half = 0.5 * dt_s
    wx, wy, wz = vx + ax * dt_s, vy + ay * dt_s, vz + az * dt_s
    return (x + (vx + wx) * half, y + (vy + wy) * half, z + (vz + wz) * half), (wx, wy, wz)


def _turned(
    state: EstimatedState, commands: tuple[SentRates, ...], dt_s: float, parameters: PredictorParameters
) -> tuple[Vec3, Vec3]:
    """Mean body rates over ``dt_s`` and rates at its end."""
    mean_x, x = _axis(0, state, commands, dt_s, parameters)
    mean_y, y = _axis(1, state, commands, dt_s, parameters)
    mean_z, z = _axis(2, state, commands, dt_s, parameters)
    return (mean_x, mean_y, mean_z), (x, y, z)


def _axis(
    axis: int, state: EstimatedState, commands: tuple[SentRates, ...], dt_s: float, parameters: PredictorParameters
) -> tuple[float, float]:
    """Mean rate of one axis over ``dt_s`` and rate at its end: one lag after the other, as the commands take effect."""
    limit, lag_s = parameters.rates_max_rad_s, parameters.rate_time_constant_s[axis]
    acting_since = state.time_s - parameters.rate_dead_time_s[axis]
    rate = _believed(state.rates_frd_rad_s[axis], limit)
    following = len(commands)
    while following > 0 and commands[following - 1].time_s > acting_since:
        following -= 1
    command = _believed(commands[following - 1].rates_frd_rad_s[axis], limit) if following > 0 else rate
    elapsed, angle = 0.0, 0.0
    for sent in (*commands[following:], None):
        until = dt_s if sent is None else sent.time_s - acting_since
        last = not until < dt_s
        span = (dt_s if last else until) - elapsed
        apart = rate - command
        left = exp(-span / lag_s) if apart != 0.0 and lag_s > 0.0 else 0.0
        angle += command * span + apart * lag_s * (1.0 - left)
        rate = command + apart * left
        if last or sent is None:
            break
        elapsed, command = until, _believed(sent.rates_frd_rad_s[axis], limit)
    return angle / dt_s, rate


def _believed(rate: float, limit: float) -> float:
    """The rate within its bound; zero when it is not a number."""
    if -limit <= rate <= limit:
        return rate
    return limit if rate > limit else -limit if rate < -limit else 0.0
