"""Goals as guidance takes them: local NED, SI, radians. The server converts and checks the form."""

from dataclasses import dataclass, field
from enum import Enum
from math import pi

from daemon.guidance.convergence import Convergence, Tolerance
from daemon.guidance.heading import FixedHeading, Heading
from daemon.guidance.shapes import Shape
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.messages import Quat, Vec3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WaypointGoal:
    """Fly to a position and heading. No position: stay where braking ends; no attitude: keep the heading.

    Of the attitude the heading is flown; ``reachability`` refuses a tilt.
    """

    position_ned_m: Vec3 | None = None
    attitude_wb: Quat | None = None
    mode: WaypointMode = WaypointMode.FULL_POSE
    convergence: Convergence = field(default_factory=Tolerance)
    hold_s: float = 0.0


class Through(Enum):
    """How a path takes its waypoints."""

    STOP = "stop"
    FLY_BY = "fly_by"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathGoal:
    """Waypoints one after the other, at rest in the last. ``hold_s`` counts at each that is stopped at."""

    waypoints: tuple[WaypointGoal, ...]
    through: Through = Through.STOP


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapeGoal:
    """Turns of a shape from the point nearest to the vehicle; ``speed_m_s`` (peak) or ``period_s`` sets the rate."""

    shape: Shape
    speed_m_s: float | None = None
    period_s: float | None = None
    turns: float = 1.0
    clockwise: bool = True
    heading: Heading = field(default_factory=FixedHeading)

    @property
    def rate_rad_s(self) -> float:
        """Rate of the phase, negative counter-clockwise; NaN when neither speed nor period is given."""
        if self.speed_m_s is not None:
            rate = self.speed_m_s / self.shape.path_speed_m
        else:
            rate = float("nan") if self.period_s is None else 2.0 * pi / self.period_s
        return rate if self.clockwise else -rate


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PolynomialGoal:
    """A constant jerk for a time from the flown state, then a brake."""

    jerk_ned_m_s3: Vec3
    duration_s: float
    heading: Heading = field(default_factory=FixedHeading)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HoldGoal:
    """Brake and stay for a time."""

    duration_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamGoal:
    """Follow references from outside: brake until the first comes; ``stream.follow`` makes the plans after that."""

    timeout_s: float = 0.5


Goal = WaypointGoal | PathGoal | ShapeGoal | PolynomialGoal | HoldGoal | StreamGoal
