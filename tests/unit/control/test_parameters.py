from dataclasses import replace
from math import inf, nan

import pytest

from daemon.control.parameters import ControlParameters, from_airframe


@pytest.mark.parametrize(
    "bad",
    [
        {"hover_thrust": 0.0},
        {"hover_thrust": nan},
        {"position_gain_1_s2": (1.0, -1.0, 1.0)},
        {"position_gain_1_s2": (1.0, inf, 1.0)},
        {"attitude_time_constant_s": (0.1, 0.0, 0.1)},
        {"tilt_max_rad": 1.6},
        {"thrust_min": 0.9, "thrust_max": 0.5},
        {"vertical_thrust_min_m_s2": 0.0},
    ],
)
def test_number_without_sense_is_refused_by_name(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="control parameter"):
        replace(ControlParameters(), **bad)


def test_airframe_of_the_default_lag_has_the_default_gains() -> None:
    default, derived = ControlParameters(), from_airframe(0.5, 0.055)
    assert derived.position_gain_1_s2 == pytest.approx(default.position_gain_1_s2)
    assert derived.velocity_gain_1_s == pytest.approx(default.velocity_gain_1_s)
    assert derived.attitude_time_constant_s == pytest.approx(default.attitude_time_constant_s, rel=0.03)


def test_slower_airframe_keeps_the_damping() -> None:
    quick, slow = from_airframe(0.5, 0.04), from_airframe(0.5, 0.08)
    for p in (quick, slow):
        assert p.velocity_gain_1_s[0] / p.position_gain_1_s2[0] ** 0.5 == pytest.approx(3.2 / 5.0**0.5)
    assert slow.position_gain_1_s2[0] == pytest.approx(quick.position_gain_1_s2[0] / 4.0)
