"""Resets, jumps and slides put into a flight on a circle at 5 m/s, whose path is known."""

from dataclasses import replace
from itertools import pairwise
from math import exp, pi, radians

import pytest

from daemon import frames
from daemon.estimation import estimator
from daemon.estimation.estimator import EstimatorParameters
from daemon.messages import ZERO3

PARAMETERS = EstimatorParameters()
BEGIN_S, SPACING_S = 10.0, 0.01


def fly(messages, acceleration=ZERO3):
    state = estimator.initial(PARAMETERS)
    estimates = []
    for message in messages:
        state, estimate = estimator.step(state, message, None, acceleration, message.arrival_s, parameters=PARAMETERS)
        estimates.append(estimate)
    return estimates


def moved(message, position=ZERO3, velocity=ZERO3, yaw_rad=0.0, steps=0):
    return replace(
        message,
        position_m=frames.add(message.position_m, position),
        velocity_m_s=frames.add(message.velocity_m_s, velocity),
        attitude_wb=frames.multiply(frames.from_yaw(yaw_rad), message.attitude_wb),
        reset_counter=(message.reset_counter + steps) % 256,
    )


@pytest.fixture
def circle(circling):
    """Two seconds of samples."""
    return [circling(BEGIN_S + SPACING_S * i) for i in range(200)]


def resets(estimates):
    return [(i, estimate.reset) for i, estimate in enumerate(estimates) if estimate.reset]


def events(estimates):
    return [(i, event) for i, estimate in enumerate(estimates) for event in estimate.events]


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


def test_numbers_that_stand_still_under_new_stamps_are_refused_until_they_move_again(circle):
    stuck = [replace(circle[100], stamp_us=m.stamp_us, arrival_s=m.arrival_s) for m in circle[101:150]]
    estimates = fly(circle[:101] + stuck + circle[150:])
    assert [e.refused for e in estimates[101:150]] == ["frozen"] * 49
    assert estimates[149].age_s > 0.48
    assert estimates[-1].refused is None


def test_a_vehicle_at_rest_may_repeat_itself(message):
    still = [message(1_000_000 + 10_000 * i) for i in range(50)]
    assert {e.refused for e in fly(still)} == {None}


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


@pytest.mark.parametrize("lost_samples", [5, 15, 30])
def test_a_reset_in_a_gap_of_the_telemetry_is_measured(circle, lost_samples):
    after = [moved(m, position=(11.0, 0.0, 0.0), steps=2) for m in circle[100 + lost_samples :]]
    ((_, reset),) = resets(fly(circle[:100] + after))
    gap_s = SPACING_S * (lost_samples + 1)
    assert "position_ne" in reset.kinds
    assert reset.position_ned_m == pytest.approx((11.0, 0.0, 0.0), abs=0.02 + 0.5 * 5.0 * gap_s**2)
    assert not reset.truth_returned


def test_motion_in_a_gap_is_not_taken_for_a_kind(circle):
    """Half of the centripetal acceleration is known; a heading reset in a gap of 0.25 s stays a heading reset."""
    known = frames.scale(circle[100].position_m, -0.5)
    after = [moved(m, yaw_rad=0.5, steps=1) for m in circle[124:]]
    ((_, reset),) = resets(fly(circle[:100] + after, (known[0], known[1], 0.0)))
    assert reset.kinds == {"heading"}


def test_motion_in_a_gap_is_not_taken_for_a_jump(circle):
    estimates = fly(circle[:100] + circle[130:])
    assert not events(estimates)
    assert not [e.refused for e in estimates if e.refused]


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


def test_a_reset_in_a_long_gap_is_the_return_of_the_truth(circle):
    after = [moved(m, position=(3.0, 0.0, 0.0), steps=1) for m in circle[170:]]
    ((_, event),) = events(fly(circle[:100] + after))
    assert event.cause == "after_gap"
    assert event.reset.truth_returned


