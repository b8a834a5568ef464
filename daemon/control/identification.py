"""From step responses to the numbers of an airframe, and from those to the margins that gains have."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import minimize
from scipy.signal import lfilter

from daemon.control.parameters import ControlParameters

Samples = npt.NDArray[np.float64]

_GRID_S = 0.002
_DELAYS_S = (0.0, 0.03, 0.08)  # starts of the search, seconds
_LAGS_S = (0.04, 0.15, 0.4)
_DELAY_MAX_S = 0.4
_LAG_S = (0.002, 2.0)
_DAMPING = (0.2, 3.0)
_FREQUENCIES_RAD_S: Samples = np.logspace(-2.0, 3.0, 20001)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Response = gain / (s^2 / w^2 + 2 damping s / w + 1) after a dead time, or with one lag: gain / (lag s + 1).

    ``natural_frequency_rad_s`` and ``damping`` are None for the first order. ``lag_s`` is 2 damping / w for the
    second: the delay of its ramp response. ``unexplained`` is the part of the response's variance that the fit leaves.
    """

    dead_time_s: float
    lag_s: float
    gain: float
    unexplained: float
    natural_frequency_rad_s: float | None = None
    damping: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustFit:
    """Thrust command to vertical motion: dead time, lag, acceleration at full thrust, drag over mass, hover thrust."""

    dead_time_s: float
    lag_s: float
    full_thrust_m_s2: float
    drag_1_s: float
    hover_thrust: float
    unexplained: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Of the loop broken at the rate command; infinite where the loop never crosses."""

    phase_rad: float
    gain: float
    delay_s: float
    crossover_rad_s: float


def fit_first_order(time_s: Samples, command: Samples, response: Samples) -> Fit:
    """Dead time, lag and gain of a response to a command that is held between its samples.

    Arrays of one length, times ascending; command and response in the same unit. The response's value at rest is
    fitted as well. Raises ValueError when there is nothing to fit: too few samples, no change, numbers not finite.
    """
    grid, held, measured = _resampled(time_s, command, response)
    starts = [(d, lag) for d in _DELAYS_S for lag in _LAGS_S]
    found, (gain, _), left = _search(starts, measured, lambda p: _with_rest(_followed(p[0], _lag(p[1]), grid, held)))
    return Fit(dead_time_s=found[0], lag_s=found[1], gain=gain, unexplained=left)


def fit_second_order(time_s: Samples, command: Samples, response: Samples) -> Fit:
    """As ``fit_first_order`` with a natural frequency and a damping."""
    grid, held, measured = _resampled(time_s, command, response)
    starts = [(d, lag, z) for d in _DELAYS_S[:2] for lag in _LAGS_S for z in (0.7, 1.0)]
    (dead_time, lag, damping), (gain, _), left = _search(
        starts, measured, lambda p: _with_rest(_followed(p[0], _oscillator(p[1], p[2]), grid, held))
    )
    return Fit(
        dead_time_s=dead_time,
        lag_s=lag,
        gain=gain,
        unexplained=left,
        natural_frequency_rad_s=2.0 * damping / lag,
        damping=damping,
    )


def fit_thrust(time_s: Samples, thrust: Samples, velocity_down_m_s: Samples) -> ThrustFit:
    """Dead time, lag, acceleration and drag from the vertical velocity of a level vehicle under thrust steps.

    dv/dt = a0 - k lagged(thrust) - d v, integrated, so that the velocity is not differentiated; thrust linear in the
    command. Errors as ``fit_first_order``, and when more thrust does not raise the vehicle.
    """
    grid, held, velocity = _resampled(time_s, thrust, velocity_down_m_s)
    moved = cumulative_trapezoid(velocity, dx=_GRID_S, initial=0.0)

    def columns(p: tuple[float, ...]) -> Samples:
        pushed = cumulative_trapezoid(_followed(p[0], _lag(p[1]), grid, held), dx=_GRID_S, initial=0.0)
        return np.column_stack((-pushed, -moved, grid - grid[0], np.ones_like(grid)))

    starts = [(d, lag) for d in _DELAYS_S for lag in _LAGS_S]
    found, (per_thrust, drag, constant, _), left = _search(starts, velocity, columns)
    if per_thrust <= 0.0:
        raise ValueError("thrust does not raise the vehicle")
    # constant = k (hover thrust) - k (thrust before the first step), for the thrust counts from there
    hover = float(held[0]) + constant / per_thrust
    return ThrustFit(
        dead_time_s=found[0],
        lag_s=found[1],
        full_thrust_m_s2=per_thrust,
        drag_1_s=drag,
        hover_thrust=hover,
        unexplained=left,
    )


def answer(fit: Fit, time_s: Samples, command: Samples) -> Samples:
    """What a fit makes of a command, counted from rest before its first sample; arguments as ``fit_first_order``."""
    grid, held, _ = _resampled(time_s, command, time_s)
    second = fit.natural_frequency_rad_s is not None and fit.damping is not None
    by = _oscillator(fit.lag_s, fit.damping or 1.0) if second else _lag(fit.lag_s)
    answered: Samples = np.interp(time_s, grid, fit.gain * _followed(fit.dead_time_s, by, grid, held))
    return answered


def answer_of_thrust(fit: ThrustFit, time_s: Samples, thrust: Samples) -> Samples:
    """The downward velocity (m/s) that a fit makes of thrust, from rest; arguments as ``fit_thrust``."""
    grid, held, _ = _resampled(time_s, thrust, time_s)
    lagged = float(held[0]) + _followed(fit.dead_time_s, _lag(fit.lag_s), grid, held)
    pole = float(np.exp(-fit.drag_1_s * _GRID_S))
    velocity = lfilter([_GRID_S], [1.0, -pole], fit.full_thrust_m_s2 * (fit.hover_thrust - lagged))
    answered: Samples = np.interp(time_s, grid, velocity)
    return answered


def margins(parameters: ControlParameters, *, rate_lag_s: float, unpredicted_delay_s: float = 0.0) -> Margins:
    """Margins of the horizontal loop with these gains on a rate loop of a first-order lag.

    L = (1 + kv / s + kp / s^2) / (s tau (rate_lag s + 1)) exp(-s delay), with the smaller margin of both axes' gains.
    What the prediction compensates is no delay; the observers are left out, their bandwidth is below the crossover.
    """
    s = 1j * _FREQUENCIES_RAD_S
    tau = parameters.attitude_time_constant_s[0]
    kp, kv = max(parameters.position_gain_1_s2[:2]), max(parameters.velocity_gain_1_s[:2])
    loop = (1.0 + kv / s + kp / s**2) / (s * tau * (rate_lag_s * s + 1.0)) * np.exp(-s * unpredicted_delay_s)
    size, angle = np.abs(loop), np.unwrap(np.angle(loop))
    angle += -2.0 * np.pi * np.round((angle[0] + 1.5 * np.pi) / (2.0 * np.pi))  # three integrators at low frequency
    crossings = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
    if len(crossings) == 0:
        return Margins(phase_rad=float("inf"), gain=float("inf"), delay_s=float("inf"), crossover_rad_s=0.0)
    at = crossings[-1]
    phase, crossover = float(np.pi + angle[at]), float(_FREQUENCIES_RAD_S[at])
    turns = np.flatnonzero((angle[:-1] > -np.pi) & (angle[1:] <= -np.pi))
    gain = float(1.0 / size[turns[-1]]) if len(turns) else float("inf")
    return Margins(phase_rad=phase, gain=gain, delay_s=phase / crossover, crossover_rad_s=crossover)


def _resampled(time_s: Samples, command: Samples, response: Samples) -> tuple[Samples, Samples, Samples]:
    """Time, command (held) and response (interpolated) on an even grid."""
    if not len(time_s) == len(command) == len(response) or len(time_s) < 20:
        raise ValueError("at least 20 samples of equal number are needed")
    if not (np.isfinite(time_s).all() and np.isfinite(command).all() and np.isfinite(response).all()):
        raise ValueError("samples must be finite")
    if not (np.diff(time_s) > 0.0).all():
        raise ValueError("times must ascend")
    if np.ptp(command) == 0.0 or np.ptp(response) == 0.0:
        raise ValueError("command and response must change")
    grid = np.arange(time_s[0], time_s[-1], _GRID_S)
    held = command[np.searchsorted(time_s, grid, side="right") - 1]
    return grid, held, np.interp(grid, time_s, response)


Filter = tuple[list[float], list[float]]


def _lag(lag_s: float) -> Filter:
    """Numerator and denominator of a lag on the grid, exact for a held input."""
    pole = float(np.exp(-_GRID_S / lag_s))
    return [0.0, 1.0 - pole], [1.0, -pole]


def _oscillator(lag_s: float, damping: float) -> Filter:
    """Numerator and denominator of a second order on the grid; both poles are exact, the static gain is one."""
    frequency = 2.0 * damping / lag_s
    root = np.sqrt(complex(damping * damping - 1.0))
    one, two = (np.exp(frequency * _GRID_S * (-damping + sign * root)) for sign in (1.0, -1.0))
    total, product = float((one + two).real), float((one * two).real)
    static = 1.0 - total + product
    return [0.0, 0.5 * static, 0.5 * static], [1.0, -total, product]


def _followed(dead_time_s: float, by: Filter, grid: Samples, held: Samples) -> Samples:
    """The command after dead time and filter, counted from its first value."""
    followed: Samples = lfilter(*by, np.interp(grid - dead_time_s, grid, held) - held[0])
    return followed


def _with_rest(response: Samples) -> Samples:
    return np.column_stack((response, np.ones_like(response)))


def _search(
    starts: Sequence[tuple[float, ...]], measured: Samples, columns_of: Callable[[tuple[float, ...]], Samples]
) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Parameters (dead time, lag, damping), linear coefficients, and the part of the variance that stays."""
    variance = float(np.var(measured))
    limits = ((0.0, _DELAY_MAX_S), _LAG_S, _DAMPING)

    def bounded(p: Iterable[float]) -> tuple[float, ...]:
        return tuple(float(min(max(v, low), high)) for v, (low, high) in zip(p, limits, strict=False))

    def fitted(p: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
        columns = columns_of(p)
        coefficients, *_ = np.linalg.lstsq(columns, measured, rcond=None)
        return tuple(map(float, coefficients)), float(np.mean((measured - columns @ coefficients) ** 2)) / variance

    best = min(starts, key=lambda p: fitted(p)[1])
    accuracy = {"xatol": 1e-5, "fatol": 1e-9, "maxiter": 400}
    found = minimize(lambda p: fitted(bounded(p))[1], best, method="Nelder-Mead", options=accuracy)
    parameters = bounded(found.x)
    coefficients, left = fitted(parameters)
    return parameters, coefficients, left
