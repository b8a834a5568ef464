"""Paths through waypoints: stopping at each, or flying by."""

from bisect import bisect_left
from dataclasses import replace
from math import inf

from daemon.frames import clamp, from_yaw, norm, subtract, yaw_of
from daemon.guidance.brake import brake
from daemon.guidance.goals import WaypointGoal
from daemon.guidance.heading import HeadedPlan, HeadingWish, along_velocity
from daemon.guidance.jerk_limited import to_goal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.minimum_snap import MinimumSnapPlan, through
from daemon.guidance.plan import HoldPlan, Plan, SequencePlan
from daemon.guidance.waypoint_modes import Pose, WaypointMode, goal_pose
from daemon.messages import Reference, Vec3

_SPACINGS = (1.0, 0.4)  # of the guide points of a path to be flown by, in the order in which they are tried
_SLOWER = 1.15  # times the time with stops that flying by may take
_ASIDE = 0.25  # of its length that the curve may go aside of a leg,
_ASIDE_M = (0.25, 3.0)  # but at least and at most this far
_PLACE_FROM_NOW = (WaypointMode.ONLY_ORIENTATION, WaypointMode.XY_AND_YAW)


def waypoint_pose(start: Reference, goal: WaypointGoal, limits: MotionLimits) -> Pose:
    """The level pose that a waypoint means for a vehicle that flies ``start``.

    What the mode takes from now, it takes from where braking would end, so that a moving start does not turn back.
    """
    now = Pose(start.position_ned_m, from_yaw(start.yaw_rad))
    if goal.position_ned_m is None or goal.mode in _PLACE_FROM_NOW:
        now = Pose(brake(start, limits).target.position_ned_m, now.attitude_wb)
    wanted = Pose(
        now.position_ned_m if goal.position_ned_m is None else goal.position_ned_m,
        now.attitude_wb if goal.attitude_wb is None else from_yaw(yaw_of(goal.attitude_wb)),
    )
    return goal_pose(goal.mode, wanted, now)


def rest_after(plan: Plan, hold_s: float = 0.0) -> Reference:
    """Rest in a plan's target, ``hold_s`` after its end: the start of the next leg."""
    return replace(plan.target, time_s=plan.end_s + hold_s)


def legs_to(start: Reference, position_ned_m: Vec3, yaw_rad: float, limits: MotionLimits) -> tuple[Plan, ...]:
    """One leg to rest in a place, exactly and at a known time; two when the start has to be braked first.

    To a place too far for ruckig (more than 7600 s) there is no leg: the plan rests where it stops, without end.
    """
    direct = to_goal(start, position_ned_m, yaw_rad, limits)
    if direct is not None:
        return (direct,)
    stopped = brake(start, limits)
    onward = to_goal(rest_after(stopped), position_ned_m, yaw_rad, limits)
    return stopped, onward or HoldPlan(rest_after(stopped), inf)


def stop_path(start: Reference, waypoints: tuple[WaypointGoal, ...], limits: MotionLimits) -> Plan:
    """Time-optimal legs between waypoints, at rest for ``hold_s`` in each but the last; up to a leg without end.

    The last one's hold is not planned: it begins when the vehicle has converged.
    """
    legs: list[Plan] = []
    now = start
    for waypoint in waypoints:
        pose = waypoint_pose(now, waypoint, limits)
        legs += legs_to(now, pose.position_ned_m, yaw_of(pose.attitude_wb), limits)
        if legs[-1].end_s == inf:
            break
        now = rest_after(legs[-1], waypoint.hold_s)
    return SequencePlan(tuple(legs))


def fly_by_path(
    start: Reference, waypoints: tuple[WaypointGoal, ...], limits: MotionLimits, omega_yaw_rad_s: float
) -> Plan:
    """One minimum-snap path through the waypoints, from the flown state or, when that is quicker, after a brake.

    The waypoints are stopped at instead when no such path stays near the straight legs, or when it is clearly slower.
    """
    points = _points(start, waypoints, limits)
    stops = stop_path(start, tuple(replace(waypoint, hold_s=0.0) for waypoint in waypoints), limits)
    latest_s = start.time_s + _SLOWER * (stops.end_s - start.time_s)
    for spacing in _SPACINGS:
        found = _quickest(start, points, limits, spacing)
        if found is not None and found[1].end_s <= latest_s:
            path, snap = found
            return HeadedPlan(path, start, _headings(start, waypoints, snap), limits, omega_yaw_rad_s)
    return stop_path(start, waypoints, limits)


def _quickest(
    start: Reference, points: tuple[Vec3, ...], limits: MotionLimits, spacing: float
) -> tuple[Plan, MinimumSnapPlan] | None:
    """The quicker of flying on from the start and braking first, of those that stay near the legs, and its curve."""
    stopped = brake(start, limits)
    run_out_m = norm(subtract(stopped.target.position_ned_m, start.position_ned_m))
    ways: list[tuple[Plan, MinimumSnapPlan]] = []
    moving = through(start, points, limits, spacing)
    if moving is not None and _stays_near(moving, start, points, run_out_m):
        ways.append((moving, moving))
    resting = through(rest_after(stopped), points, limits, spacing) if stopped.end_s > start.time_s else None
    if resting is not None and _stays_near(resting, stopped.target, points, 0.0):
        ways.append((SequencePlan((stopped, resting)), resting))
    return min(ways, key=lambda way: way[1].end_s, default=None)


def _stays_near(snap: MinimumSnapPlan, start: Reference, points: tuple[Vec3, ...], run_out_m: float) -> bool:
    """Whether a curve goes aside of no leg by more than is allowed there, and on the first the start's own way."""
    begins = (start.position_ned_m, *points[:-1])
    allowed_m = [
        clamp(_ASIDE * norm(subtract(end, begin)), *_ASIDE_M) for begin, end in zip(begins, points, strict=True)
    ]
    allowed_m[0] += run_out_m
    return all(aside <= allowed for aside, allowed in zip(snap.aside_m(), allowed_m, strict=True))


def _points(start: Reference, waypoints: tuple[WaypointGoal, ...], limits: MotionLimits) -> tuple[Vec3, ...]:
    """Positions of the waypoints; what one takes from now it takes from the one before it."""
    points: list[Vec3] = []
    now = start
    for waypoint in waypoints:
        points.append(waypoint_pose(now, waypoint, limits).position_ned_m)
        now = Reference(start.time_s, points[-1], yaw_rad=start.yaw_rad)
    return tuple(points)


def _headings(start: Reference, waypoints: tuple[WaypointGoal, ...], path: MinimumSnapPlan) -> HeadingWish:
    """On the way to each waypoint its heading, or the last one given; along the velocity for ``forward_heading``."""
    yaws: list[float | None] = []
    yaw_rad = start.yaw_rad
    for waypoint in waypoints:
        if waypoint.attitude_wb is not None and waypoint.mode is not WaypointMode.ONLY_POSITION:
            yaw_rad = yaw_of(waypoint.attitude_wb)
        yaws.append(None if waypoint.mode is WaypointMode.FORWARD_HEADING else yaw_rad)

    def wish(reference: Reference) -> float | None:
        yaw = yaws[min(bisect_left(path.passes_s, reference.time_s), len(yaws) - 1)]
        return along_velocity(reference) if yaw is None else yaw

    return wish
