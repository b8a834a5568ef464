from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control.parameters import ControlParameters
from daemon.messages import Setpoint
from daemon.tuning.pulses import Axis, Pulse, programme, with_pulse

PARAMETERS = ControlParameters()


@pytest.mark.parametrize("size", [0.6, -0.6])
def test_a_pulse_leaves_neither_rate_nor_angle(size: float) -> None:
    pulse = Pulse(Axis.ROLL, 1.0, size, 0.2, 1.0)
    time = np.arange(0.5, 3.0, 1e-4)
    added = np.array([pulse.at(t) for t in time])
    angle = np.cumsum(added) * 1e-4
    assert abs(angle[-1]) < 1e-3
    assert abs(np.sum(angle) * 1e-4) < 1e-3
    assert set(np.unique(added)) == {-abs(size), 0.0, abs(size)}
    assert pulse.at(1.05) == size


def test_pulses_follow_one_another_with_both_signs_on_each_axis() -> None:
    pulses = programme(PARAMETERS)
    assert all(before.end_s <= after.start_s for before, after in pairwise(pulses))
    for axis in Axis:
        assert sum(pulse.size for pulse in pulses if pulse.axis is axis) == pytest.approx(0.0, abs=1e-9)
        assert sum(pulse.axis is axis for pulse in pulses) == 6


def test_a_pulse_touches_its_own_axis_only() -> None:
    setpoint, pulse = Setpoint((0.1, 0.2, 0.3), 0.5), Pulse(Axis.PITCH, 0.0, 0.4, 0.2, 1.0)
    assert with_pulse(setpoint, pulse, 0.1).rates_frd_rad_s == pytest.approx((0.1, 0.6, 0.3))
    assert with_pulse(setpoint, pulse, 0.1).thrust == 0.5
    up = with_pulse(setpoint, replace(pulse, axis=Axis.THRUST, size=0.05), 0.1)
    assert (up.rates_frd_rad_s, up.thrust) == (setpoint.rates_frd_rad_s, pytest.approx(0.55))


@settings(deadline=None)
@given(st.floats(0.2, 7.0), st.floats(0.1, 6.0), st.floats(0.2, 0.9))
def test_pulses_stay_below_half_of_what_is_allowed(rate: float, yaw_rate: float, hover: float) -> None:
    p = replace(PARAMETERS, rate_max_rad_s=rate, yaw_rate_max_rad_s=yaw_rate, hover_thrust=hover)
    for pulse in programme(p):
        if pulse.axis is Axis.THRUST:
            assert p.thrust_min <= hover - abs(pulse.size) and hover + abs(pulse.size) <= p.thrust_max
            assert abs(pulse.size) <= 0.15 * hover + 1e-9
        else:
            assert abs(pulse.size) <= 0.5 * (yaw_rate if pulse.axis is Axis.YAW else rate) + 1e-9
