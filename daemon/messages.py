"""Every type that crosses a stage of the flow: frozen, slotted, with unit and frame in the field's name.

World frame: local NED. Body frame: FRD. Quaternions are Hamilton ``[w, x, y, z]``, body to world (``attitude_wb``).
Vectors are plain tuples of floats: immutable, and ten times as fast as numpy on three numbers.
Times named ``*_s`` are seconds of the event loop's clock unless the name says otherwise (``stamp_us`` is the
autopilot's clock).
"""

from enum import Enum, IntEnum

from daemon.values import value

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]

ZERO3: Vec3 = (0.0, 0.0, 0.0)
IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)
GRAVITY_M_S2 = 9.80665


class FlightMode(Enum):
    """Flight modes of the autopilot, by the names that PX4's documentation uses.

    A new one comes last: flight records have their places, and a replay compares them.
    """

    UNKNOWN = "unknown"
    MANUAL = "manual"
    ALTITUDE = "altitude"
    POSITION = "position"
    ACRO = "acro"
    STABILIZED = "stabilized"
    OFFBOARD = "offboard"
    READY = "ready"
    TAKEOFF = "takeoff"
    HOLD = "hold"
    MISSION = "mission"
    RETURN = "return"
    LAND = "land"
    FOLLOW = "follow"
    PRECISION_LAND = "precision_land"
    ORBIT = "orbit"
    EXTERNAL = "external"
    POSITION_SLOW = "position_slow"
    ALTITUDE_CRUISE = "altitude_cruise"
    VTOL_TAKEOFF = "vtol_takeoff"
    GUIDED_COURSE = "guided_course"
    TERMINATION = "termination"

    __hash__ = object.__hash__  # Enum's own hashes the name, in Python, at each of a tick's look-ups


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class BatteryCharge(IntEnum):
    """MAV_BATTERY_CHARGE_STATE as PX4 has it: what it calls a battery by its own thresholds."""

    UNDEFINED = 0
    OK = 1
    LOW = 2
    CRITICAL = 3
    EMERGENCY = 4
    FAILED = 5


class SystemStatus(IntEnum):
    """MAV_STATE; CRITICAL means that a failsafe of the autopilot acts."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    FLIGHT_TERMINATION = 8


class MavFrame(IntEnum):
    """The MAV_FRAME values that ODOMETRY may carry and that we understand."""

    LOCAL_NED = 1
    BODY_NED = 8
    BODY_FRD = 12
    LOCAL_FRD = 20


@value
class Odometry:
    """One ODOMETRY message as it came: nothing checked, nothing rotated.

    ``velocity_m_s`` is in the frame that ``child_frame_id`` names (PX4: LOCAL_NED; others: BODY_FRD).
    Variances are the diagonals of the message's covariances; NaN where the autopilot does not know.
    """

    stamp_us: int
    arrival_s: float
    frame_id: int
    child_frame_id: int
    position_m: Vec3
    velocity_m_s: Vec3
    attitude_wb: Quat
    rates_frd_rad_s: Vec3
    position_variance_m2: Vec3
    velocity_variance_m2_s2: Vec3
    reset_counter: int


@value
class Imu:
    """One HIGHRES_IMU message: specific force (reads -g at rest), angular rate, magnetic field."""

    stamp_us: int
    arrival_s: float
    specific_force_frd_m_s2: Vec3
    rates_frd_rad_s: Vec3
    magnetic_field_frd_gauss: Vec3


@value
class ClockSync:
    """What TIMESYNC says of the autopilot's clock: ``offset_s`` is loop time minus autopilot time at ``stamp_us``.

    ``drift`` is what the offset gains in a second. ``uncertainty_s``: half the quickest round trip, and the noise.
    ``round_trip_s``: what the way there and back takes now, the middle one of the newest exchanges.
    """

    stamp_us: int
    offset_s: float
    drift: float
    uncertainty_s: float
    round_trip_s: float

    def offset_at(self, stamp_us: int) -> float:
        """The offset when the autopilot's clock shows ``stamp_us``, seconds."""
        return self.offset_s + self.drift * (stamp_us - self.stamp_us) * 1e-6


