"""The benchmark's references: each derivative is the slope of the one before, and each begins at rest in the origin."""

from itertools import pairwise

import numpy as np
import pytest

from daemon.bench.manoeuvres import RAMP_S, Manoeuvre, all_manoeuvres, lemniscate, moved
from daemon.messages import ZERO3

SMOOTH = [m for m in all_manoeuvres() if m.step_m == 0.0]
H_S = 1e-5


@pytest.mark.parametrize("manoeuvre", SMOOTH, ids=lambda m: m.name)
@pytest.mark.parametrize("time_s", [0.7, 3.1, RAMP_S + 2.3])
def test_derivatives_are_slopes(manoeuvre: Manoeuvre, time_s: float) -> None:
    before, at, after = (manoeuvre.reference_at(t) for t in (time_s - H_S, time_s, time_s + H_S))
    names = ("position_ned_m", "velocity_ned_m_s", "acceleration_ned_m_s2", "jerk_ned_m_s3")
    for of, slope in pairwise(names):
        difference = (np.array(getattr(after, of)) - np.array(getattr(before, of))) / (2.0 * H_S)
        np.testing.assert_allclose(getattr(at, slope), difference, atol=1e-5)
    turned = np.angle(np.exp(1j * (after.yaw_rad - before.yaw_rad))) / (2.0 * H_S)
    assert at.yaw_rate_rad_s == pytest.approx(turned, abs=1e-5)


@pytest.mark.parametrize("manoeuvre", all_manoeuvres(), ids=lambda m: m.name)
def test_begins_at_rest_in_the_origin(manoeuvre: Manoeuvre) -> None:
    start = manoeuvre.reference_at(0.0)
    np.testing.assert_allclose(start.position_ned_m, ZERO3, atol=1e-12)
    assert start.velocity_ned_m_s == pytest.approx(ZERO3)
    assert start.yaw_rad == 0.0


@pytest.mark.parametrize("peak_m_s", [2.0, 5.0, 8.0])
def test_lemniscate_peaks_at_its_speed_within_its_semi_axes(peak_m_s: float) -> None:
    manoeuvre = lemniscate(peak_m_s)
    times = np.linspace(manoeuvre.run_in_s, manoeuvre.duration_s, 2001)
    references = [manoeuvre.reference_at(float(t)) for t in times]
    assert max(np.linalg.norm(r.velocity_ned_m_s) for r in references) == pytest.approx(peak_m_s, rel=1e-4)
    assert max(r.position_ned_m[0] for r in references) == pytest.approx(10.0, rel=1e-3)
    assert max(r.position_ned_m[1] for r in references) == pytest.approx(5.0, rel=1e-3)


def test_moved_shifts_place_time_and_heading_only() -> None:
    reference = lemniscate(5.0).reference_at(6.0)
    there = moved(reference, (1.0, -2.0, -10.0), 100.0, 3.0)
    assert there.time_s == 106.0
    assert there.position_ned_m == tuple(
        p + d for p, d in zip(reference.position_ned_m, (1.0, -2.0, -10.0), strict=True)
    )
    assert there.velocity_ned_m_s == reference.velocity_ned_m_s
    assert there.yaw_rad == pytest.approx(3.0)
