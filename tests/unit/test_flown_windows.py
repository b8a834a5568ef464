"""Which reference of a window is flown: between its samples, beyond its ends, and after a reset."""

from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sin

import pytest
from support.pipeline_rig import DT_S, PARAMETERS, Flow, odometry, window_of

from daemon.frames import wrap_pi
from daemon.guidance import reference_window
from daemon.messages import WINDOW_SPACING_S, FrameShift, Reference, ReferenceWindow


def test_the_window_is_flown_where_it_covers_the_moment() -> None:
    flow = Flow().flying()
    start = flow.state.flown
    assert start is not None
    flow.window = window_of(start, (1.0, -0.5, 0.25))
    for _ in range(30):
        _, record = flow.tick()
        reference = record.reference
        assert reference is not None
        t = reference.time_s - start.time_s
        assert reference.position_ned_m == pytest.approx(
            tuple(p + v * t for p, v in zip(start.position_ned_m, (1.0, -0.5, 0.25), strict=True)), abs=1e-9
        )
        assert reference.time_s == pytest.approx(flow.now_s + PARAMETERS.command_latency_s)


def test_a_window_that_runs_out_is_braked_to_a_hover_within_the_limits() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    flow.window = window_of(flow.state.flown, (3.0, 0.0, 0.0), count=20)
    references = []
    for _ in range(400):
        _, record = flow.tick()
        assert record.reference is not None
        references.append(record.reference)
    speeds = [r.velocity_ned_m_s[0] for r in references]
    assert max(speeds) == pytest.approx(3.0)
    assert abs(speeds[-1]) < 1e-6
    steps = [abs(b - a) / DT_S for a, b in pairwise(speeds[25:])]
    assert max(steps) <= PARAMETERS.limits.acceleration_m_s2 * 1.01
    moved = references[-1].position_ned_m[0] - references[20].position_ned_m[0]
    assert 1.5 < moved < 4.0


def test_a_window_planned_before_a_reset_is_shifted_when_it_is_flown() -> None:
    flow = Flow().flying()
    assert flow.state.flown is not None
    flow.window = window_of(flow.state.flown, (0.0, 0.0, 0.0))
    _, before = flow.tick()
    _, after = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    assert after.estimate.reset is not None
    assert before.reference is not None and after.reference is not None
    moved = tuple(b - a for a, b in zip(before.reference.position_ned_m, after.reference.position_ned_m, strict=True))
    assert moved == pytest.approx((3.0, -4.0, 0.0), abs=0.02)
    assert after.setpoint is not None
    assert max(abs(rate) for rate in after.setpoint.rates_frd_rad_s) < 0.1, "the vehicle must not lurch"


def cubic(time_s: float) -> Reference:
    """A motion with every derivative, none like another, and a heading that runs past a half turn."""
    j, a, v, p = (30.0, -24.0, 18.0), (2.0, -3.0, 1.0), (0.5, 0.7, -0.3), (1.0, -2.0, -5.0)
    t = time_s
    return Reference(
        time_s,
        tuple(p[i] + v[i] * t + a[i] * t**2 / 2 + j[i] * t**3 / 6 for i in range(3)),  # type: ignore[arg-type]
        tuple(v[i] + a[i] * t + j[i] * t**2 / 2 for i in range(3)),  # type: ignore[arg-type]
        tuple(a[i] + j[i] * t for i in range(3)),  # type: ignore[arg-type]
        j,
        (3.1 + 2.0 * t + pi) % (2.0 * pi) - pi,
        2.0,
    )


def cubic_window(begin_s: float, count: int, shift: FrameShift | None = None) -> ReferenceWindow:
    """It runs from ``begin_s`` of the loop's clock, where its own time is zero."""
    samples = tuple(replace(cubic(i * WINDOW_SPACING_S), time_s=begin_s + i * WINDOW_SPACING_S) for i in range(count))
    return ReferenceWindow("goal", samples, shift or FrameShift())


def values(r: Reference) -> tuple[float, ...]:
    return (
        *r.position_ned_m,
        *r.velocity_ned_m_s,
        *r.acceleration_ned_m_s2,
        *r.jerk_ned_m_s3,
        r.yaw_rad,
        r.yaw_rate_rad_s,
    )


@pytest.mark.parametrize("before_s", [0.0, 0.003, 0.0049, 0.0051, 0.008])
def test_between_its_samples_a_window_is_flown_by_its_derivatives(before_s: float) -> None:
    flow = Flow().flying()
    begin_s = flow.now_s + DT_S + PARAMETERS.command_latency_s - before_s
    flow.window = cubic_window(begin_s, 60)
    for _ in range(10):
        _, record = flow.tick()
        assert record.reference is not None
        assert values(record.reference) == pytest.approx(values(cubic(record.reference.time_s - begin_s)), abs=1e-9)


def test_a_window_reaches_a_spacing_beyond_its_last_sample() -> None:
    for after_s, covered in ((0.0, True), (0.009, True), (0.011, False)):
        flow = Flow().flying()
        act_s = flow.now_s + DT_S + PARAMETERS.command_latency_s
        begin_s = act_s - after_s - 9 * WINDOW_SPACING_S
        flow.window = cubic_window(begin_s, 10)
        _, record = flow.tick()
        assert record.reference is not None
        there = values(record.reference) == pytest.approx(values(cubic(act_s - begin_s)), abs=1e-9)
        assert there is covered


