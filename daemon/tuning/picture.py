"""The step responses as a picture: what was commanded, measured and fitted, each pulse upon the others."""

from math import degrees
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from daemon.control.identification import Samples, answer, answer_of_thrust
from daemon.recording import style
from daemon.recording.style import FLOWN, INK, MUTED, WANTED
from daemon.tuning.measurement import Measured, RateLoop, Thrust, Window
from daemon.tuning.proposal import Proposal
from daemon.tuning.pulses import LEAD_S, Axis

_DEGREES = 180.0 / np.pi
_ACROSS = "time after the pulse's start, s"
_COMMANDED: dict[str, Any] = {"color": MUTED, "lw": 0.7, "alpha": 0.7}
_MEASURED: dict[str, Any] = {"color": FLOWN, "lw": 0.8, "alpha": 0.7}
_FITTED: dict[str, Any] = {"color": WANTED, "lw": 1.4}


def picture(measured: Measured, proposal: Proposal, airframe: str) -> bytes:
    """A PNG of four panels: roll, pitch, yaw rate, vertical velocity."""
    figure: Figure = style.figure(7.2)
    with style.styled():
        panels = figure.subplots(2, 2).ravel()
        for panel, axis, loop in zip(
            panels, (Axis.ROLL, Axis.PITCH, Axis.YAW), (measured.roll, measured.pitch, measured.yaw), strict=False
        ):
            _draw_rate(panel, axis, loop)
        _draw_thrust(panels[3], measured.thrust)
        panels[0].legend(loc="upper right")
        figure.suptitle(_headline(proposal, airframe), x=0.01, ha="left", fontsize=11, color=INK)
    return style.png(figure)


def _headline(proposal: Proposal, airframe: str) -> str:
    m = proposal.margins_unpredicted
    return (
        f"{airframe}: phase margin {degrees(m.phase_rad):.0f} deg, gain margin {m.gain:.1f}, "
        f"delay margin {1e3 * m.delay_s:.0f} ms at {m.crossover_rad_s:.1f} rad/s"
    )


def _draw_rate(panel: Any, axis: Axis, loop: RateLoop) -> None:
    for window, fit in zip(loop.windows, loop.fits, strict=True):
        fitted = answer(fit, window.time_s, window.command)
        time_s, unit = window.time_s - LEAD_S, _upright(window) * _DEGREES
        first = not panel.lines
        panel.step(time_s, unit * window.command, where="post", label="commanded" if first else None, **_COMMANDED)
        panel.plot(time_s, unit * _rested(window, fitted), label="measured" if first else None, **_MEASURED)
        panel.plot(time_s, unit * fitted, label="fitted" if first else None, **_FITTED)
    title = (
        f"{axis.value}: dead time {1e3 * loop.dead_time_s.value:.0f} ms, lag {1e3 * loop.lag_s.value:.0f} ms, "
        f"gain {loop.gain.value:.2f}"
    )
    panel.set(title=title, xlabel=_ACROSS, ylabel="rate, deg/s")


def _draw_thrust(panel: Any, thrust: Thrust) -> None:
    """Single pulses drift with the estimate: the fit is that of their mean."""
    fitted = answer_of_thrust(thrust.fit, thrust.mean.time_s, thrust.mean.command)
    for window in thrust.windows:
        up = -_upright(window) * (window.response - np.mean(window.response)) - np.mean(fitted)
        panel.plot(window.time_s - LEAD_S, up, **_MEASURED)
    time_s = thrust.mean.time_s - LEAD_S
    panel.plot(time_s, -_rested(thrust.mean, fitted), color=INK, lw=1.2, label="mean of the measured")
    panel.plot(time_s, -fitted, **_FITTED)
    title = (
        f"thrust: hovers at {thrust.hover_thrust.value:.3f}, "
        f"dead time and lag {1e3 * thrust.total_s.value:.0f} ± {1e3 * thrust.total_s.error:.0f} ms"
    )
    panel.set(title=title, xlabel=_ACROSS, ylabel="climb, m/s")
    panel.legend(loc="upper right")


def _upright(window: Window) -> float:
    """Pulses of the other sign are drawn upside down, so that all lie upon each other."""
    return 1.0 if window.pulse.size > 0.0 else -1.0


def _rested(window: Window, fitted: Samples) -> Samples:
    """The response with its rest at zero, as the fit has it."""
    return window.response - np.mean(window.response - fitted)