def test_a_long_gap_without_a_reset_is_only_told(circle):
    estimates = fly(circle[:100] + circle[170:])
    assert [event.name for _, event in events(estimates)] == ["regained"]
    assert estimates[-1].shift.count == 0


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


def test_a_reboot_of_the_autopilot_ends_the_old_frame(circle):
    rebooted = [
        replace(
            m,
            stamp_us=m.stamp_us - 9_900_000,
            position_m=ZERO3,
            reset_counter=8,
            velocity_m_s=ZERO3,
            arrival_s=m.arrival_s + 2,
        )
        for m in circle[100:]
    ]
    estimates = fly(circle[:100] + rebooted)
    assert [e.refused for e in estimates[100:102]] == ["stamp_backwards"] * 2
    assert [event.name for _, event in events(estimates)] == ["clock_stepped", "reset"]
    assert events(estimates)[1][1].cause == "rebooted"
    assert resets(estimates)[0][1].truth_returned


@pytest.mark.parametrize(("silence_s", "counter"), [(3.0, 11), (0.1, 2)], ids=["by its silence", "by its counter"])
def test_a_reboot_on_the_spot_is_told(message, silence_s, counter):
    before = [message(60_000_000 + 10_000 * i) for i in range(50)]
    booted_s = before[-1].arrival_s + silence_s
    after = [message(1_000_000 + 10_000 * i, arrival_s=booted_s + 0.01 * i, reset_counter=counter) for i in range(20)]
    estimates = fly(before + after)
    ((_, reset),) = resets(estimates)
    assert reset.truth_returned
    assert [event.cause for _, event in events(estimates)] == ["", "rebooted"]


def test_sense_that_comes_back_to_its_place_must_be_confirmed_too(message):
    samples = [message(1_000_000 + 10_000 * i) for i in range(120)]
    nonsense = [moved(m, position=(float(5 + i * i), 0.0, 0.0)) for i, m in enumerate(samples[20:90])]
    estimates = fly(samples[:20] + nonsense + samples[90:])
    assert [e.refused is None for e in estimates[88:94]] == [False, False, False, False, True, True]


@pytest.mark.parametrize("step_us", [60_000_000, -1_000_000, -9_000_000])
def test_a_step_of_the_autopilots_clock_is_no_reset(circle, step_us):
    stepped = [replace(m, stamp_us=m.stamp_us + step_us) for m in circle[100:]]
    estimates = fly(circle[:100] + stepped)
    assert [event.name for _, event in events(estimates)] == ["clock_stepped"]
    assert estimates[-1].age_s < 0.02


@pytest.fixture
def long_circle(circling):
    """Four seconds: the clock is known well by then."""
    return [circling(BEGIN_S + SPACING_S * i) for i in range(400)]


def assert_nothing_but_the_clock_stepped(messages):
    estimates = fly(messages)
    assert [(e.name, e.cause) for estimate in estimates for e in estimate.events] == [("clock_stepped", "")]
    assert not [estimate.refused for estimate in estimates if estimate.refused]
    for message, estimate in zip(messages, estimates, strict=True):
        assert estimate.newest.position_ned_m == pytest.approx(message.position_m, abs=0.02)


@pytest.mark.parametrize("step_us", [50_000, 200_000])
def test_a_clock_that_steps_ahead_moves_nothing(long_circle, step_us):
    late = [replace(m, stamp_us=m.stamp_us + step_us) for m in long_circle[350:]]
    assert_nothing_but_the_clock_stepped(long_circle[:350] + late)


def test_a_delay_that_ends_at_once_is_motion(long_circle):
    """Of the samples that had been on their way only the newest is seen: 0.16 s of flight within 0.01 s."""
    delayed = [replace(m, arrival_s=m.arrival_s + 0.15) for m in long_circle[:350]]
    assert_nothing_but_the_clock_stepped(delayed + long_circle[365:])
