"""Whether the loops settle with a configuration's gains on a vehicle of its lags."""

from __future__ import annotations

from math import atan, degrees, pi, radians, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daemon.settings import Control

_DEAD_TIME_S = 0.03  # of PX4 and its rotors, from the command to the first of it
_PHASE_MARGIN_RAD = radians(35.0)  # of the attitude loop; at 26 degrees a vehicle with noise-free sensors swings on
_GAIN_MARGIN = 1.15  # of the position loop, a vehicle that answers more strongly


def require_stable(control: Control) -> None:
    """Raise ``ValueError`` when a loop would swing, from the inside out: attitude, place, height.

    Attitude: the phase margin of 1 / (t s) with the rate loop's lag and dead time. Horizontally, attitude and rate loop
    lie between command and acceleration; Routh and Hurwitz: v (1 - k v T) > p t with the gains p and v, the attitude's
    time constant t, the rate loop's lag with its dead time T and the gain margin k. Vertically the lag of thrust:
    v > p T.
    """
    for axis, constant_s, axis_lag_s in zip(
        ("roll", "pitch", "yaw"), control.attitude_time_constant_s, control.rate_lag_s, strict=True
    ):
        margin_rad = attitude_phase_margin_rad(constant_s, axis_lag_s, _DEAD_TIME_S)
        if margin_rad < _PHASE_MARGIN_RAD:
            raise ValueError(
                f"attitude_time_constant_s {constant_s:g} in {axis} swings with a rate loop of "
                f"{axis_lag_s + _DEAD_TIME_S:g} s: its phase margin of {degrees(margin_rad):.0f} deg is below "
                f"{degrees(_PHASE_MARGIN_RAD):.0f}"
            )
    lag_s = max(control.rate_lag_s[:2]) + _DEAD_TIME_S
    attitude_s = max(control.attitude_time_constant_s[:2])
    for p, v in tuple(zip(control.position_gain_1_s2, control.velocity_gain_1_s, strict=True))[:2]:
        if not v * (1.0 - _GAIN_MARGIN * v * lag_s) > p * attitude_s:
            raise ValueError(
                f"position_gain_1_s2 {p:g} and velocity_gain_1_s {v:g} swing with attitude_time_constant_s "
                f"{attitude_s:g} and a rate loop of {lag_s:g} s"
            )
    p, v, lag_s = control.position_gain_1_s2[2], control.velocity_gain_1_s[2], control.thrust_lag_s + _DEAD_TIME_S
    if not v > p * lag_s:
        raise ValueError(
            f"position_gain_1_s2 {p:g} and velocity_gain_1_s {v:g} down swing with thrust {lag_s:g} s late"
        )


def attitude_phase_margin_rad(time_constant_s: float, lag_s: float, dead_time_s: float) -> float:
    """Phase margin of the open loop exp(-D s) / (t s (1 + L s)), where its gain crosses one."""
    crossover_rad_s = 1.0 / time_constant_s
    if lag_s > 0.0:
        ratio = 2.0 * lag_s / time_constant_s
        crossover_rad_s = sqrt((sqrt(1.0 + ratio * ratio) - 1.0) / 2.0) / lag_s
    return pi / 2.0 - atan(crossover_rad_s * lag_s) - crossover_rad_s * dead_time_s
