from math import cos, pi, sin

import pytest

from daemon.control.velocity_yaw import heading


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [((2.0, 0.0, 0.0), 0.0), ((-2.0, 0.0, 0.0), pi), ((0.0, 2.0, 0.0), pi / 2), ((0.0, -2.0, 1.0), -pi / 2)],
)
def test_heading_of_the_four_directions(velocity: tuple[float, float, float], expected: float) -> None:
    assert heading(velocity, (0.0, 0.0, 0.0), 1.0, minimum_m_s=0.5) == (pytest.approx(expected), 0.0)


def test_below_the_minimum_speed_the_heading_stays() -> None:
    assert heading((0.3, 0.3, 5.0), (9.0, 9.0, 9.0), 1.0, minimum_m_s=0.5) == (1.0, 0.0)
    assert heading((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, minimum_m_s=0.0) == (1.0, 0.0)


def test_rate_on_a_circle_is_the_angular_velocity() -> None:
    w, t = 0.7, 0.4
    velocity, acceleration = (3 * cos(w * t), 3 * sin(w * t), 0.0), (-3 * w * sin(w * t), 3 * w * cos(w * t), 0.0)
    yaw, rate = heading(velocity, acceleration, 0.0, minimum_m_s=0.5)
    assert (yaw, rate) == (pytest.approx(w * t), pytest.approx(w))


def test_a_metre_a_second_is_a_speed_and_the_minimum_itself_is_none() -> None:
    assert heading((0.0, 1.0, 0.0), (2.0, 0.0, 0.0), 0.3, minimum_m_s=0.5) == (pytest.approx(pi / 2), -2.0)
    assert heading((0.0, 0.5, 0.0), (2.0, 0.0, 0.0), 0.3, minimum_m_s=0.5) == (0.3, 0.0)
