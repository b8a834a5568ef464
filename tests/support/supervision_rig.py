"""The supervision at 100 Hz with facts that a test changes, in each of its states."""

from dataclasses import dataclass, field, replace

from daemon.messages import (
    AutopilotStatus,
    EstimatedState,
    FlightMode,
    LandedState,
    RequestKind,
    VehicleRequest,
)
from daemon.safety import supervision as safety
from daemon.safety.conditions import Bounds, Facts
from daemon.safety.supervision import Drive, Supervision, Timing
from daemon.safety.supervisor import State
from support.statuses import IN_HOLD, IN_OFFBOARD, ON_GROUND

TICK_S = 0.01
LEVEL = (1.0, 0.0, 0.0, 0.0)


def vehicle_at(position: tuple[float, float, float] = (0.0, 0.0, -5.0)) -> EstimatedState:
    return EstimatedState(0.0, position, (0.0, 0.0, 0.0), LEVEL, (0.0, 0.0, 0.0), 0.04)


@dataclass
class Rig:
    """Ticks the supervision at 100 Hz with facts that the test changes."""

    facts: Facts = field(default_factory=lambda: Facts(ON_GROUND, vehicle_at(), 0.01, 0.04))
    bounds: Bounds = field(default_factory=Bounds)
    supervision: Supervision = field(default_factory=Supervision)
    now_s: float = 0.0
    request: VehicleRequest | None = None
    asked: list[tuple[float, FlightMode]] = field(default_factory=list)
    drive: Drive = Drive.SILENT

    def tick(self, count: int = 1) -> State:
        for _ in range(count):
            self.now_s += TICK_S
            self.supervision, conditions, modes = safety.step(
                self.supervision, self.facts, self.request, self.now_s, bounds=self.bounds, timing=Timing()
            )
            self.asked += [(self.now_s, mode) for mode in modes]
            self.drive = safety.drive(self.supervision, conditions)
        return self.supervision.state

    def set(self, **changes: object) -> "Rig":
        self.facts = replace(self.facts, **changes)  # type: ignore[arg-type]
        return self

    def status(self, status: AutopilotStatus, **changes: object) -> "Rig":
        return self.set(status=replace(status, **changes))  # type: ignore[arg-type]

    def ask(self, kind: RequestKind) -> "Rig":
        self.request = VehicleRequest(1 if self.request is None else self.request.serial + 1, kind)
        return self


def ready() -> Rig:
    """In Hold that we asked for, after a take-off."""
    rig = Rig()
    assert rig.tick() is State.STANDBY
    rig.ask(RequestKind.TAKEOFF).status(
        IN_HOLD, mode=FlightMode.TAKEOFF, intended_mode=FlightMode.TAKEOFF, landed=LandedState.ON_GROUND
    )
    assert rig.tick(2) is State.TAKING_OFF
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    return rig


def engaging() -> Rig:
    rig = ready()
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick() is State.ENGAGING
    return rig


def holding() -> Rig:
    rig = engaging()
    rig.tick(25)
    rig.status(IN_OFFBOARD)
    assert rig.tick() is State.HOLDING
    rig.asked.clear()
    return rig


def tracking() -> Rig:
    rig = holding().set(goal_active=True)
    assert rig.tick() is State.TRACKING
    return rig


def releasing() -> Rig:
    rig = tracking().ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    return rig
