"""From a goal as it came over the socket to an order for the trajectory task: frames, units, reachability."""

from collections.abc import Callable
from dataclasses import dataclass
from math import radians

from daemon import frames
from daemon.goals import schema
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import GoalSubmit
from daemon.guidance import planner
from daemon.guidance.convergence import Convergence, Threshold, Tolerance
from daemon.guidance.goals import Goal, HoldGoal, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.loops.trajectory_task import GoalOrder
from daemon.messages import AutopilotStatus, GlobalPosition, Quat, Reference, Vec3
from daemon.safety.geofence import Geofence, violation

OUTLINE = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where the vehicle is and what bounds it when a goal is accepted; a plan starts from ``flown``."""

    flown: Reference
    status: AutopilotStatus
    fence: Geofence
    max_distance_m: float
    limits: MotionLimits
    parameters: GuidanceParameters


def order(goal_id: str, params: GoalSubmit, place: Place) -> GoalOrder:
    """The order of a goal. Raises ``ProtocolError`` with field and reason when it cannot be flown."""
    kind, goal, resolve = _goal(params, place)
    limits = _tightened(place.limits, params.limits)
    _check_reach(goal, kind, limits, place)
    return GoalOrder(goal_id=goal_id, kind=kind, goal=goal, limits=limits, timeout_s=params.timeout_s, resolve=resolve)


def moved(old: GoalOrder, waypoint: schema.Waypoint, place: Place) -> GoalOrder:
    """The order of an active goal, moved to another waypoint with its limits and its time-out."""
    goal, resolve = _waypoint(waypoint, "waypoint", place)
    _check_reach(goal, "waypoint", old.limits, place)
    return GoalOrder(
        goal_id=old.goal_id, kind="waypoint", goal=goal, limits=old.limits, timeout_s=old.timeout_s, resolve=resolve
    )


Resolve = Callable[[AutopilotStatus], Goal] | None


def _goal(params: GoalSubmit, place: Place) -> tuple[str, Goal, Resolve]:
    if params.waypoint is not None:
        goal, resolve = _waypoint(params.waypoint, "waypoint", place)
        return "waypoint", goal, resolve
    if params.trajectory is not None and params.trajectory.kind == "hold":
        return "trajectory", HoldGoal(duration_s=params.trajectory.duration_s), None
    given = "path" if params.path is not None else "trajectory" if params.trajectory is not None else "stream"
    raise ProtocolError(ErrorCode.REFUSED, "this daemon does not fly goals of this kind yet", given)


def _waypoint(waypoint: schema.Waypoint, field: str, place: Place) -> tuple[WaypointGoal, Resolve]:
    def make(status: AutopilotStatus) -> WaypointGoal:
        return WaypointGoal(
            position_ned_m=_position(waypoint, field, place, status),
            attitude_wb=_attitude(waypoint, place),
            mode=WaypointMode(waypoint.mode),
            convergence=_convergence(waypoint),
            hold_s=waypoint.hold_s,
        )

    return make(place.status), make if waypoint.frame == "global" else None


def _position(waypoint: schema.Waypoint, field: str, place: Place, status: AutopilotStatus) -> Vec3 | None:
    position = waypoint.position
    if position is None:
        return None
    if waypoint.frame == "local_enu":
        return frames.ned_from_enu(position)
    if waypoint.frame == "body_frd":
        ahead = frames.rotate_about_down(position, place.flown.yaw_rad)
        return frames.add(place.flown.position_ned_m, ahead)
    if waypoint.frame == "global":
        if status.global_origin is None:
            reason = "the autopilot has not told where its local frame lies on the globe"
            raise ProtocolError(ErrorCode.WRONG_STATE, reason, f"{field}.frame")
        return frames.ned_from_global(GlobalPosition(*position), status.global_origin)
    return position


def _attitude(waypoint: schema.Waypoint, place: Place) -> Quat | None:
    if waypoint.orientation is not None:
        q = frames.normalized(waypoint.orientation)
        if waypoint.frame == "local_enu":
            return frames.attitude_ned_from_enu(q)
        if waypoint.frame == "body_frd":
            return frames.multiply(frames.from_yaw(place.flown.yaw_rad), q)
        return q
    if waypoint.yaw_deg is None:
        return None
    yaw = radians(waypoint.yaw_deg)
    if waypoint.frame == "local_enu":
        yaw = frames.yaw_ned_from_enu(yaw)
    elif waypoint.frame == "body_frd":
        yaw += place.flown.yaw_rad
    return frames.from_yaw(frames.wrap_pi(yaw))


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
    return limits.tightened(
        speed_m_s=wanted.speed_m_s,
        acceleration_m_s2=wanted.acceleration_m_s2,
        jerk_m_s3=wanted.jerk_m_s3,
        yaw_rate_rad_s=None if wanted.yaw_rate_deg_s is None else radians(wanted.yaw_rate_deg_s),
    )


def _check_reach(goal: Goal, kind: str, limits: MotionLimits, place: Place) -> None:
    """The goal and the path to it lie inside the fence and within reach."""
    field = f"{kind}.position"
    position = goal.position_ned_m if isinstance(goal, WaypointGoal) else None
    if position is not None:
        distance_m = frames.norm(frames.subtract(position, place.flown.position_ned_m))
        if not distance_m <= place.max_distance_m:
            reason = f"is {distance_m:.0f} m away; at most {place.max_distance_m:g} m are allowed"
            raise ProtocolError(ErrorCode.REFUSED, reason, field)
        _check_fence(place.fence, position, field, "")
    plan = planner.plan(place.flown, goal, limits, place.parameters)
    if violation(place.fence, place.flown.position_ned_m) is None:
        for reference in plan.outline(OUTLINE):
            _check_fence(place.fence, reference.position_ned_m, field, "on the way: ")


def _check_fence(fence: Geofence, position: Vec3, field: str, where: str) -> None:
    found = violation(fence, position)
    if found is not None:
        axis, reason = found
        raise ProtocolError(ErrorCode.REFUSED, f"{where}{reason}", f"{field}[{axis}]")
