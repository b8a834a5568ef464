"""Goals as guidance takes them: local NED, SI, radians. The server converts and checks the form."""

from dataclasses import dataclass, field

from daemon.guidance.convergence import Convergence, Tolerance
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HoldGoal:
    """Brake and stay for a time."""

    duration_s: float


Goal = WaypointGoal | HoldGoal
