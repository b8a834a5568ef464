"""From a recording to the numbers of the airframe, each with its uncertainty; poor data is refused in words."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from daemon.control.identification import Fit, Samples, ThrustFit, fit_first_order, fit_thrust
from daemon.messages import GRAVITY_M_S2
from daemon.tuning.experiment import Recording
from daemon.tuning.pulses import LEAD_S, RATE_AXES, Axis, Pulse

T = TypeVar("T")

_GRID_S = 0.002
_EDGE = 25  # samples of the grid that a speed at the edge of a window is the mean of
_UNEXPLAINED_MAX = {Axis.ROLL: 0.3, Axis.PITCH: 0.3, Axis.YAW: 0.3, Axis.THRUST: 0.4}
_ERROR_MAX = 0.15  # of dead time and lag, relative
_HOVER_ERROR_MAX = 0.03  # relative
_GAINS = (0.5, 1.5)  # of a rate loop that follows
_SLOPES = (0.5, 2.5)  # 1 linear, 2 quadratic
_SAMPLES_MIN_HZ = 40.0
_GAP_MAX_S = 0.15
_NORMAL = 1.4826  # standard deviation over the median absolute deviation


class PoorDataError(Exception):
    """The recording does not carry the numbers; one sentence a fault."""

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(faults))


@dataclass(frozen=True, slots=True)
class Window:
    """One pulse with what was sent and measured about it, on an even grid that begins at 0."""

    pulse: Pulse
    time_s: Samples
    command: Samples
    response: Samples


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number and its standard error."""

    value: float
    error: float


@dataclass(frozen=True, slots=True)
class RateLoop:
    """First-order answer of a body rate. ``total_s``: dead time and lag, sharper than either.

    Dead time counts until the rate is true, not until ODOMETRY has told it. ``unexplained``: part of the variance.
    """

    total_s: Quantity
    dead_time_s: Quantity
    lag_s: Quantity
    gain: Quantity
    unexplained: float
    fits: tuple[Fit, ...]
    windows: tuple[Window, ...]


@dataclass(frozen=True, slots=True)
class Thrust:
    """Answer of the vertical velocity to thrust."""

    total_s: Quantity
    lag_s: Quantity
    hover_thrust: Quantity
    full_thrust_m_s2: Quantity
    drag_1_s: Quantity
    unexplained: float
    fit: ThrustFit
    mean: Window
    windows: tuple[Window, ...]

    @property
    def slope(self) -> float:
        """Slope of acceleration over thrust at hover, times hover thrust, over gravity: 1 linear, 2 quadratic."""
        return self.full_thrust_m_s2.value * self.hover_thrust.value / GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Measured:
    """The airframe. ``age_s``: of ODOMETRY on arrival."""

    roll: RateLoop
    pitch: RateLoop
    yaw: RateLoop
    thrust: Thrust
    age_s: float


def measure(recording: Recording) -> Measured:
    """The numbers of a recording. Raises ``PoorDataError`` with all that speaks against them."""
    _require_telemetry(recording)
    faults: list[str] = []
    loops = {axis: _tried(axis, lambda a: _rate_loop(_windows(recording, a)), faults) for axis in RATE_AXES}
    thrust = _tried(Axis.THRUST, lambda a: _thrust(_windows(recording, a)), faults)
    roll, pitch, yaw = (loops[axis] for axis in RATE_AXES)
    for axis, loop in loops.items():
        faults += [f"{axis.value}: {fault}" for fault in _rate_faults(axis, loop)] if loop else []
    faults += [f"thrust: {fault}" for fault in _thrust_faults(thrust)] if thrust else []
    if faults or roll is None or pitch is None or yaw is None or thrust is None:
        raise PoorDataError(faults)
    age_s = float(np.median([sample.age_s for sample in recording.samples]))
    return Measured(roll, pitch, yaw, thrust, age_s)


def _require_telemetry(recording: Recording) -> None:
    """ODOMETRY often enough, and setpoints without a hole in most of the pulses."""
    duration_s = max((pulse.end_s for pulse in recording.programme), default=0.0)
    rate_hz = len(recording.samples) / duration_s if duration_s > 0.0 else 0.0
    if rate_hz < _SAMPLES_MIN_HZ:
        raise PoorDataError([f"ODOMETRY came at {rate_hz:.0f} Hz; {_SAMPLES_MIN_HZ:g} Hz are needed"])
    times = [sent.time_s - recording.begun_s for sent in recording.sent]
    holes = [a for a, b in pairwise(times) if b - a > _GAP_MAX_S]
    hit = {pulse for pulse in recording.programme if any(pulse.start_s - LEAD_S < a < pulse.end_s for a in holes)}
    if 2 * len(hit) > len(recording.programme) or len(times) < 2:
        raise PoorDataError(["setpoints did not leave steadily: the machine is overloaded"])


def _tried(axis: Axis, fit: Callable[[Axis], T], faults: list[str]) -> T | None:
    """A fit, or the fault that there is none."""
    try:
        return fit(axis)
    except ValueError as error:
        faults.append(f"{axis.value}: {error}")
        return None


def _rate_faults(axis: Axis, loop: RateLoop) -> list[str]:
    found = _fit_faults(axis, loop.total_s, loop.unexplained)
    if not _GAINS[0] <= loop.gain.value <= _GAINS[1]:
        found.append(f"the rate comes to {loop.gain.value:.0%} of what was commanded: is the rate loop tuned?")
    return found


