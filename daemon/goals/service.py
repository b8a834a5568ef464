"""The seam between the socket and the daemon: what the daemon does for a client."""

from dataclasses import dataclass
from typing import Protocol

from daemon.goals.methods import (
    ConfigGet,
    ConfigSet,
    EstimatorPose,
    GoalCancel,
    GoalGet,
    GoalSubmit,
    GoalUpdate,
    NoParams,
    ReferenceSet,
    Takeoff,
)
from daemon.goals.results import (
    GoalAccepted,
    GoalRecord,
    GoalRef,
    Setting,
    Status,
    VehicleDone,
)


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks: the number of the connection (never used twice), and the peer's process and user."""

    connection: int
    pid: int
    uid: int
    operator: bool


@dataclass(frozen=True, slots=True)
class Identity:
    """What this daemon is, for system.info."""

    config_hash: str
    uptime_s: float


class FlightService(Protocol):
    """One method for each method of the protocol, named after it (``goal.submit`` is ``goal_submit``).

    Each raises `ProtocolError` when it is not done; a refused request changes nothing. Requests run as tasks of their
    own, one connection's in the order in which they came; a client that leaves does not stop the ones it started.
    ``reference_set`` and ``estimator_pose`` run at once, inside the loop's pass in which they arrived.
    The results and feedback of goals, and telemetry, go out through the `Hub`.
    """

    def identity(self) -> Identity:
        """What system.info tells of the daemon."""

    async def status_get(self, params: NoParams, caller: Caller) -> Status:
        """How the vehicle, the goal and the loops are."""

    async def vehicle_arm(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Arm; returns when telemetry shows it."""

    async def vehicle_disarm(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Disarm; refused unless landed."""

    async def vehicle_takeoff(self, params: Takeoff, caller: Caller) -> VehicleDone:
        """Arm if needed and climb; returns when in the air and in Hold."""

    async def vehicle_engage(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Take the vehicle from Hold under the daemon's control."""

    async def vehicle_hold(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Release the vehicle to the autopilot's Hold."""

    async def vehicle_land(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Land here; returns when disarmed."""

    async def vehicle_return(self, params: NoParams, caller: Caller) -> VehicleDone:
        """Return to launch; returns when disarmed."""

    @property
    def releases(self) -> int:
        """How often the vehicle was given away, or asked to be: a goal that waited meanwhile is not submitted."""

    @property
    def standstills(self) -> int:
        """How often the daemon stood still: what was sent before neither takes nor moves the vehicle."""

    async def goal_submit(self, params: GoalSubmit, caller: Caller, goal_id: str) -> GoalAccepted:
        """Accept a goal as ``goal_id`` and return at once; each accepted goal gets exactly one `Hub.goal_result`."""

    async def goal_update(self, params: GoalUpdate, caller: Caller) -> GoalRef:
        """Move the reference of the active goal."""

    async def goal_cancel(self, params: GoalCancel, caller: Caller) -> GoalRef:
        """Begin to cancel a goal and return at once."""

    async def goal_get(self, params: GoalGet, caller: Caller) -> GoalRecord:
        """How a goal is or how it ended."""

    async def config_get(self, params: ConfigGet, caller: Caller) -> Setting:
        """Read a setting."""

    async def config_set(self, params: ConfigSet, caller: Caller) -> Setting:
        """Change a setting until the restart."""

    def reference_set(self, params: ReferenceSet, caller: Caller) -> None:
        """Take the next reference of a stream goal that ``caller.connection`` submitted."""

    def estimator_pose(self, params: EstimatorPose, caller: Caller) -> None:
        """Take a pose from outside."""
