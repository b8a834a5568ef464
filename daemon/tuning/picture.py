"""The step responses as a picture: what was commanded, measured and fitted, each pulse upon the others."""

from math import degrees
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from daemon.control.identification import answer, answer_of_thrust
from daemon.recording import style
from daemon.recording.style import FLOWN, INK, MUTED, WANTED
from daemon.tuning.measurement import Measured, RateLoop, Thrust, Window
from daemon.tuning.proposal import Proposal
from daemon.tuning.pulses import LEAD_S, Axis

_DEGREES = 180.0 / np.pi


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
        _draw(panel, window, window.command, fitted, _DEGREES)
    title = (
        f"{axis.value}: dead time {1e3 * loop.dead_time_s.value:.0f} ms, lag {1e3 * loop.lag_s.value:.0f} ms, "
        f"gain {loop.gain.value:.2f}"
    )
    panel.set(title=title, xlabel="time after the pulse's start, s", ylabel="rate, deg/s")


def _draw_thrust(panel: Any, thrust: Thrust) -> None:
    for window, fit in zip(thrust.windows, thrust.fits, strict=True):
        _draw(panel, window, None, answer_of_thrust(fit, window.time_s, window.command), -1.0)
    title = (
        f"thrust: hovers at {thrust.hover_thrust.value:.3f}, lag {1e3 * thrust.lag_s.value:.0f} ms, "
        f"{thrust.full_thrust_m_s2.value:.1f} m/s² at full thrust"
    )
    panel.set(title=title, xlabel="time after the pulse's start, s", ylabel="climb, m/s")


def _draw(panel: Any, window: Window, command: Any, fitted: Any, unit: float) -> None:
    """Pulses of the other sign are drawn upside down, so that all lie upon each other; rest is at zero."""
    unit = unit if window.pulse.size > 0.0 else -unit
    time_s = window.time_s - LEAD_S
    offset = float(np.mean(window.response - fitted))
    named = not panel.lines
    if command is not None:
        label = "commanded" if named else None
        panel.step(time_s, unit * command, where="post", color=MUTED, lw=0.7, alpha=0.7, label=label)
    panel.plot(
        time_s, unit * (window.response - offset), color=FLOWN, lw=0.8, alpha=0.7, label="measured" if named else None
    )
    panel.plot(time_s, unit * fitted, color=WANTED, lw=1.4, label="fitted" if named else None)