@value(eq=True)
class GlobalPosition:
    """WGS84 position: degrees, and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


@value(eq=True)
class ModeRefusal:
    """The autopilot refused a mode that we asked for: which, why in words, and when (loop clock)."""

    mode: FlightMode
    reason: str
    time_s: float


@value(eq=True)
class AutopilotStatus:
    """What the autopilot says of itself, newest of each message; ``heartbeat_s`` is the last HEARTBEAT's arrival.

    ``mode`` is the newest of CURRENT_MODE, HEARTBEAT and EVENT; ``heard``: messages of now flow, and it was told since
    they do; without it the mode may be of the past. ``told_s``: it is not older than this; ``mode_before`` is the one
    that it came over. ``boot_count`` steps when the autopilot rebooted. ``battery_charge`` is that of the worst
    battery, ``battery_id``. ``airframe``: what it calls the vehicle, in words, when that is no multirotor; else empty.
    """

    connected: bool = False
    heartbeat_s: float = float("-inf")
    mode: FlightMode = FlightMode.UNKNOWN
    intended_mode: FlightMode = FlightMode.UNKNOWN
    armed: bool = False
    landed: LandedState = LandedState.UNDEFINED
    system_status: SystemStatus = SystemStatus.UNINIT
    battery_fraction: float | None = None
    battery_charge: BatteryCharge = BatteryCharge.UNDEFINED
    battery_id: int = 0
    global_position: GlobalPosition | None = None
    home: GlobalPosition | None = None
    global_origin: GlobalPosition | None = None
    home_ned_m: Vec3 | None = None
    boot_count: int = 0
    mode_refusal: ModeRefusal | None = None
    heard: bool = False
    told_s: float = float("-inf")
    airframe: str = ""
    mode_before: FlightMode | None = None


@value
class EstimatedState:
    """The vehicle at ``time_s``. ``position_variance_m2`` is the largest of the three axes."""

    time_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    attitude_wb: Quat
    rates_frd_rad_s: Vec3
    position_variance_m2: float = 0.0


@value
class ExternalPose:
    """A pose from outside (motion capture, visual odometry) in local NED, true at ``stamp_s`` of the loop's clock.

    Variances None where the sender does not know them; the angles' are of roll, pitch, yaw.
    """

    stamp_s: float
    position_ned_m: Vec3
    attitude_wb: Quat | None = None
    position_variance_m2: Vec3 | None = None
    angle_variance_rad2: Vec3 | None = None


@value
class Reset:
    """A jump of the autopilot's estimate that is not motion: what it is called and by how much (new minus old).

    ``kinds`` is a subset of velocity_ne, velocity_d, position_ne, position_d, heading.
    ``truth_returned``: the numbers after it are the true ones (a lost position came back), see the reset policy.
    """

    time_s: float
    kinds: frozenset[str]
    position_ned_m: Vec3 = ZERO3
    velocity_ned_m_s: Vec3 = ZERO3
    yaw_rad: float = 0.0
    truth_returned: bool = False


@value
class FrameShift:
    """Sum of all resets so far: what a number of the world frame of the beginning is called now.

    ``count`` steps with each reset. ``velocity_ned_m_s`` is the sum of the velocity resets.
    A ``ReferenceWindow`` carries the shift under which it was planned; the difference is applied when it is sampled.
    ``origin_ned_m`` is what the frame's origin is called now: true numbers are counted from it, so it is the sum of the
    position's resets since the truth returned last.
    """

    count: int = 0
    time_s: float = float("-inf")
    position_ned_m: Vec3 = ZERO3
    velocity_ned_m_s: Vec3 = ZERO3
    yaw_rad: float = 0.0
    origin_ned_m: Vec3 = ZERO3

    def since(self, before: "FrameShift") -> tuple[Vec3, Vec3, float]:
        """By how much position (m), velocity (m/s) and heading (rad) have jumped since an earlier shift."""
        (n, e, d), (n0, e0, d0) = self.position_ned_m, before.position_ned_m
        (vn, ve, vd), (vn0, ve0, vd0) = self.velocity_ned_m_s, before.velocity_ned_m_s
        return (n - n0, e - e0, d - d0), (vn - vn0, ve - ve0, vd - vd0), self.yaw_rad - before.yaw_rad


@value
class Reference:
    """Where the vehicle is wanted at ``time_s``: flat outputs and their derivatives."""

    time_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3 = ZERO3
    acceleration_ned_m_s2: Vec3 = ZERO3
    jerk_ned_m_s3: Vec3 = ZERO3
    yaw_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0


WINDOW_SPACING_S = 0.01


@value
class ReferenceWindow:
    """The reference of the next half second and more, at ``WINDOW_SPACING_S``; immutable, published by guidance.

    Where braking from there straight on would leave the fence, samples farther apart follow, to a rest within.
    ``goal_id`` is None when the vehicle merely holds. ``shift`` is the frame in which it was planned.
    """

    goal_id: str | None
    samples: tuple[Reference, ...]
    shift: FrameShift


@value
class Setpoint:
    """What PX4 flies: body rates (FRD) and collective thrust, 0 to 1 of the normalized command."""

    rates_frd_rad_s: Vec3
    thrust: float


class RequestKind(Enum):
    """What a person may ask of the vehicle and the supervisor has to see."""

    ENGAGE = "engage"
    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    TAKEOFF = "takeoff"


@value(eq=True)
class VehicleRequest:
    """A request, taken once: ``serial`` steps with each."""

    serial: int
    kind: RequestKind
