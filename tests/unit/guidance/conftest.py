"""The checks that hold for every plan, as one fixture."""

from math import dist, hypot
from types import SimpleNamespace

import pytest

from daemon.frames import wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.messages import Reference

SEAM = 1e-6


def assert_continuous(before: Reference, after: Reference) -> None:
    assert dist(before.position_ned_m, after.position_ned_m) <= SEAM
    assert dist(before.velocity_ned_m_s, after.velocity_ned_m_s) <= SEAM
    assert dist(before.acceleration_ned_m_s2, after.acceleration_ned_m_s2) <= SEAM
    assert abs(wrap_pi(before.yaw_rad - after.yaw_rad)) <= SEAM
    assert abs(before.yaw_rate_rad_s - after.yaw_rate_rad_s) <= SEAM


def assert_within(limits: MotionLimits, reference: Reference, slack: float = 1e-5) -> None:
    """Beyond no bound by more than ``slack`` of it, which is what rounding makes of a sum of vectors."""
    vx, vy, vz = reference.velocity_ned_m_s
    ax, ay, az = reference.acceleration_ned_m_s2
    jx, jy, jz = reference.jerk_ned_m_s3
    more = 1.0 + slack
    assert hypot(vx, vy) <= limits.speed_m_s * more
    assert -limits.climb_m_s * more <= vz <= limits.descent_m_s * more
    assert hypot(ax, ay) <= limits.acceleration_m_s2 * more
    assert abs(az) <= limits.vertical_acceleration_m_s2 * more
    assert hypot(jx, jy) <= limits.jerk_m_s3 * more
    assert abs(jz) <= limits.jerk_m_s3 * more
    assert abs(reference.yaw_rate_rad_s) <= limits.yaw_rate_rad_s * more


def assert_derivatives_agree(plan: Plan, time_s: float, h: float = 1e-5) -> None:
    """Velocity, acceleration and jerk against central differences; the time must not sit on a switch of the jerk."""
    before, now, after = plan.sample(time_s - h), plan.sample(time_s), plan.sample(time_s + h)

    def slope(name: str) -> list[float]:
        return [(b - a) / (2.0 * h) for a, b in zip(getattr(before, name), getattr(after, name), strict=True)]

    assert slope("position_ned_m") == pytest.approx(list(now.velocity_ned_m_s), abs=1e-4)
    assert slope("velocity_ned_m_s") == pytest.approx(list(now.acceleration_ned_m_s2), abs=1e-3)
    turned = wrap_pi(after.yaw_rad - before.yaw_rad) / (2.0 * h)
    assert turned == pytest.approx(now.yaw_rate_rad_s, abs=1e-3)


@pytest.fixture(scope="session")
def checks() -> SimpleNamespace:
    return SimpleNamespace(
        continuous=assert_continuous, within=assert_within, derivatives_agree=assert_derivatives_agree
    )
