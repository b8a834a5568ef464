"""The pipeline at 100 Hz on a vehicle at rest in the air, and windows of references for it."""

from dataclasses import replace

from daemon import pipeline
from daemon.config import load
from daemon.messages import (
    WINDOW_SPACING_S,
    FrameShift,
    Imu,
    Odometry,
    Reference,
    ReferenceWindow,
    RequestKind,
    Setpoint,
    VehicleRequest,
)
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, PipelineState, Record
from daemon.safety.supervisor import State
from support.statuses import IN_HOLD, IN_OFFBOARD

CONFIG = load([])
PARAMETERS = pipeline_parameters(CONFIG, geofence(CONFIG, (0.0, 0.0, 0.0)))
DT_S = 0.01
ENGAGE = VehicleRequest(1, RequestKind.ENGAGE)


def odometry(n: int, position: tuple[float, float, float] = (0.0, 0.0, -5.0), **changes: object) -> Odometry:
    sample = Odometry(
        stamp_us=1_000_000 + 10_000 * n,
        arrival_s=DT_S * n,
        frame_id=1,
        child_frame_id=1,
        position_m=position,
        velocity_m_s=(0.0, 0.0, 0.0),
        attitude_wb=(1.0, 0.0, 0.0, 0.0),
        rates_frd_rad_s=(0.0, 0.0, 0.0),
        position_variance_m2=(0.04, 0.04, 0.04),
        velocity_variance_m2_s2=(0.01, 0.01, 0.01),
        reset_counter=11,
    )
    return replace(sample, **changes)  # type: ignore[arg-type]


class Flow:
    """Ticks the pipeline at 100 Hz."""

    def __init__(self) -> None:
        self.state: PipelineState = pipeline.initial(PARAMETERS)
        self.n = 0
        self.window: ReferenceWindow | None = None
        self.status = IN_HOLD
        self.request: VehicleRequest | None = None

    @property
    def now_s(self) -> float:
        return DT_S * self.n

    def tick(self, sample: Odometry | None = None, imu: Imu | None = None) -> tuple[Setpoint | None, Record]:
        self.n += 1
        inputs = Inputs(
            odometry=odometry(self.n) if sample is None else sample,
            imu=imu,
            status=self.status,
            window=self.window,
            request=self.request,
            latched=False,
            parameters=PARAMETERS,
        )
        self.state, setpoint, record = pipeline.step(self.state, inputs, self.now_s, DT_S)
        return setpoint, record

    def flying(self) -> "Flow":
        for _ in range(20):
            self.tick()
        self.request = ENGAGE
        for _ in range(30):
            self.tick()
        self.status = IN_OFFBOARD
        _, record = self.tick()
        assert record.supervision.state is State.HOLDING
        return self


def window_of(start: Reference, velocity: tuple[float, float, float], count: int = 60) -> ReferenceWindow:
    """Straight on with a velocity."""
    samples = []
    for i in range(count):
        t = i * WINDOW_SPACING_S
        position = tuple(p + v * t for p, v in zip(start.position_ned_m, velocity, strict=True))
        samples.append(Reference(start.time_s + t, position, velocity, yaw_rad=start.yaw_rad))  # type: ignore[arg-type]
    return ReferenceWindow("goal", tuple(samples), FrameShift())
