"""References from outside: joined without a bump, carried on, braked when they stop."""

from dataclasses import replace
from math import cos, dist, sin
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.stream import StreamSample, completed, follow, sample_refusal
from daemon.messages import ZERO3, Reference

LIMITS = MotionLimits()
PARAMETERS = GuidanceParameters()


def circling(time_s: float, yaw: bool = True) -> StreamSample:
    """3 m/s on a circle of 6 m."""
    w = 0.5
    return StreamSample(
        stamp_s=time_s,
        position_ned_m=(6.0 * cos(w * time_s), 6.0 * sin(w * time_s), -5.0),
        velocity_ned_m_s=(-3.0 * sin(w * time_s), 3.0 * cos(w * time_s), 0.0),
        yaw_rad=0.3 * sin(time_s) if yaw else None,
        yaw_rate_rad_s=0.3 * cos(time_s) if yaw else None,
    )


@settings(max_examples=15, deadline=None)
@given(
    rate_hz=st.floats(10.0, 100.0),
    offset=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    velocity=st.tuples(*[st.floats(-0.8, 0.8)] * 3),
)
def test_stream_is_joined_and_followed_without_a_bump(
    checks: SimpleNamespace, rate_hz: float, offset: tuple[float, ...], velocity: tuple[float, float, float]
) -> None:
    at = tuple(p + o for p, o in zip(circling(0.0).position_ned_m, offset, strict=True))
    flown, before = Reference(time_s=0.0, position_ned_m=at, velocity_ned_m_s=velocity), None  # type: ignore[arg-type]
    time = 0.0
    while time < 8.0:
        sample = completed(circling(time), before, LIMITS)
        joined = follow(flown, sample, 0.5, LIMITS, PARAMETERS)
        checks.continuous(flown, joined.sample(time))
        for reference in joined.window(time, 20):
            checks.within(LIMITS, reference, slack=2e-3)
        before, time = sample, time + 1.0 / rate_hz
        flown = joined.sample(time)
    assert dist(flown.position_ned_m, circling(time).position_ned_m) < 0.1
    assert flown.yaw_rad == pytest.approx(0.3 * sin(time), abs=0.05)


def test_silence_brakes_to_a_hover_after_the_time_out(checks: SimpleNamespace) -> None:
    start = Reference(time_s=10.0, position_ned_m=(6.0, 0.0, -5.0), velocity_ned_m_s=(0.0, 3.0, 0.0))
    sample = StreamSample(stamp_s=10.0, position_ned_m=(6.0, 0.0, -5.0), velocity_ned_m_s=(0.0, 3.0, 0.0))
    joined = follow(start, completed(sample, None, LIMITS), 0.5, LIMITS, PARAMETERS)
    assert joined.sample(10.5).velocity_ned_m_s == pytest.approx((0.0, 3.0, 0.0))
    checks.continuous(joined.sample(10.5 - 1e-9), joined.sample(10.5 + 1e-9))
    time_to_stop = 3.0 / LIMITS.acceleration_m_s2 + LIMITS.acceleration_m_s2 / LIMITS.jerk_m_s3
    assert joined.end_s == pytest.approx(10.5 + time_to_stop, abs=1e-6)
    assert joined.sample(20.0).velocity_ned_m_s == ZERO3


def test_a_sample_older_than_the_time_out_brakes_at_once() -> None:
    start = Reference(time_s=10.0, position_ned_m=ZERO3, velocity_ned_m_s=(1.0, 0.0, 0.0))
    late = completed(StreamSample(stamp_s=9.0, position_ned_m=ZERO3, velocity_ned_m_s=ZERO3), None, LIMITS)
    braked = follow(start, late, 0.5, LIMITS, PARAMETERS)
    assert braked.end_s < 11.0
    assert braked.target.position_ned_m[0] > 0.0


def test_acceleration_is_the_derivative_of_the_velocity_when_it_is_missing() -> None:
    first = completed(circling(1.0), None, LIMITS)
    second = completed(circling(1.02), first, LIMITS)
    assert first.acceleration_ned_m_s2 == ZERO3
    expected = (-1.5 * cos(0.505), -1.5 * sin(0.505), 0.0)
    assert second.acceleration_ned_m_s2 == pytest.approx(expected, abs=1e-3)
    given_one = replace(circling(1.02), acceleration_ned_m_s2=(0.1, 0.2, 0.3))
    assert completed(given_one, first, LIMITS).acceleration_ned_m_s2 == (0.1, 0.2, 0.3)


def test_a_leap_of_the_velocity_gives_no_more_acceleration_than_allowed() -> None:
    first = StreamSample(stamp_s=0.0, position_ned_m=ZERO3, velocity_ned_m_s=ZERO3)
    leap = StreamSample(stamp_s=0.01, position_ned_m=ZERO3, velocity_ned_m_s=(3.0, 4.0, -1.0))
    assert completed(leap, first, LIMITS).acceleration_ned_m_s2 == pytest.approx((1.8, 2.4, -2.0))
    same_time = replace(leap, stamp_s=0.0)
    assert completed(same_time, first, LIMITS).acceleration_ned_m_s2 == ZERO3


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"position_ned_m": (float("nan"), 0.0, 0.0)}, "position"),
        ({"velocity_ned_m_s": (4.0, 4.0, 0.0)}, "velocity"),
        ({"velocity_ned_m_s": (0.0, 0.0, 1.6)}, "velocity[2]"),
        ({"acceleration_ned_m_s2": (4.0, 0.0, 0.0)}, "acceleration"),
        ({"acceleration_ned_m_s2": (0.0, 0.0, -2.1)}, "acceleration[2]"),
        ({"jerk_ned_m_s3": (float("inf"), 0.0, 0.0)}, "jerk"),
        ({"yaw_rad": float("nan")}, "yaw_deg"),
    ],
)
def test_a_sample_beyond_the_limits_is_refused_by_name(change: dict[str, object], field: str) -> None:
    refused = sample_refusal(replace(circling(0.0), **change), None, LIMITS)  # type: ignore[arg-type]
    assert refused is not None
    assert refused[0] == field
    assert sample_refusal(circling(0.0), None, LIMITS) is None


def test_a_sample_that_is_not_newer_than_the_last_is_refused() -> None:
    for stamp_s in (1.0, 0.98):
        refused = sample_refusal(circling(stamp_s), circling(1.0), LIMITS)
        assert refused is not None
        assert refused[0] == "stamp_s"
    assert sample_refusal(circling(1.02), circling(1.0), LIMITS) is None