def test_a_window_that_begins_later_is_not_flown_yet() -> None:
    flow = Flow().flying()
    before = flow.state.flown
    assert before is not None
    flow.window = cubic_window(flow.now_s + DT_S + PARAMETERS.command_latency_s + 0.002, 60)
    _, record = flow.tick()
    assert record.reference is not None
    assert record.reference.position_ned_m == pytest.approx(before.position_ned_m, abs=1e-6)


def test_a_window_of_another_frame_is_turned_shifted_and_carried_on_with_the_velocity_since() -> None:
    flow = Flow().flying()
    flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    shift = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))[1].estimate.shift
    assert shift.count == 1
    assert shift.position_ned_m == pytest.approx((3.0, -4.0, 0.0), abs=0.02)
    planned = FrameShift(0, shift.time_s, (1.0, 2.0, 3.0), (0.1, -0.2, 0.3), 0.4)
    begin_s = flow.now_s + DT_S + PARAMETERS.command_latency_s
    flow.window = cubic_window(begin_s, 60, planned)
    for _ in range(5):
        _, record = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -5.0), reset_counter=13))
    assert record.reference is not None
    t = record.reference.time_s
    plain, since = cubic(t - begin_s), t - shift.time_s
    assert 0.05 < since < 0.2
    dp = tuple(now - then for now, then in zip(shift.position_ned_m, (1.0, 2.0, 3.0), strict=True))
    dv = tuple(now - then for now, then in zip(shift.velocity_ned_m_s, (0.1, -0.2, 0.3), strict=True))
    expected = tuple(p + d + v * since for p, d, v in zip(plain.position_ned_m, dp, dv, strict=True))
    assert record.reference.position_ned_m == pytest.approx(expected, abs=1e-9)
    assert record.reference.velocity_ned_m_s == pytest.approx(
        tuple(v + d for v, d in zip(plain.velocity_ned_m_s, dv, strict=True)), abs=1e-9
    )
    assert record.reference.yaw_rad == pytest.approx(
        (plain.yaw_rad + shift.yaw_rad - 0.4 + pi) % (2 * pi) - pi, abs=1e-9
    )


def test_a_hover_without_a_window_moves_with_a_reset() -> None:
    flow = Flow().flying()
    _, before = flow.tick()
    _, after = flow.tick(odometry(flow.n + 1, (3.0, -4.0, -6.0), reset_counter=13))
    assert before.reference is not None and after.reference is not None
    moved = tuple(b - a for a, b in zip(before.reference.position_ned_m, after.reference.position_ned_m, strict=True))
    assert moved == pytest.approx((3.0, -4.0, -1.0), abs=0.02)


def test_where_its_samples_are_farther_apart_a_window_is_flown_through_them_without_a_step() -> None:
    """The places on the way to a rest are told 0.2 s apart: a circle whose phase runs ever more slowly."""

    def slowed(time_s: float) -> Reference:
        s = min(time_s / 4.0, 1.0)
        h, h1 = (1.0 - s) ** 3, -0.75 * (1.0 - s) ** 2
        phase = 0.5 * (1.0 - (1.0 - s) ** 4)
        c, n, w, w1 = cos(phase), sin(phase), 0.5 * h, 0.5 * h1
        p, v = (10.0 * c, 10.0 * n, -5.0), (-10.0 * n * w, 10.0 * c * w, 0.0)
        a = (-10.0 * (c * w * w + n * w1), 10.0 * (c * w1 - n * w * w), 0.0)
        return Reference(time_s, p, v, a, yaw_rad=3.0 + phase, yaw_rate_rad_s=w)

    samples = (slowed(0.0), slowed(WINDOW_SPACING_S), *(slowed(WINDOW_SPACING_S + 0.2 * i) for i in range(1, 21)))
    window = ReferenceWindow("goal", samples, FrameShift())
    assert not reference_window.covers(window, 4.03)
    for i in range(401):
        time_s = 0.01 * i + 0.003
        flown, meant = reference_window.sample(window, FrameShift(), time_s), slowed(time_s)
        assert flown.time_s == time_s
        assert flown.position_ned_m == pytest.approx(meant.position_ned_m, abs=1e-4)
        assert flown.velocity_ned_m_s == pytest.approx(meant.velocity_ned_m_s, abs=1e-3)
        assert flown.acceleration_ned_m_s2 == pytest.approx(meant.acceleration_ned_m_s2, abs=0.02)
        assert wrap_pi(flown.yaw_rad - meant.yaw_rad) == pytest.approx(0.0, abs=1e-3)
        assert flown.yaw_rate_rad_s == pytest.approx(meant.yaw_rate_rad_s, abs=0.02)
        later = reference_window.sample(window, FrameShift(), time_s + 1e-6)
        slope = [(b - a) / 1e-6 for a, b in zip(flown.acceleration_ned_m_s2, later.acceleration_ned_m_s2, strict=True)]
        assert slope == pytest.approx(flown.jerk_ned_m_s3, abs=1e-3)
