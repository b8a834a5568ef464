from math import hypot, inf

import pytest

from daemon.control import position_law
from daemon.messages import ZERO3, Vec3

KP, KV = (8.0, 8.0, 9.0), (4.0, 4.0, 5.0)


def feedback(position: Vec3, velocity: Vec3, approach: float = inf, most: float = inf) -> Vec3:
    return position_law.feedback(position, velocity, KP, KV, approach_max_m_s=approach, feedback_max_m_s2=most)


def test_errors_are_turned_back_by_their_gains() -> None:
    assert feedback((0.1, -0.2, 0.3), (1.0, 0.5, -0.2)) == pytest.approx((-4.8, -0.4, -1.7))


def test_sum_saturates_sideways_by_norm_and_keeps_its_direction() -> None:
    x, y, z = feedback((3.0, -4.0, 0.0), ZERO3, most=5.0)
    assert (x, y, z) == pytest.approx((-3.0, 4.0, 0.0))


@pytest.mark.parametrize("far", [(100.0, 0.0, 0.0), (-60.0, 80.0, 0.0), (0.0, 0.0, -40.0)])
def test_far_reference_is_approached_with_no_more_acceleration_than_the_speed_takes(far: Vec3) -> None:
    length = sum(v * v for v in far) ** 0.5
    toward = (
        -3.0 * far[0] / length,
        -3.0 * far[1] / length,
        -3.0 * far[2] / length,
    )
    assert feedback(far, toward, approach=3.0) == pytest.approx(ZERO3, abs=1e-9)


def test_near_reference_is_not_touched_by_the_saturation() -> None:
    assert feedback((0.5, 0.5, 0.5), ZERO3, approach=3.0) == pytest.approx((-4.0, -4.0, -4.5))


@pytest.mark.parametrize("least", [(3.0, 4.0, 5.0), (4.0, 3.0, 1.0)])
def test_each_axis_has_its_own_gains_and_the_approach_is_held_by_the_lesser_horizontal_one(least: Vec3) -> None:
    """Worked by hand: 6 north and 8 east of error saturate at 2 m/s times 3 1/s, along (0.6 * 5, 0.8 * 10)."""
    kp = (5.0, 10.0, 7.0)

    def asked(position: Vec3, velocity: Vec3, approach: float) -> Vec3:
        return position_law.feedback(position, velocity, kp, least, approach_max_m_s=approach, feedback_max_m_s2=inf)

    near = tuple(-k * e - g * v for k, e, g, v in zip(kp, (0.1, 0.2, 0.3), least, (0.3, -0.2, 0.1), strict=True))
    assert asked((0.1, 0.2, 0.3), (0.3, -0.2, 0.1), 5.0) == pytest.approx(near)
    length = hypot(30.0, 80.0)
    far = asked((6.0, 8.0, 0.0), ZERO3, 2.0)
    assert far == pytest.approx((-6.0 * 30.0 / length, -6.0 * 80.0 / length, 0.0))
    assert asked((0.0, 0.0, 50.0), ZERO3, 2.0)[2] == pytest.approx(-2.0 * least[2])


@pytest.mark.parametrize("sideways_m_s", [0.0, 2.0, 12.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_error_sideways_takes_no_feedback_from_height(sideways_m_s: float, sign: float) -> None:
    """1 m low and sinking with 1 m/s at gains of 9 and 5: 14 m/s2 of which 9 are given, whatever is sideways."""
    x, y, z = feedback((0.0, 0.0, sign), (0.6 * sideways_m_s, 0.8 * sideways_m_s, sign), most=9.0)
    assert z == -9.0 * sign
    assert (x, y) == pytest.approx((-0.6 * min(4.0 * sideways_m_s, 9.0), -0.8 * min(4.0 * sideways_m_s, 9.0)))
