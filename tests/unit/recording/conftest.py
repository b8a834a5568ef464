"""Short made-up flights through the real pipeline, for the tests of the record."""

from collections.abc import Callable
from functools import partial
from math import cos, sin
from pathlib import Path
from typing import Any

import pytest

from daemon import config, pipeline
from daemon.messages import (
    AutopilotStatus,
    FlightMode,
    FrameShift,
    Imu,
    LandedState,
    Odometry,
    Reference,
    ReferenceWindow,
    RequestKind,
    SystemStatus,
    VehicleRequest,
)
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, PipelineState, Record
from daemon.recording.recorder import Recorder, RecordingSettings

START_S = 100.0
PATIENCE_S = 120.0
Listener = Callable[[PipelineState, Inputs, Record], None]


def parameters() -> pipeline.Parameters:
    settings = config.load([])
    return pipeline_parameters(settings, geofence(settings, (0.0, 0.0, 0.0)))


def odometry(tick: int, reset_counter: int = 11, offset_m: float = 0.0) -> Odometry:
    x = 0.3 * tick * 0.01
    return Odometry(
        stamp_us=1_000_000 + tick * 10_000,
        arrival_s=START_S + tick * 0.01 - 0.003,
        frame_id=1,
        child_frame_id=1,
        position_m=(5.0 * sin(x) + offset_m, 5.0 * cos(x) - 5.0, -5.0),
        velocity_m_s=(1.5 * cos(x), -1.5 * sin(x), 0.0),
        attitude_wb=(1.0, 0.0, 0.0, 0.0),
        rates_frd_rad_s=(0.01, -0.02, 0.03),
        position_variance_m2=(0.04, 0.04, 0.05),
        velocity_variance_m2_s2=(0.01, 0.01, 0.02),
        reset_counter=reset_counter,
    )


def status(tick: int, armed: bool, mode: FlightMode) -> AutopilotStatus:
    return AutopilotStatus(
        heard=True,
        connected=True,
        heartbeat_s=START_S + tick // 100,
        mode=mode,
        intended_mode=mode,
        armed=armed,
        landed=LandedState.IN_AIR if armed else LandedState.ON_GROUND,
        system_status=SystemStatus.ACTIVE,
    )


def window(tick: int) -> ReferenceWindow:
    samples = []
    for k in range(60):
        x = 0.3 * (tick + k) * 0.01
        samples.append(
            Reference(
                START_S + (tick + k) * 0.01,
                (5.0 * sin(x), 5.0 * cos(x) - 5.0, -5.0),
                (1.5 * cos(x), -1.5 * sin(x), 0.0),
                (-0.45 * sin(x), -0.45 * cos(x), 0.0),
            )
        )
    return ReferenceWindow("goal-1", tuple(samples), FrameShift())


def flight(
    ticks: int,
    listener: Listener,
    *,
    armed: Callable[[int], bool] = lambda tick: True,
    reset_at: int = -1,
    no_window: range = range(0),
    every: int = 1,
) -> None:
    """Engage at tick 30, offboard from tick 60 on; at ``reset_at`` the position jumps by 2 m with its counter.

    In the ticks of ``no_window`` guidance has withdrawn it.

    Ticks of 10 ms, or of ``every`` as much: then those between are left out.
    """
    flown = parameters()
    state = pipeline.initial(flown)
    request = None
    held = window(0)
    for tick in range(0, ticks, every):
        request = VehicleRequest(1, RequestKind.ENGAGE) if tick >= 30 else None
        jumped = 0 <= reset_at <= tick
        inputs = Inputs(
            odometry=odometry(tick, 12 if jumped else 11, 2.0 if jumped else 0.0),
            imu=Imu(
                1_000_000 + tick * 10_000, START_S + tick * 0.01, (0.0, 0.0, -9.8), (0.0, 0.0, 0.0), (0.2, 0.0, 0.4)
            ),
            status=status(tick, armed(tick), FlightMode.OFFBOARD if tick >= 60 else FlightMode.HOLD),
            window=None if tick in no_window else held,
            request=request,
            latched=False,
            parameters=flown,
        )
        state, _, record = pipeline.step(state, inputs, START_S + tick * 0.01, every * 0.01)
        listener(state, inputs, record)
        if (tick + every) % 10 == 0:
            held = window(tick + every)


@pytest.fixture
def fly() -> Callable[..., None]:
    return flight


def close_fully(made: Recorder) -> None:
    """However long the machine takes: ``close`` itself leaves the rest to its thread after a while."""
    made.close()
    made._thread.join(PATIENCE_S)


@pytest.fixture
def close() -> Callable[[Recorder], None]:
    return close_fully


def recorded(
    directory: Path,
    ticks: int,
    *,
    notes: Callable[[Recorder], None] | None = None,
    armed: Callable[[int], bool] = lambda tick: True,
    every: int = 1,
    **settings: Any,
) -> list[Path]:
    """Fly into a recorder with these settings; returns the files."""
    made = Recorder(
        RecordingSettings(directory=directory, **{"when": "always", **settings}),
        {"version": "1", "config_hash": "abc", "config": {"loops": {"control_rate_hz": 100.0 / every}}},
        clock=lambda: START_S + 1.0,
        wall=lambda: 1_800_000_000.0,
    )
    made.start()

    def tick(state: PipelineState, inputs: Inputs, record: Record) -> None:
        while len(made._entries) > 500:  # a test flies faster than the disk writes
            made._wake.wait(0.001)
        made.tick(state, inputs, record)

    flight(ticks, tick, armed=armed, every=every)
    if notes:
        notes(made)
    close_fully(made)
    assert made.report.dropped == 0
    return sorted(directory.glob("*.mcap"))


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., list[Path]]:
    return partial(recorded, tmp_path)


@pytest.fixture(scope="session")
def record_into() -> Callable[..., list[Path]]:
    return recorded
