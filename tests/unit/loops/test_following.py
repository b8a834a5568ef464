"""A goal is given up when the vehicle has been too far from its reference for a second without a break."""

from dataclasses import replace

import pytest
from support.trajectory_rig import NOTHING

from daemon.control.law import ControlRecord
from daemon.loops.following import Following
from daemon.pipeline import Record


def off(deviation_m: float, now_s: float) -> Record:
    error = (0.6 * deviation_m, 0.0, -0.8 * deviation_m)
    return replace(NOTHING, now_s=now_s, control=ControlRecord(position_error_ned_m=error))


def lasts_s(following: Following, deviation_m: float, begin_s: float) -> float:
    """How long it takes, looked at every 0.1 s, until a goal that allows 4 m is given up; at most 5 s."""
    for i in range(50):
        if following.given_up(off(deviation_m, begin_s + 0.1 * i), 4.0):
            return 0.1 * i
    return 5.0


def test_a_vehicle_that_stays_too_far_off_for_a_second_follows_no_more() -> None:
    assert lasts_s(Following(), 4.1, 7.0) == pytest.approx(1.0, abs=0.11)
    assert lasts_s(Following(), 4.0, 7.0) == 5.0


def test_a_vehicle_that_comes_back_within_the_second_follows() -> None:
    following = Following()
    for second in range(5):
        for tenth in range(9):
            assert not following.given_up(off(6.0, second + 0.1 * tenth), 4.0)
        assert not following.given_up(off(3.0, second + 0.9), 4.0)


def test_a_vehicle_that_nothing_is_flown_with_is_not_off() -> None:
    assert not Following().given_up(replace(NOTHING, now_s=9.0, control=None), 4.0)
