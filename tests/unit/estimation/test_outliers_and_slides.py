"""Jumps without a reset counter: single outliers are refused, lasting ones become resets, slides are followed."""

from itertools import pairwise

import pytest
from support.continuity_rig import PARAMETERS, SPACING_S, events, fly, moved, resets

from daemon import frames
from daemon.messages import ZERO3


@pytest.mark.parametrize("jump", [{"position": (1.0, 0.0, 0.0)}, {"velocity": (0.0, 2.0, 0.0)}, {"yaw_rad": 0.3}])
def test_a_single_outlier_is_refused_and_flown_over(circle, jump):
    samples = list(circle)
    samples[100] = moved(samples[100], **jump)
    estimates = fly(samples)
    assert estimates[100].refused == "jump_without_reset"
    assert estimates[100].newest is estimates[99].newest
    assert estimates[101].refused is None
    assert not events(estimates)


def test_outliers_that_disagree_are_all_refused(circle):
    """Also after they lasted for longer than any prediction: silence is forgiven, nonsense is not."""
    samples = [moved(m, position=(float(5 + i * i), 0.0, 0.0)) if i > 0 else m for i, m in enumerate(circle[:100])]
    assert [e.refused for e in fly(samples)][1:] == ["jump_without_reset"] * 99


def test_sense_after_lasting_nonsense_is_a_new_frame(circle):
    samples = [moved(m, position=(float(5 + i * i), 0.0, 0.0)) if i > 0 else m for i, m in enumerate(circle[:100])]
    estimates = fly(samples + circle[100:])
    ((index, event),) = events(estimates)
    assert index == 102
    assert (event.name, event.cause) == ("fast_slide", "after_gap")
    assert event.reset.truth_returned


@pytest.mark.parametrize("jump", [{"position": (2.0, 0.0, 0.0)}, {"velocity": (0.0, 1.5, 0.0)}, {"yaw_rad": 0.3}])
def test_a_lasting_jump_without_a_counter_becomes_a_reset(circle, jump):
    estimates = fly(circle[:100] + [moved(m, **jump) for m in circle[100:]])
    assert [e.refused for e in estimates[100:103]] == ["jump_without_reset", "jump_without_reset", None]
    ((index, event),) = events(estimates)
    assert (index, event.name) == (102, "fast_slide")
    assert event.reset.position_ned_m == pytest.approx(jump.get("position", ZERO3), abs=0.05)
    assert event.reset.velocity_ned_m_s == pytest.approx(jump.get("velocity", ZERO3), abs=0.2)
    assert event.reset.yaw_rad == pytest.approx(jump.get("yaw_rad", 0.0), abs=0.02)


def test_a_counter_that_comes_after_its_jump_gives_one_reset(circle):
    late = [moved(m, position=(3.0, 0.0, 0.0), steps=min(1, i)) for i, m in enumerate(circle[100:])]
    estimates = fly(circle[:100] + late)
    assert estimates[100].refused == "jump_without_reset"
    assert [i for i, _ in resets(estimates)] == [101]


def unexplained(estimates):
    """How far the published position jumps from tick to tick beyond the velocity, without what a reset explains."""
    jumps = []
    for before, after in pairwise(estimates):
        dt = after.newest.time_s - before.newest.time_s
        step = frames.subtract(after.newest.position_ned_m, before.newest.position_ned_m)
        step = frames.subtract(step, frames.scale(before.newest.velocity_ned_m_s, dt))
        if after.reset:
            step = frames.subtract(step, after.reset.position_ned_m)
        jumps.append(frames.norm(step))
    return jumps


def test_a_slow_slide_is_followed_at_a_bounded_rate(circle):
    """The estimate creeps by 0.15 m in three samples: it comes through at 1.5 m/s, and all of it."""
    after = [moved(m, position=(0.05 * min(i + 1, 3), 0.0, 0.0)) for i, m in enumerate(circle[100:])]
    estimates = fly(circle[:100] + after)
    assert not events(estimates)
    assert max(unexplained(estimates)) < PARAMETERS.slide.follow_m_s * SPACING_S + 0.002
    assert estimates[-1].newest.position_ned_m == pytest.approx(after[-1].position_m)


@pytest.mark.parametrize("steps", [0, 2])
def test_a_jump_during_a_slide_is_explained_to_the_last_centimetre(circle, steps):
    sliding = [moved(m, position=(0.1 * (i + 1), 0.0, 0.0)) for i, m in enumerate(circle[100:103])]
    jumped = [moved(m, position=(0.3, 4.0, 0.0), steps=steps) for m in circle[103:]]
    estimates = fly(circle[:100] + sliding + jumped)
    assert len(resets(estimates)) == 1
    assert max(unexplained(estimates)) < PARAMETERS.slide.follow_m_s * SPACING_S + 0.005


def test_a_slide_that_goes_on_is_a_reset(circle):
    """0.1 m a sample, 10 m/s, for 0.3 s: below the gate, beyond what can be followed."""
    after = [moved(m, position=(0.1 * min(i + 1, 30), 0.0, 0.0)) for i, m in enumerate(circle[100:])]
    estimates = fly(circle[:100] + after)
    names = [event.name for _, event in events(estimates)]
    assert names
    assert set(names) == {"fast_slide"}
    assert max(unexplained(estimates)) < PARAMETERS.slide.follow_m_s * SPACING_S + 0.002
    assert estimates[-1].newest.position_ned_m == pytest.approx(after[-1].position_m)
    assert 2.0 < estimates[-1].shift.position_ned_m[0] < 3.0


def test_a_slide_too_quick_for_the_gate_is_coasted_over_and_taken_at_its_end(circle):
    """0.3 m a sample for 0.1 s, as PX4 shows it after a short loss of GPS."""
    after = [moved(m, position=(0.3 * min(i + 1, 10), 0.0, 0.0)) for i, m in enumerate(circle[100:])]
    estimates = fly(circle[:100] + after)
    ((index, event),) = events(estimates)
    assert event.name == "fast_slide"
    assert 110 <= index <= 113
    assert event.reset.position_ned_m == pytest.approx((3.0, 0.0, 0.0), abs=0.1)


def test_sense_that_comes_back_to_its_place_must_be_confirmed_too(message):
    samples = [message(1_000_000 + 10_000 * i) for i in range(120)]
    nonsense = [moved(m, position=(float(5 + i * i), 0.0, 0.0)) for i, m in enumerate(samples[20:90])]
    estimates = fly(samples[:20] + nonsense + samples[90:])
    assert [e.refused is None for e in estimates[88:94]] == [False, False, False, False, True, True]
