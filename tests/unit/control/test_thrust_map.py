import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control import thrust_map


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=80)
def test_command_solves_the_curve(force: float, curve: float) -> None:
    command = thrust_map.command_of(force, curve)
    roots = np.roots([curve, 1.0 - curve, -force]) if curve > 1e-9 else np.array([force])
    positive = max(r.real for r in roots) if len(roots) else 0.0
    assert command == pytest.approx(positive, abs=1e-6)
    assert thrust_map.force_of(command, curve) == pytest.approx(force, abs=1e-9)


def test_gravity_takes_the_hover_thrust_and_twice_of_it_twice_the_force() -> None:
    assert thrust_map.command_from_acceleration(9.8, 0.4, 0.0, 9.8) == pytest.approx(0.4)
    assert thrust_map.command_from_acceleration(19.6, 0.4, 0.0, 9.8) == pytest.approx(0.8)
    # quadratic rotors: force 0.16 at hover, 0.32 is sqrt(0.32)
    assert thrust_map.command_from_acceleration(19.6, 0.4, 1.0, 9.8) == pytest.approx(0.32**0.5)


@given(st.floats(0.0, 30.0), st.floats(0.1, 0.9), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=50)
def test_acceleration_and_command_are_inverse(acceleration: float, hover: float, curve: float) -> None:
    command = thrust_map.command_from_acceleration(acceleration, hover, curve, 9.8)
    assert thrust_map.acceleration_from_command(command, hover, curve, 9.8) == pytest.approx(acceleration, abs=1e-6)


def test_downward_acceleration_asks_for_no_thrust() -> None:
    assert thrust_map.command_from_acceleration(-3.0, 0.5, 0.3, 9.8) == 0.0


def test_a_line_by_hand_is_a_gain_and_an_offset() -> None:
    assert thrust_map.linear_command(12.0, 0.05, 0.1) == pytest.approx(0.7)
    assert thrust_map.linear_command(-4.0, 0.05, 0.1) == pytest.approx(-0.1)
