"""The gate: each sample of ODOMETRY passes, or is refused with a named reason that is counted with decay."""

from dataclasses import dataclass
from enum import IntEnum
from math import exp, hypot, inf

from daemon.frames import is_finite, rotate
from daemon.messages import MavFrame, Odometry, Quat, Vec3
from daemon.values import value


class Refusal(IntEnum):
    """Why a sample is refused; ``label`` is its name for the outside."""

    NOT_FINITE = 0
    QUATERNION_NORM = 1
    STAMP_BACKWARDS = 2
    STAMP_REPEATED = 3
    STAMP_AHEAD = 4
    UNKNOWN_FRAME = 5
    OUT_OF_RANGE = 6
    JUMP_WITHOUT_RESET = 7
    FROZEN = 8

    @property
    def label(self) -> str:
        """The reason in lower case."""
        return self.name.lower()


@dataclass(frozen=True, slots=True, kw_only=True)
class GateParameters:
    """Physical range of a sample.

    ``quaternion_norm_tolerance``: departure from 1 that is not yet a fault (rounding gives 1e-5).
    ``position_m``, ``speed_m_s``, ``rate_rad_s``: largest norm that is believed of this vehicle and its origin.
    ``counts_decay_s``: time constant of the counters.
    """

    quaternion_norm_tolerance: float = 0.01
    position_m: float = 100_000.0
    speed_m_s: float = 60.0
    rate_rad_s: float = 40.0
    counts_decay_s: float = 10.0


@value
class Sample:
    """One ODOMETRY whose content is good, in NED.

    ``position_variance_m2`` is the largest of the three axes; inf when the autopilot does not know it.
    """

    stamp_us: int
    arrival_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    attitude_wb: Quat
    rates_frd_rad_s: Vec3
    position_variance_m2: float
    reset_counter: int


@value
class Counts:
    """Refusals by reason, each worth 1 when it happens and e^-1 of it ``counts_decay_s`` later; as of ``time_s``."""

    values: tuple[float, ...] = (0.0,) * len(Refusal)
    time_s: float = 0.0


def read(odometry: Odometry, *, parameters: GateParameters) -> Sample | Refusal:
    """The message as a sample in NED with a unit quaternion, or why not. Velocities in a body frame are rotated."""
    position, velocity, attitude = odometry.position_m, odometry.velocity_m_s, odometry.attitude_wb
    rates = odometry.rates_frd_rad_s
    # One sum tells: NaN and inf survive it. A finite sum can still overflow, then each number is looked at.
    total = sum(position) + sum(velocity) + sum(attitude) + sum(rates) + odometry.arrival_s
    if total - total != 0.0 and not is_finite((*position, *velocity, *attitude, *rates, odometry.arrival_s)):
        return Refusal.NOT_FINITE
    length = hypot(*attitude)
    if not abs(length - 1.0) <= parameters.quaternion_norm_tolerance:
        return Refusal.QUATERNION_NORM
    if odometry.frame_id != MavFrame.LOCAL_NED:
        return Refusal.UNKNOWN_FRAME
    w, x, y, z = attitude
    attitude = (w / length, x / length, y / length, z / length)
    child = odometry.child_frame_id
    if child == MavFrame.BODY_FRD:
        velocity = rotate(attitude, velocity)
    elif child != MavFrame.LOCAL_NED:
        return Refusal.UNKNOWN_FRAME
    if (
        hypot(*position) > parameters.position_m
        or hypot(*velocity) > parameters.speed_m_s
        or hypot(*rates) > parameters.rate_rad_s
    ):
        return Refusal.OUT_OF_RANGE
    return Sample(
        odometry.stamp_us,
        odometry.arrival_s,
        position,
        velocity,
        attitude,
        rates,
        largest_variance_m2(odometry.position_variance_m2),
        odometry.reset_counter,
    )


def frozen(before: Odometry, after: Odometry) -> bool:
    """True when a message says that the vehicle moves and repeats every number of the one before."""
    return (
        before.attitude_wb == after.attitude_wb
        and before.position_m == after.position_m
        and before.rates_frd_rad_s == after.rates_frd_rad_s
        and before.velocity_m_s == after.velocity_m_s
        and (any(after.rates_frd_rad_s) or any(after.velocity_m_s))
    )


def largest_variance_m2(variance_m2: Vec3) -> float:
    """The largest of the three; inf when one of them is NaN or negative, which is MAVLink's 'unknown'."""
    x, y, z = variance_m2
    return max(variance_m2) if x >= 0.0 and y >= 0.0 and z >= 0.0 else inf


def counted(counts: Counts, reason: Refusal, now_s: float, *, parameters: GateParameters) -> Counts:
    """The counters with one more refusal."""
    values = decayed(counts, now_s, parameters=parameters)
    return Counts((*values[:reason], values[reason] + 1.0, *values[reason + 1 :]), now_s)


def decayed(counts: Counts, now_s: float, *, parameters: GateParameters) -> tuple[float, ...]:
    """The counters' values now, in the order of ``Refusal``."""
    factor = exp(min(0.0, (counts.time_s - now_s) / parameters.counts_decay_s))
    return tuple(v * factor for v in counts.values)
