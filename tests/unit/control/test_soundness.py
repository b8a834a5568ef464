"""What the law refuses to calculate with: each number of each input on its own."""

from dataclasses import replace
from math import inf, nan, sqrt

import pytest

from daemon.control.soundness import BOUND, refusals, sound_dt_s, sound_reset, sound_state
from daemon.messages import EstimatedState, Reference, Reset

STATE = EstimatedState(1.0, (1.0, -2.0, 3.0), (-1.0, 2.0, -3.0), (0.5, -0.5, 0.5, 0.5), (0.1, -0.2, 0.3))
REFERENCE = Reference(1.0, (1.0, -2.0, 3.0), (0.1, 0.2, 0.3), (1.0, 1.0, -1.0), (0.0, 2.0, 0.0), -3.0, 0.5)
RESET = Reset(1.0, frozenset(), (1.0, 2.0, 3.0), (-0.1, 0.2, 0.3), -0.4)
FIELDS = ("position_ned_m", "velocity_ned_m_s", "rates_frd_rad_s")
REFERENCE_FIELDS = ("position_ned_m", "velocity_ned_m_s", "acceleration_ned_m_s2", "jerk_ned_m_s3")
BAD = (nan, inf, -inf, 1.01e6, -1.01e6)


def spoiled(vector: tuple[float, ...], place: int, bad: float) -> tuple[float, ...]:
    return tuple(bad if i == place else v for i, v in enumerate(vector))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("place", range(3))
def test_every_number_of_every_vector_is_looked_at(place: int, bad: float) -> None:
    assert sound_state(STATE) and sound_reset(RESET) and refusals(STATE, STATE, REFERENCE) == ()
    for name in FIELDS:
        assert not sound_state(replace(STATE, **{name: spoiled(getattr(STATE, name), place, bad)})), name
    for name in REFERENCE_FIELDS:
        reference = replace(REFERENCE, **{name: spoiled(getattr(REFERENCE, name), place, bad)})
        assert refusals(STATE, STATE, reference) == ("reference",), name
    for name in FIELDS[:2]:
        assert not sound_reset(replace(RESET, **{name: spoiled(getattr(RESET, name), place, bad)})), name


@pytest.mark.parametrize("bad", BAD)
def test_angles_are_looked_at_too(bad: float) -> None:
    assert refusals(STATE, STATE, replace(REFERENCE, yaw_rad=bad)) == ("reference",)
    assert refusals(STATE, STATE, replace(REFERENCE, yaw_rate_rad_s=bad)) == ("reference",)
    assert not sound_reset(replace(RESET, yaw_rad=bad))


def test_large_numbers_of_both_signs_do_not_make_up_for_each_other() -> None:
    for vector in ((9e5, -9e5, 0.0), (0.0, 9e5, -9e5), (-9e5, 0.0, 9e5)):
        for name in FIELDS:
            assert not sound_state(replace(STATE, **{name: vector}))
        assert refusals(STATE, STATE, replace(REFERENCE, jerk_ned_m_s3=vector)) == ("reference",)
    assert not sound_state(replace(STATE, position_ned_m=(9e5, 0.0, 0.0), velocity_ned_m_s=(-9e5, 0.0, 0.0)))
    assert not sound_reset(replace(RESET, position_ned_m=(9e5, 0.0, 0.0), yaw_rad=-9e5))


def test_far_but_finite_is_sound() -> None:
    assert BOUND == 1e6, "metres: no multirotor gets there"
    far = (3.0e5, -3.0e5, 2.0e5)
    assert sound_state(replace(STATE, position_ned_m=far))
    assert refusals(STATE, STATE, replace(REFERENCE, position_ned_m=far)) == ()
    assert sound_reset(replace(RESET, position_ned_m=far))
    for at_bound in ((BOUND, 0.0, 0.0), (0.0, -BOUND, 0.0)):
        assert not sound_reset(Reset(1.0, frozenset(), at_bound))


@pytest.mark.parametrize(("squared", "sound"), [(0.49, False), (0.51, True), (1.0, True), (1.49, True), (1.51, False)])
def test_an_attitude_is_a_rotation_when_its_norm_is_near_one(squared: float, sound: bool) -> None:
    part = sqrt(squared)
    for place in range(4):
        attitude = tuple(part if i == place else 0.0 for i in range(4))
        assert sound_state(replace(STATE, attitude_wb=attitude)) is sound  # type: ignore[arg-type]
    half = 0.5 * part
    assert sound_state(replace(STATE, attitude_wb=(half, -half, half, -half))) is sound


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_a_state_needs_a_time_and_each_number_of_its_attitude(bad: float) -> None:
    assert not sound_state(replace(STATE, time_s=bad))
    for place in range(4):
        assert not sound_state(replace(STATE, attitude_wb=spoiled(STATE.attitude_wb, place, bad)))  # type: ignore[arg-type]


def test_each_refused_input_is_named_in_order() -> None:
    bad = replace(STATE, time_s=nan)
    wrong = replace(REFERENCE, yaw_rad=nan)
    other = replace(STATE)
    assert refusals(bad, other, REFERENCE) == ("estimate",)
    assert refusals(other, bad, REFERENCE) == ("predicted",)
    assert refusals(bad, bad, REFERENCE) == ("estimate", "predicted")
    assert refusals(bad, other, wrong) == ("estimate", "reference")
    assert refusals(other, bad, None) == ("predicted",)
    assert refusals(other, other, None) == ()


@pytest.mark.parametrize(
    ("given", "taken"),
    [(0.01, 0.01), (0.0, 0.001), (-1.0, 0.001), (0.1, 0.1), (5.0, 0.1), (nan, 0.01), (inf, 0.01), (-inf, 0.01)],
)
def test_a_step_lies_between_one_and_a_hundred_milliseconds(given: float, taken: float) -> None:
    assert sound_dt_s(given) == taken