def _thrust_faults(thrust: Thrust) -> list[str]:
    found = _fit_faults(Axis.THRUST, None, thrust.unexplained)
    error = thrust.hover_thrust.error / thrust.hover_thrust.value if thrust.hover_thrust.value > 0.0 else 1.0
    if not (0.05 <= thrust.hover_thrust.value <= 0.95 and error <= _HOVER_ERROR_MAX):
        found.append(f"hover thrust came out as {thrust.hover_thrust.value:.2f} with an error of {error:.0%}")
    elif not _SLOPES[0] <= thrust.slope <= _SLOPES[1]:
        found.append(f"a change of thrust acts {thrust.slope:.1f} times as a linear rotor's would")
    return found


def _fit_faults(axis: Axis, total_s: Quantity | None, unexplained: float) -> list[str]:
    found = []
    if not unexplained <= _UNEXPLAINED_MAX[axis]:
        found.append(f"{unexplained:.0%} of the response is not explained by the pulses; is it windy?")
    if total_s is not None and not total_s.error <= _ERROR_MAX * total_s.value:
        found.append(f"dead time and lag differ from pulse to pulse by {total_s.error / max(total_s.value, 1e-3):.0%}")
    return found


def _windows(recording: Recording, axis: Axis) -> list[Window]:
    sent_s = np.array([sent.time_s for sent in recording.sent]) - recording.begun_s
    true_s = np.array([sample.state.time_s for sample in recording.samples]) - recording.begun_s
    if axis is Axis.THRUST:
        upright = np.interp(sent_s, true_s, [sample.upright for sample in recording.samples])
        command = np.array([sent.setpoint.thrust for sent in recording.sent]) * upright
        response = np.array([sample.state.velocity_ned_m_s[2] for sample in recording.samples])
    else:
        index = RATE_AXES.index(axis)
        command = np.array([sent.setpoint.rates_frd_rad_s[index] for sent in recording.sent])
        response = np.array([sample.state.rates_frd_rad_s[index] for sample in recording.samples])
    found = []
    for pulse in recording.programme:
        if pulse.axis is axis:
            time_s = np.arange(pulse.start_s - LEAD_S, pulse.end_s - LEAD_S, _GRID_S)
            held = command[np.clip(np.searchsorted(sent_s, time_s, side="right") - 1, 0, None)]
            found.append(Window(pulse, time_s - time_s[0], held, np.interp(time_s, true_s, response)))
    return found


def _rate_loop(windows: list[Window]) -> RateLoop:
    fits = [fit_first_order(w.time_s, w.command, w.response) for w in windows]
    return RateLoop(
        total_s=_typical(fits, lambda fit: fit.dead_time_s + fit.lag_s),
        dead_time_s=_typical(fits, lambda fit: fit.dead_time_s),
        lag_s=_typical(fits, lambda fit: fit.lag_s),
        gain=_typical(fits, lambda fit: fit.gain),
        unexplained=float(np.median([fit.unexplained for fit in fits])),
        fits=tuple(fits),
        windows=tuple(windows),
    )


def _thrust(windows: list[Window]) -> Thrust:
    """Dynamics from the mean of the pulses, those of the other sign upside down: what drifts cancels out."""
    fit = _fit_of_mean(windows)
    others = [_fit_of_mean([w for w in windows if w is not left_out]) for left_out in windows]
    return Thrust(
        total_s=_jackknifed(fit, others, lambda f: f.dead_time_s + f.lag_s),
        lag_s=_jackknifed(fit, others, lambda f: f.lag_s),
        hover_thrust=_typical(windows, lambda window: hover_thrust(window, fit)),
        full_thrust_m_s2=_jackknifed(fit, others, lambda f: f.full_thrust_m_s2),
        drag_1_s=_jackknifed(fit, others, lambda f: f.drag_1_s),
        unexplained=fit.unexplained,
        fit=fit,
        mean=_mean(windows),
        windows=tuple(windows),
    )


def _mean(windows: Sequence[Window]) -> Window:
    up = [1.0 if window.pulse.size > 0.0 else -1.0 for window in windows]
    size = min(len(window.time_s) for window in windows)
    command, response = (
        np.mean([sign * values[:size] for sign, values in zip(up, rows, strict=True)], axis=0)
        for rows in ([w.command for w in windows], [w.response for w in windows])
    )
    return Window(windows[0].pulse, windows[0].time_s[:size], command, response)


def _fit_of_mean(windows: Sequence[Window]) -> ThrustFit:
    mean = _mean(windows)
    return fit_thrust(mean.time_s, mean.command, mean.response)


def hover_thrust(window: Window, fit: ThrustFit) -> float:
    """The thrust about which the vertical speed does not change: dv/dt = -k (u - hover) - d v, over the window."""
    duration_s = float(window.time_s[-1] - window.time_s[0])
    gained = float(np.mean(window.response[-_EDGE:]) - np.mean(window.response[:_EDGE]))
    sunk = float(np.mean(window.response)) * duration_s
    return float(np.mean(window.command)) + (gained + fit.drag_1_s * sunk) / (fit.full_thrust_m_s2 * duration_s)


def _jackknifed(fit: ThrustFit, others: Sequence[ThrustFit], of: Callable[[ThrustFit], float]) -> Quantity:
    """The number with the standard error that leaving out each pulse in turn shows."""
    values = np.array([of(other) for other in others])
    spread = float(np.sum((values - values.mean()) ** 2))
    return Quantity(of(fit), ((len(values) - 1) / len(values) * spread) ** 0.5)


def _typical(fits: Sequence[T], of: Callable[[T], float]) -> Quantity:
    """Median over the pulses: a stall of the machine in one of them does not move it."""
    values = np.array([of(fit) for fit in fits])
    middle = float(np.median(values))
    return Quantity(middle, _NORMAL * float(np.median(np.abs(values - middle))) / len(values) ** 0.5)
