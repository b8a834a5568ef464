"""Gains that swing are refused; the verdicts were found by flying them on the simulated vehicle in a wind step."""

from math import radians

import numpy as np
import pytest
from scipy import signal

from daemon.config import ConfigError, load
from daemon.stability import attitude_phase_margin_rad

AXES = ("roll", "pitch", "yaw")


def control(**values: object) -> None:
    load([], {"control": values})


@pytest.mark.parametrize(
    ("position", "velocity", "attitude_s"),
    [(5.0, 3.2, 0.4), (12.0, 3.2, 0.15), (5.0, 1.0, 0.15), (5.0, 9.0, 0.15), (0.0, 3.2, 0.15)],
)
def test_gains_that_settle_are_taken(position: float, velocity: float, attitude_s: float) -> None:
    control(
        position_gain_1_s2=[position, position, 7.0],
        velocity_gain_1_s=[velocity, velocity, 4.4],
        attitude_time_constant_s=[attitude_s, attitude_s, 0.7],
    )


@pytest.mark.parametrize(
    ("position", "velocity", "attitude_s"),
    [
        (5.0, 3.2, 0.6),
        (5.0, 3.2, 5.0),
        (22.0, 3.2, 0.15),
        (5.0, 0.6, 0.15),
        (5.0, 10.0, 0.15),
        (5.0, 12.0, 0.15),
        (0.0, 30.0, 0.15),
    ],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_gains_that_swing_are_refused(position: float, velocity: float, attitude_s: float, axis: int) -> None:
    p, v, t = [5.0, 5.0, 7.0], [3.2, 3.2, 4.4], [0.15, 0.15, 0.7]
    p[axis], v[axis], t[axis] = position, velocity, attitude_s
    with pytest.raises(ConfigError, match=f"position_gain_1_s2 {position:g} .* swing|swing with .* {attitude_s:g} "):
        control(position_gain_1_s2=p, velocity_gain_1_s=v, attitude_time_constant_s=t)


def test_gains_are_judged_by_the_lags_of_the_vehicle() -> None:
    control(rate_lag_s=[0.055, 0.17, 0.3])
    with pytest.raises(ConfigError, match=r"rate loop of 0\.23 s"):
        control(rate_lag_s=[0.055, 0.2, 0.3])
    with pytest.raises(ConfigError, match="swing with thrust"):
        control(thrust_lag_s=0.5, position_gain_1_s2=[5.0, 5.0, 9.0])


@pytest.mark.parametrize(
    ("key", "value"),
    [("rate_slew_max_deg_s2", 100.0), ("rate_max_deg_s", 10.0), ("velocity_gain_1_s", [3.0, 3.0, 0.0])],
)
def test_ends_of_ranges_that_no_vehicle_flies_are_refused(key: str, value: object) -> None:
    with pytest.raises(ConfigError, match=key):
        control(**{key: value})


@pytest.mark.parametrize(("axis", "swings_s", "settles_s"), [(0, 0.05, 0.07), (1, 0.05, 0.07), (2, 0.12, 0.2)])
def test_an_attitude_loop_that_is_too_quick_for_the_rate_loop_is_refused_on_each_axis(
    axis: int, swings_s: float, settles_s: float
) -> None:
    """Flown: rates swing by 1.6 rad/s at rest with 0.05 s in roll and pitch, by 0.5 rad/s with 0.12 s in yaw."""
    constants = [0.15, 0.15, 0.7]
    constants[axis] = settles_s
    control(attitude_time_constant_s=constants)
    constants[axis] = swings_s
    with pytest.raises(ConfigError, match=f"attitude_time_constant_s {swings_s:g} in {AXES[axis]} swings"):
        control(attitude_time_constant_s=constants)


@pytest.mark.parametrize(
    ("constant_s", "lag_s", "dead_s"), [(0.15, 0.055, 0.03), (0.05, 0.055, 0.03), (0.2, 0.31, 0.03), (0.05, 0.0, 0.02)]
)
def test_phase_margin_of_the_attitude_loop_is_that_of_its_frequency_response(
    constant_s: float, lag_s: float, dead_s: float
) -> None:
    """Oracle: scipy's Bode plot of the loop without the dead time, which adds its phase at the crossover."""
    frequencies = np.geomspace(0.1, 200.0, 40001)
    rad_s, decibel, phase_deg = signal.bode(([1.0], [constant_s * lag_s, constant_s, 0.0]), frequencies)
    at = int(np.argmin(np.abs(decibel)))
    expected = radians(180.0 + phase_deg[at]) - rad_s[at] * dead_s
    assert attitude_phase_margin_rad(constant_s, lag_s, dead_s) == pytest.approx(expected, abs=1e-3)
