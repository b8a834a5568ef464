"""Gaps and stuck numbers in the telemetry, reboots and steps of the autopilot's clock, and which of them are resets."""

from dataclasses import replace

import pytest
from support.continuity_rig import BEGIN_S, SPACING_S, events, fly, moved, resets

from daemon import frames
from daemon.messages import ZERO3


def test_numbers_that_stand_still_under_new_stamps_are_refused_until_they_move_again(circle):
    stuck = [replace(circle[100], stamp_us=m.stamp_us, arrival_s=m.arrival_s) for m in circle[101:150]]
    estimates = fly(circle[:101] + stuck + circle[150:])
    assert [e.refused for e in estimates[101:150]] == ["frozen"] * 49
    assert estimates[149].age_s > 0.48
    assert estimates[-1].refused is None


def test_a_vehicle_at_rest_may_repeat_itself(message):
    still = [message(1_000_000 + 10_000 * i) for i in range(50)]
    assert {e.refused for e in fly(still)} == {None}


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


def test_a_reset_in_a_long_gap_is_the_return_of_the_truth(circle):
    after = [moved(m, position=(3.0, 0.0, 0.0), steps=1) for m in circle[170:]]
    ((_, event),) = events(fly(circle[:100] + after))
    assert event.cause == "after_gap"
    assert event.reset.truth_returned


def test_the_frames_origin_moves_with_a_reset_and_is_the_autopilots_own_once_the_truth_returned(circle):
    reset = [moved(m, position=(3.0, 0.0, 0.0), steps=1) for m in circle[100:150]]
    returned = [moved(m, position=(40.0, 0.0, 0.0), steps=2) for m in circle[150:180]]
    again = [moved(m, position=(40.0, 2.0, 0.0), steps=3) for m in circle[180:]]
    shifts = [estimate.shift for estimate in fly(circle[:100] + reset + returned + again)]
    for index, position, origin in (
        (120, (3.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
        (170, (40.0, 0.0, 0.0), ZERO3),
        (-1, (40.0, 2.0, 0.0), (0.0, 2.0, 0.0)),
    ):
        assert shifts[index].position_ned_m == pytest.approx(position, abs=0.1)
        assert shifts[index].origin_ned_m == pytest.approx(origin, abs=0.1)


def test_a_long_gap_without_a_reset_is_only_told(circle):
    estimates = fly(circle[:100] + circle[170:])
    assert [event.name for _, event in events(estimates)] == ["regained"]
    assert estimates[-1].shift.count == 0


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
