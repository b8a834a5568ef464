"""What the socket answers and publishes: the shape of each result and of each notification.

Vectors are lists of three numbers in local NED; quaternions ``[w, x, y, z]``, body FRD to local NED; ``*_deg`` degrees,
all else SI. ``time_s`` is CLOCK_MONOTONIC. A value that is not known is null, its key is there.
"""

from typing import Literal

from typing_extensions import TypedDict

Vector = list[float]
SettingValue = bool | float | str | list[float]
Outcome = Literal["succeeded", "preempted", "canceled", "aborted"]


class SystemInfo(TypedDict):
    """Result of system.info; ``methods`` are all that this daemon answers."""

    name: str
    version: str
    protocol: int
    config_hash: str
    uptime_s: float
    methods: list[str]


class Reason(TypedDict):
    """Why the daemon is in the state it is in: a code for programs and words for people."""

    code: str
    text: str


class AutopilotReport(TypedDict):
    """What the autopilot says of itself; ``round_trip_ms``: the way there and back by TIMESYNC, null while unknown."""

    connected: bool
    mode: str
    intended_mode: str
    armed: bool
    landed: str
    battery_pct: float | None
    round_trip_ms: float | None


class VehicleReport(TypedDict):
    """The estimate; ``age_s`` since the measurement behind it, ``covariance_m2`` the largest of the position's axes."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector
    attitude_wb: Vector
    rates_frd_rad_s: Vector
    age_s: float
    covariance_m2: float | None


class GoalProgress(TypedDict):
    """How far the active goal is: ``progress`` from 0 to 1, ``eta_s`` null while unknown."""

    goal_id: str
    kind: str
    distance_m: float | None
    angle_deg: float | None
    progress: float
    eta_s: float | None


class LoopReport(TypedDict):
    """Statistics of one task; ``late`` ticks ran late, ``missed`` ticks did not run."""

    rate_hz: float
    period_p99_ms: float
    late: int
    missed: int


class CollectorReport(TypedDict):
    """Garbage collections since the start, and the longest pause that one made, right after a control tick."""

    collections: int
    longest_ms: float


class LoopReports(TypedDict):
    """Statistics of both tasks and of the garbage collector; also the payload of telemetry.loops."""

    control: LoopReport
    trajectory: LoopReport
    garbage: CollectorReport


class Counters(TypedDict):
    """Resets of the autopilot's estimate, and refused inputs by reason."""

    resets: int
    refused: dict[str, int]


class Status(TypedDict):
    """Result of status.get; ``vehicle`` is null without an estimate, ``goal`` without an active goal."""

    state: str
    reasons: list[Reason]
    autopilot: AutopilotReport
    vehicle: VehicleReport | None
    goal: GoalProgress | None
    loops: LoopReports
    counters: Counters


class VehicleDone(TypedDict):
    """Result of a vehicle request: how things are when it is done and telemetry shows it."""

    state: str
    mode: str
    armed: bool
    landed: str


class GoalAccepted(TypedDict):
    """Result of goal.submit; ``preempted`` is the id of the goal that it ended, or null."""

    goal_id: str
    preempted: str | None


class GoalRef(TypedDict):
    """Result of goal.update and goal.cancel."""

    goal_id: str


class GoalRecord(TypedDict):
    """Result of goal.get and payload of goal.result: all keys always there, null where unknown."""

    goal_id: str
    state: Literal["active", "done"]
    outcome: Outcome | None
    by: str | None
    reason: str | None
    error_m: float | None
    error_deg: float | None
    duration_s: float | None


class GoalFeedback(TypedDict):
    """Payload of goal.feedback, 10 Hz."""

    goal_id: str
    distance_m: float | None
    angle_deg: float | None
    progress: float
    eta_s: float | None


class Subscription(TypedDict):
    """Result of telemetry.subscribe and telemetry.unsubscribe: what this connection gets from now on."""

    topics: list[str]
    rate_hz: float


class Setting(TypedDict):
    """Result of config.get and config.set; ``settable`` tells whether it may be changed in flight."""

    path: str
    value: SettingValue | None
    min: float | None
    max: float | None
    unit: str | None
    settable: bool


class StateTelemetry(TypedDict):
    """Payload of telemetry.state."""

    time_s: float
    state: str
    position_ned_m: Vector
    velocity_ned_m_s: Vector
    attitude_wb: Vector
    rates_frd_rad_s: Vector
    age_s: float
    covariance_m2: float | None


class ReferenceTelemetry(TypedDict):
    """Payload of telemetry.reference: where the vehicle is wanted."""

    time_s: float
    goal_id: str | None
    position_ned_m: Vector
    velocity_ned_m_s: Vector
    acceleration_ned_m_s2: Vector
    jerk_ned_m_s3: Vector
    yaw_deg: float
    yaw_rate_deg_s: float


class SetpointTelemetry(TypedDict):
    """Payload of telemetry.setpoint: what was sent to the autopilot; thrust from 0 to 1."""

    time_s: float
    rates_frd_rad_s: Vector
    thrust: float


class PlanTelemetry(TypedDict):
    """Payload of telemetry.plan: the whole planned path, positions at even spacing in time from ``start_s`` on.

    ``goal_id``: the goal that it was planned for, which may have ended. ``candidates_ned_m``: the paths of the seven
    motion primitives of a polynomial's jerk, none for other goals.
    """

    time_s: float
    goal_id: str | None
    start_s: float
    spacing_s: float
    positions_ned_m: list[Vector]
    candidates_ned_m: list[list[Vector]]


class HealthTelemetry(TypedDict):
    """Payload of telemetry.health."""

    time_s: float
    state: str
    reasons: list[Reason]
    autopilot: AutopilotReport
    counters: Counters


class ResetReport(TypedDict):
    """A jump of the autopilot's estimate, new minus old: shift what you know of the world by it.

    ``kinds``: of velocity_ne, velocity_d, position_ne, position_d, heading. ``counter_steps``: how often the autopilot
    counted a reset (0: it did not say). ``truth_returned``: the numbers before were worthless.
    """

    kinds: list[str]
    position_ned_m: Vector
    velocity_ned_m_s: Vector
    yaw_deg: float
    counter_steps: int
    truth_returned: bool


class EventTelemetry(TypedDict):
    """Payload of telemetry.events: something that happened, once.

    ``field`` and ``error`` (the number that a reply would have) are of ``refused``, ``reset`` of ``reset`` and
    ``fast_slide``.
    """

    time_s: float
    code: str
    text: str
    goal_id: str | None
    field: str | None
    error: int | None
    reset: ResetReport | None
