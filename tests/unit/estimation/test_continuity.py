"""Resets put into a flight on a circle at 5 m/s: each is told by its kinds and size, and its velocity fades in."""

from dataclasses import replace
from itertools import pairwise
from math import exp, pi, radians

import pytest
from support.continuity_rig import SPACING_S, events, fly, moved, resets

from daemon import frames
from daemon.messages import ZERO3


def test_flight_without_reset_shows_none(circle):
    estimates = fly(circle)
    assert not events(estimates)
    assert not [e.refused for e in estimates if e.refused]


@pytest.mark.parametrize(
    ("jump", "kinds"),
    [
        ({"position": (3.0, 0.0, 0.0)}, {"position_ne"}),
        ({"position": (0.0, 0.0, -2.0)}, {"position_d"}),
        ({"velocity": (0.0, 1.0, 0.0)}, {"velocity_ne"}),
        ({"velocity": (0.0, 0.0, 0.5)}, {"velocity_d"}),
        ({"yaw_rad": radians(30)}, {"heading"}),
        ({"yaw_rad": radians(-170)}, {"heading"}),
        ({"position": (0.0, 11.0, 1.0), "velocity": (1.0, 0.0, 0.0)}, {"position_ne", "position_d", "velocity_ne"}),
        (
            {"position": (5.0, -4.0, 3.0), "velocity": (0.5, 0.5, -0.6), "yaw_rad": radians(20)},
            {"position_ne", "position_d", "velocity_ne", "velocity_d", "heading"},
        ),
    ],
)
def test_each_kind_and_combination_is_told_by_its_deltas(circle, jump, kinds):
    steps = len(kinds)
    estimates = fly(circle[:100] + [moved(m, **jump, steps=steps) for m in circle[100:]])
    ((index, event),) = events(estimates)
    reset = event.reset
    assert index == 100
    assert reset.kinds == kinds
    assert reset.position_ned_m == pytest.approx(jump.get("position", ZERO3), abs=0.02)
    assert reset.velocity_ned_m_s == pytest.approx(jump.get("velocity", ZERO3), abs=0.07)
    assert reset.yaw_rad == pytest.approx(jump.get("yaw_rad", 0.0), abs=0.01)
    assert not reset.truth_returned
    assert event.cause == ""
    assert estimates[100].newest.position_ned_m == pytest.approx(
        frames.add(circle[100].position_m, jump.get("position", ZERO3))
    )


def test_the_counter_wraps(circle):
    before = [replace(m, reset_counter=255) for m in circle[:100]]
    after = [moved(replace(m, reset_counter=255), position=(3.0, 0.0, 0.0), steps=2) for m in circle[100:]]
    assert after[0].reset_counter == 1
    ((_, event),) = events(fly(before + after))
    assert event.counter_steps == 2
    assert event.cause == "steps_beyond_kinds"


def test_more_kinds_than_steps_are_named(circle):
    after = [moved(m, position=(3.0, 0.0, 2.0), velocity=(1.0, 0.0, 0.0), steps=1) for m in circle[100:]]
    ((_, event),) = events(fly(circle[:100] + after))
    assert event.cause == "kinds_beyond_steps"


def test_a_counter_that_steps_without_a_jump_shifts_nothing(circle):
    estimates = fly(circle[:100] + [moved(m, steps=2) for m in circle[100:]])
    ((_, event),) = events(estimates)
    assert (event.name, event.cause, event.reset) == ("reset", "none_seen", None)
    assert estimates[-1].shift.count == 0


@pytest.mark.parametrize("start_s", [i * 0.1 for i in range(20, 90, 7)])
def test_headings_wrap(circling, start_s):
    """Whatever the heading is: turning on is no reset, and a jump of -100 degrees is one of -100 degrees."""
    samples = [circling(start_s + SPACING_S * i) for i in range(120)]
    after = [moved(m, yaw_rad=radians(-100), steps=1) for m in samples[110:]]
    ((_, reset),) = resets(fly(samples[:110] + after))
    assert reset.yaw_rad == pytest.approx(radians(-100), abs=0.01)


def test_the_shift_of_the_heading_wraps(circle):
    samples = circle[:50] + [moved(m, yaw_rad=2.0, steps=1) for m in circle[50:100]]
    samples += [moved(m, yaw_rad=4.0, steps=2) for m in circle[100:]]
    assert fly(samples)[-1].shift.yaw_rad == pytest.approx(4.0 - 2.0 * pi, abs=0.02)


