"""References streamed by a planner outside: followed without a bump, carried on between arrivals, braked at their end.

Between arrivals the newest sample is carried on with its acceleration and jerk, as a goal that moves: the saturated
reference filter flies after it from the flown state, so limits hold and nothing jumps whatever the planner sends.
"""

from dataclasses import dataclass, replace
from math import ceil, floor

from daemon.frames import clamp, clip_norm, is_finite, scale, subtract, wrap_pi
from daemon.guidance.brake import brake
from daemon.guidance.constant_jerk import Motion, carried
from daemon.guidance.filter_plan import Node, reference_after
from daemon.guidance.heading import HeadedPlan, along_velocity
from daemon.guidance.limits import MotionLimits, motion_excess
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan, SequencePlan
from daemon.guidance.saturation import cascades, step_axis, step_plane
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

_SHORTEST_GAP_S = 1e-3  # between two samples whose velocities give an acceleration


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamSample:
    """One reference from outside, true at ``stamp_s`` of the loop's clock."""

    stamp_s: float
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    acceleration_ned_m_s2: Vec3 | None = None
    jerk_ned_m_s3: Vec3 | None = None
    yaw_rad: float | None = None
    yaw_rate_rad_s: float | None = None


def sample_refusal(sample: StreamSample, before: StreamSample | None, limits: MotionLimits) -> tuple[str, str] | None:
    """Field and reason when a sample is no newer than the one before, not finite or beyond the limits.

    The fence is the caller's.
    """
    if before is not None and not sample.stamp_s > before.stamp_s:
        return "stamp_s", "is not after that of the reference before"
    vectors = {
        "position": sample.position_ned_m,
        "velocity": sample.velocity_ned_m_s,
        "acceleration": sample.acceleration_ned_m_s2,
        "jerk": sample.jerk_ned_m_s3,
    }
    for name, value in vectors.items():
        if value is not None and not is_finite(value):
            return name, "is not finite"
    if not is_finite((sample.yaw_rad or 0.0, sample.yaw_rate_rad_s or 0.0)):
        return "yaw_deg", "is not finite"
    return motion_excess(sample.velocity_ned_m_s, sample.acceleration_ned_m_s2 or ZERO3, limits)


def completed(sample: StreamSample, before: StreamSample | None, limits: MotionLimits) -> StreamSample:
    """The sample with an acceleration: its own, else the derivative of the velocity, within the limits."""
    if sample.acceleration_ned_m_s2 is not None:
        return sample
    acceleration = ZERO3
    if before is not None and sample.stamp_s - before.stamp_s > _SHORTEST_GAP_S:
        change = subtract(sample.velocity_ned_m_s, before.velocity_ned_m_s)
        ax, ay, az = scale(change, 1.0 / (sample.stamp_s - before.stamp_s))
        ax, ay, _ = clip_norm((ax, ay, 0.0), limits.acceleration_m_s2)
        most = limits.vertical_acceleration_m_s2
        acceleration = (ax, ay, clamp(az, -most, most))
    return replace(sample, acceleration_ned_m_s2=acceleration)


def follow(
    start: Reference, sample: StreamSample, timeout_s: float, limits: MotionLimits, parameters: GuidanceParameters
) -> Plan:
    """The plan from a flown reference onto a completed sample, which brakes ``timeout_s`` after the sample's stamp."""
    out_s = sample.stamp_s + timeout_s
    if out_s <= start.time_s:
        return brake(start, limits)
    followed = FollowPlan(start, sample, out_s, limits, parameters)
    path = SequencePlan((followed, brake(followed.target, limits)))

    def wish(reference: Reference) -> float | None:
        if sample.yaw_rad is None:
            return None
        since_s = min(reference.time_s, out_s) - sample.stamp_s
        return wrap_pi(sample.yaw_rad + (sample.yaw_rate_rad_s or 0.0) * since_s)

    heading = along_velocity if parameters.velocity_yaw else wish
    return HeadedPlan(path, start, heading, limits, parameters.omega_stream_rad_s)


class FollowPlan(Plan):
    """The saturated reference filter after a sample that is carried on; ends moving, when the sample is too old."""

    def __init__(
        self, start: Reference, sample: StreamSample, end_s: float, limits: MotionLimits, parameters: GuidanceParameters
    ) -> None:
        self.start_s = start.time_s
        self._end_s = end_s
        quick = replace(parameters, omega_rad_s=parameters.omega_stream_rad_s)
        plane, vertical = cascades(limits, quick, WINDOW_SPACING_S)
        motion: Motion = (start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2)
        self._nodes: list[Node] = []
        for index in range(ceil((end_s - start.time_s) / WINDOW_SPACING_S)):
            (px, py, pz), (vx, vy, vz), (ax, ay, az) = motion
            (gx, gy, gz), (ux, uy, uz), (bx, by, bz) = _carried(sample, start.time_s + index * WINDOW_SPACING_S)
            jx, jy = step_plane(plane, gx - px, gy - py, vx, vy, ax, ay, (ux, uy), (bx, by))
            jerk = (jx, jy, step_axis(vertical, gz - pz, vz, az, uz, bz))
            self._nodes.append((motion, jerk, start.yaw_rad, start.yaw_rate_rad_s, 0.0))
            motion = carried(motion, jerk, WINDOW_SPACING_S)

    @property
    def end_s(self) -> float:
        """When the sample is too old."""
        return self._end_s

    @property
    def target(self) -> Reference:
        """The state at the end, moving."""
        return self.sample(self._end_s)

    def sample(self, time_s: float) -> Reference:
        """The reference at a time up to the end."""
        since_s = min(max(0.0, time_s - self.start_s), self._end_s - self.start_s)
        index = min(floor(since_s / WINDOW_SPACING_S), len(self._nodes) - 1)
        return reference_after(self._nodes[index], since_s - index * WINDOW_SPACING_S, time_s)


def _carried(sample: StreamSample, time_s: float) -> Motion:
    """The sample's motion at a time, its jerk held."""
    motion = (sample.position_ned_m, sample.velocity_ned_m_s, sample.acceleration_ned_m_s2 or ZERO3)
    return carried(motion, sample.jerk_ned_m_s3 or ZERO3, time_s - sample.stamp_s)
