"""From a goal as it came over the socket to an order for the trajectory task: frames, units, reachability."""

import asyncio
from dataclasses import dataclass
from math import radians

from daemon import frames
from daemon.config import describe
from daemon.goals import schema
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import EstimatorPose, GoalSubmit, ReferenceSet
from daemon.guidance import planner, reachability
from daemon.guidance.convergence import Convergence, Threshold, Tolerance
from daemon.guidance.goals import (
    Goal,
    HoldGoal,
    PathGoal,
    PolynomialGoal,
    ShapeGoal,
    StreamGoal,
    Through,
    WaypointGoal,
)
from daemon.guidance.heading import FixedHeading, Heading, PointHeading, TargetHeading, VelocityHeading
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.plan import Plan
from daemon.guidance.reachability import Refusal
from daemon.guidance.shapes import Circle, Lemniscate, Shape
from daemon.guidance.stream import StreamSample, sample_refusal
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.loops.goal_order import GoalOrder
from daemon.loops.stopping import reach_of
from daemon.messages import AutopilotStatus, ExternalPose, GlobalPosition, Quat, Reference, Vec3
from daemon.safety.geofence import Geofence, violation

STAMP_AGE_MAX_S = 1.0
STAMP_AHEAD_MAX_S = 0.5
PLACE_MAX_M = 100_000.0
NAMED_HEADINGS: dict[str, Heading] = {
    "fixed": FixedHeading(),
    "target": TargetHeading(),
    "velocity": VelocityHeading(),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """What bounds a goal when it is accepted: a plan starts from ``flown``, ``body_frd`` is seen from ``here``."""

    flown: Reference
    here: Reference
    status: AutopilotStatus
    fence: Geofence
    max_distance_m: float
    limits: MotionLimits
    parameters: GuidanceParameters


async def order(goal_id: str, params: GoalSubmit, place: Place, connection: int) -> GoalOrder:
    """The order of a goal. Raises ``ProtocolError`` with field and reason when it cannot be flown.

    A path to be flown without stopping takes long to plan; that is done beside the loop.
    """
    given = params.goal
    kind = next(name for name in ("waypoint", "path", "trajectory", "stream") if getattr(params, name) is given)

    def make(status: AutopilotStatus) -> Goal:
        return _goal(given, place, status)

    goal = make(place.status)
    limits = _tightened(place.limits, params.limits)
    wanted = GoalOrder(
        goal_id=goal_id,
        kind=kind,
        goal=goal,
        limits=limits,
        timeout_s=params.timeout_s,
        resolve=make if _is_global(given) else None,
        connection=connection,
    )
    if wanted.plans_long:
        await asyncio.get_running_loop().run_in_executor(None, _check, goal, limits, place)
    else:
        _check(goal, limits, place)
    return wanted


def moved(old: GoalOrder, waypoint: schema.Waypoint, place: Place) -> GoalOrder:
    """The order of an active goal, moved to another waypoint with its limits and its time-out."""

    def make(status: AutopilotStatus) -> Goal:
        return _waypoint(waypoint, "waypoint", place, status)

    goal = make(place.status)
    _check(goal, old.limits, place)
    return GoalOrder(
        goal_id=old.goal_id,
        kind="waypoint",
        goal=goal,
        limits=old.limits,
        timeout_s=old.timeout_s,
        resolve=make if waypoint.frame == "global" else None,
        connection=old.connection,
    )


Given = schema.Waypoint | schema.Path | schema.Trajectory | schema.Stream


def _is_global(given: Given) -> bool:
    if isinstance(given, schema.Path):
        return any(waypoint.frame == "global" for waypoint in given.waypoints)
    return getattr(given, "frame", None) == "global"


def _goal(given: Given, place: Place, status: AutopilotStatus) -> Goal:
    if isinstance(given, schema.Waypoint):
        return _waypoint(given, "waypoint", place, status)
    if isinstance(given, schema.Path):
        waypoints = tuple(
            _waypoint(waypoint, f"path.waypoints[{i}]", place, status) for i, waypoint in enumerate(given.waypoints)
        )
        return PathGoal(waypoints=waypoints, through=Through(given.through))
    if isinstance(given, schema.Stream):
        return StreamGoal(timeout_s=given.timeout_s)
    if isinstance(given, schema.HoldFor):
        return HoldGoal(duration_s=given.duration_s)
    if isinstance(given, schema.Polynomial):
        heading = _heading(given.heading, "local_ned", place, status)
        return PolynomialGoal(jerk_ned_m_s3=given.jerk_m_s3, duration_s=given.duration_s, heading=heading)
    return _shape(given, place, status)


def _waypoint(waypoint: schema.Waypoint, field: str, place: Place, status: AutopilotStatus) -> WaypointGoal:
    position = None
    if waypoint.position is not None:
        position = _point(waypoint.position, waypoint.frame, f"{field}.frame", place, status)
    return WaypointGoal(
        position_ned_m=position,
        attitude_wb=_attitude(waypoint, place),
        mode=WaypointMode(waypoint.mode),
        convergence=_convergence(waypoint),
        hold_s=waypoint.hold_s,
    )


def _shape(given: schema.Circle | schema.Lemniscate, place: Place, status: AutopilotStatus) -> ShapeGoal:
    center = _point(given.center, given.frame, "trajectory.frame", place, status)
    axis = _direction(given.axis, given.frame, place)
    shape: Shape
    if isinstance(given, schema.Circle):
        shape = Circle(center_ned_m=center, radius_m=given.radius_m, axis_ned=axis)
    else:
        shape = Lemniscate(center_ned_m=center, size_m=given.size_m, axis_ned=axis)
    return ShapeGoal(
        shape=shape,
        speed_m_s=given.speed_m_s,
        period_s=given.period_s,
        turns=given.turns,
        clockwise=given.direction == "cw",
        heading=_heading(given.heading, given.frame, place, status),
    )


def _heading(heading: schema.Heading, frame: str, place: Place, status: AutopilotStatus) -> Heading:
    if isinstance(heading, schema.HeadingPoint):
        return PointHeading(_point(heading.point, frame, "trajectory.frame", place, status))
    return NAMED_HEADINGS[heading]


def _point(position: Vec3, frame: str, field: str, place: Place, status: AutopilotStatus) -> Vec3:
    if frame == "local_enu":
        return frames.ned_from_enu(position)
    if frame == "body_frd":
        ahead = frames.rotate_about_down(position, place.here.yaw_rad)
        return frames.add(place.here.position_ned_m, ahead)
    if frame == "global":
        if status.global_origin is None:
            reason = "the autopilot has not told where its local frame lies on the globe"
            raise ProtocolError(ErrorCode.WRONG_STATE, reason, field)
        return frames.ned_from_global(GlobalPosition(*position), status.global_origin)
    return position


def _direction(axis: Vec3, frame: str, place: Place) -> Vec3:
    if frame == "local_enu":
        return frames.ned_from_enu(axis)
    return frames.rotate_about_down(axis, place.here.yaw_rad) if frame == "body_frd" else axis


def _attitude(waypoint: schema.Waypoint, place: Place) -> Quat | None:
    frame, now_rad = waypoint.frame, place.here.yaw_rad
    if waypoint.orientation is not None:
        q = frames.normalized(waypoint.orientation)
        if frame == "local_enu":
            return frames.attitude_ned_from_enu_frd(q)
        return frames.multiply(frames.from_yaw(now_rad), q) if frame == "body_frd" else q
    if waypoint.yaw_deg is None:
        return None
    yaw = radians(waypoint.yaw_deg)
    if frame == "local_enu":
        yaw = frames.yaw_ned_from_enu(yaw)
    return frames.from_yaw(frames.wrap_pi(yaw + now_rad if frame == "body_frd" else yaw))


def _convergence(waypoint: schema.Waypoint) -> Convergence:
    if waypoint.threshold is not None:
        return Threshold(waypoint.threshold)
    wanted = waypoint.convergence or schema.Convergence()
    return Tolerance(
        position_m=wanted.position_m,
        angle_rad=radians(wanted.angle_deg),
        speed_m_s=wanted.speed_m_s,
        dwell_s=wanted.dwell_s,
    )


def _tightened(limits: MotionLimits, wanted: schema.Limits | None) -> MotionLimits:
    if wanted is None:
        return limits
    for name, value in wanted.model_dump(exclude_none=True).items():
        allowed = describe(f"guidance.limits.{name}")
        if value < allowed["min"]:
            reason = f"{value:g} is less than the {allowed['min']:g} {allowed['unit']} that can be flown"
            raise ProtocolError(ErrorCode.REFUSED, reason, f"limits.{name}")
    return limits.tightened(
        speed_m_s=wanted.speed_m_s,
        acceleration_m_s2=wanted.acceleration_m_s2,
        jerk_m_s3=wanted.jerk_m_s3,
        yaw_rate_rad_s=None if wanted.yaw_rate_deg_s is None else radians(wanted.yaw_rate_deg_s),
    )


def _check(goal: Goal, limits: MotionLimits, place: Place) -> None:
    """The goal, the way to it and the way along it are within the fence, within reach and within the limits."""
    reach = reach_of(place.fence, limits, place.max_distance_m)
    refuse(reachability.refusal(goal, place.flown, reach))
    plan = planner.plan(place.flown, goal, limits, place.parameters)
    refuse(reachability.path_refusal(plan, goal, reach))


def refuse(refusal: Refusal | None) -> None:
    """Raise the refusal, if it is one."""
    if refusal is not None:
        raise ProtocolError(ErrorCode.REFUSED, refusal.reason, refusal.field)


def stream_sample(params: ReferenceSet, now_s: float) -> StreamSample:
    """A reference from outside; without a stamp it counts as of now."""
    return StreamSample(
        stamp_s=now_s if params.stamp_s is None else params.stamp_s,
        position_ned_m=params.position,
        velocity_ned_m_s=params.velocity,
        acceleration_ned_m_s2=params.acceleration,
        jerk_ned_m_s3=params.jerk,
        yaw_rad=None if params.yaw_deg is None else radians(params.yaw_deg),
        yaw_rate_rad_s=None if params.yaw_rate_deg_s is None else radians(params.yaw_rate_deg_s),
    )


def stream_refusal(
    sample: StreamSample, before: StreamSample | None, limits: MotionLimits, fence: Geofence, now_s: float
) -> Refusal | None:
    """What is wrong with a reference from outside that comes after another one, or None."""
    senseless = _stamp_refusal(sample.stamp_s, now_s)
    if senseless is not None:
        return senseless
    found = sample_refusal(sample, before, limits)
    if found is not None:
        return Refusal(*found)
    outside = violation(fence, sample.position_ned_m)
    return None if outside is None else Refusal(f"position[{outside[0]}]", outside[1])


def carried_refusal(plan: Plan, limits: MotionLimits, fence: Geofence) -> Refusal | None:
    """What is wrong with a reference from outside that is carried on until its time-out and then braked, or None."""
    return reachability.way_refusal(plan, "position", reach_of(fence, limits))


def _stamp_refusal(stamp_s: float, now_s: float) -> Refusal | None:
    if now_s - STAMP_AGE_MAX_S <= stamp_s <= now_s + STAMP_AHEAD_MAX_S:
        return None
    return Refusal("stamp_s", f"{stamp_s - now_s:+.2f} s from now; it is CLOCK_MONOTONIC of this machine")


def external_pose(params: EstimatorPose, now_s: float) -> ExternalPose:
    """A pose from outside; without a stamp it counts as of now."""
    covariance = params.covariance
    return ExternalPose(
        stamp_s=now_s if params.stamp_s is None else params.stamp_s,
        position_ned_m=params.position,
        attitude_wb=frames.normalized(params.orientation),
        position_variance_m2=None if covariance is None else (covariance[0], covariance[1], covariance[2]),
        angle_variance_rad2=None if covariance is None else (covariance[3], covariance[4], covariance[5]),
    )


def pose_refusal(pose: ExternalPose, now_s: float) -> Refusal | None:
    """What is wrong with a pose from outside, or None; whether it fits the estimate is the filter's to say."""
    for index, metres in enumerate(pose.position_ned_m):
        if abs(metres) > PLACE_MAX_M:
            return Refusal(f"position[{index}]", f"{metres:g} m is not within {PLACE_MAX_M:g} m of the local origin")
    return _stamp_refusal(pose.stamp_s, now_s)