def test_two_resets_in_a_row_add_up(circle):
    once = [moved(m, position=(3.0, 0.0, 0.0), steps=1) for m in circle[100:103]]
    twice = [moved(m, position=(3.0, 2.0, 0.0), yaw_rad=0.5, steps=3) for m in circle[103:]]
    estimates = fly(circle[:100] + once + twice)
    assert [i for i, _ in resets(estimates)] == [100, 103]
    shift = estimates[-1].shift
    assert shift.count == 2
    assert shift.position_ned_m == pytest.approx((3.0, 2.0, 0.0), abs=0.03)
    assert shift.yaw_rad == pytest.approx(0.5, abs=0.01)


def test_a_jump_beyond_the_bound_or_after_a_lost_position_is_the_return_of_the_truth(circle):
    far = [moved(m, position=(0.0, -25.0, 0.0), steps=1) for m in circle[100:]]
    assert resets(fly(circle[:100] + far))[0][1].truth_returned
    lost = [replace(m, position_variance_m2=(0.5, 0.1, 0.1)) for m in circle[:100]]
    near = [moved(m, position=(0.0, -5.0, 0.0), steps=1) for m in circle[100:]]
    assert resets(fly(lost + near))[0][1].truth_returned
    turned = [moved(m, yaw_rad=0.5, steps=1) for m in circle[100:]]
    assert not resets(fly(lost + turned))[0][1].truth_returned


def test_a_reset_of_the_velocity_fades_in(circle):
    after = [moved(m, velocity=(1.0, 0.0, 0.0), steps=1) for m in circle[100:]]
    estimates = fly(circle[:100] + after)
    assert resets(estimates)[0][1].velocity_ned_m_s == ZERO3
    late = [
        frames.subtract(e.newest.velocity_ned_m_s, m.velocity_m_s)[0]
        for e, m in zip(estimates[100:], circle[100:], strict=True)
    ]
    assert late[0] == pytest.approx(0.0, abs=0.06)
    assert late[60] == pytest.approx(1.0 - exp(-1.0), abs=0.03)  # 0.6 s later
    assert max(b - a for a, b in pairwise(late)) < 0.02


def test_outliers_and_slides_do_not_disturb_the_fading(circle):
    after = [
        moved(m, position=(0.0, 0.05 * min(max(0, i - 20), 3), 0.0), velocity=(1.0, 0.0, 0.0), steps=1)
        for i, m in enumerate(circle[100:])
    ]
    after[10] = moved(after[10], position=(3.0, 0.0, 0.0))
    estimates = fly(circle[:100] + after)
    assert estimates[110].refused
    late = [
        frames.subtract(e.newest.velocity_ned_m_s, m.velocity_m_s)[0]
        for e, m in zip(estimates[100:], circle[100:], strict=True)
        if e.refused is None
    ]
    assert max(b - a for a, b in pairwise(late)) < 0.035


def test_a_large_reset_of_the_velocity_fades_in_to_its_bound_and_comes_at_once_beyond(circle):
    after = [moved(m, velocity=(0.0, 5.0, 0.0), steps=1) for m in circle[100:]]
    estimates = fly(circle[:100] + after)
    assert resets(estimates)[0][1].velocity_ned_m_s == pytest.approx((0.0, 2.0, 0.0), abs=0.1)
    jump = frames.subtract(estimates[100].newest.velocity_ned_m_s, estimates[99].newest.velocity_ned_m_s)
    assert jump == pytest.approx((0.0, 2.0, 0.0), abs=0.1)


def test_the_truth_is_not_faded(circle):
    lost = [replace(m, position_variance_m2=(40.0, 40.0, 0.1)) for m in circle[:100]]
    after = [moved(m, position=(9.0, -75.0, 0.0), velocity=(1.6, -2.0, 0.0), steps=4) for m in circle[100:]]
    estimates = fly(lost + after)
    assert estimates[100].newest.velocity_ned_m_s == after[0].velocity_m_s
    assert estimates[100].reset.velocity_ned_m_s == pytest.approx((1.6, -2.0, 0.0), abs=0.1)
