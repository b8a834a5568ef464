"""Telemetry for the estimator: single messages, flights along a known path, and pieces of recorded flights."""

import gzip
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos, sin
from pathlib import Path

import pytest
from support.continuity_rig import BEGIN_S, SPACING_S

from daemon import frames
from daemon.messages import MavFrame, Odometry

RECORDED = Path(__file__).parents[2] / "fixtures" / "estimation"
LATENCY_S = 0.008
BOOTED_S = 3.0  # loop time at which the autopilot's clock was zero


def _message(stamp_us: int = 1_000_000, **changes: object) -> Odometry:
    """At rest at the origin, heading north, after ``LATENCY_S`` on the way."""
    still = Odometry(
        stamp_us=stamp_us,
        arrival_s=stamp_us * 1e-6 + BOOTED_S + LATENCY_S,
        frame_id=MavFrame.LOCAL_NED,
        child_frame_id=MavFrame.LOCAL_NED,
        position_m=(0.0, 0.0, 0.0),
        velocity_m_s=(0.0, 0.0, 0.0),
        attitude_wb=(1.0, 0.0, 0.0, 0.0),
        rates_frd_rad_s=(0.0, 0.0, 0.0),
        position_variance_m2=(0.04, 0.04, 0.08),
        velocity_variance_m2_s2=(0.01, 0.01, 0.01),
        reset_counter=11,
    )
    return replace(still, **changes)  # type: ignore[arg-type]


def _circling(time_s: float) -> Odometry:
    """A circle of 5 m at 5 m/s about the origin, 10 m up, the nose always forward (1 rad/s)."""
    s, c = sin(time_s), cos(time_s)
    return _message(
        round(time_s * 1e6),
        position_m=(5.0 * c, 5.0 * s, -10.0),
        velocity_m_s=(-5.0 * s, 5.0 * c, 0.0),
        attitude_wb=frames.from_yaw(time_s + 1.5707963267948966),
        rates_frd_rad_s=(0.0, 0.0, 1.0),
    )


def _recorded(name: str) -> Iterator[Odometry]:
    with gzip.open(RECORDED / f"{name}.jsonl.gz", "rt") as lines:
        for line in lines:
            t, stamp, x, y, z, vx, vy, vz, qw, qx, qy, qz, p, q, r, cx, cy, cz, counter = json.loads(line)
            yield Odometry(
                stamp_us=stamp,
                arrival_s=1000.0 + t,
                frame_id=MavFrame.LOCAL_NED,
                child_frame_id=MavFrame.LOCAL_NED,
                position_m=(x, y, z),
                velocity_m_s=(vx, vy, vz),
                attitude_wb=(qw, qx, qy, qz),
                rates_frd_rad_s=(p, q, r),
                position_variance_m2=(cx, cy, cz),
                velocity_variance_m2_s2=(0.01, 0.01, 0.01),
                reset_counter=counter,
            )


@pytest.fixture(scope="session")
def message() -> Callable[..., Odometry]:
    return _message


@pytest.fixture(scope="session")
def circling() -> Callable[[float], Odometry]:
    return _circling


@pytest.fixture(scope="session")
def recorded() -> Callable[[str], Iterator[Odometry]]:
    """Samples of a piece of a recorded PX4 flight; the recording began at loop time 1000 s."""
    return _recorded


@pytest.fixture
def circle(circling: Callable[[float], Odometry]) -> list[Odometry]:
    """Two seconds of samples."""
    return [circling(BEGIN_S + SPACING_S * i) for i in range(200)]
