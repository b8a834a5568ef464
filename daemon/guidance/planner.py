"""The way in: from a flown reference and a goal to a plan."""

from dataclasses import replace
from math import pi

from daemon.frames import scale, wrap_pi, yaw_of
from daemon.guidance.brake import brake
from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.goals import (
    Goal,
    HoldGoal,
    PathGoal,
    PolynomialGoal,
    ShapeGoal,
    Through,
    WaypointGoal,
)
from daemon.guidance.heading import HeadedPlan, VelocityHeading, along_velocity, turn_s, wish_of
from daemon.guidance.jerk_limited import to_goal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.path import fly_by_path, legs_to, rest_after, stop_path, waypoint_pose
from daemon.guidance.plan import HoldPlan, Plan, SequencePlan
from daemon.guidance.polynomial import PolynomialPlan
from daemon.guidance.shapes import ShapePlan, entry_phase
from daemon.guidance.waypoint_modes import WaypointMode
from daemon.messages import Reference


def plan(start: Reference, goal: Goal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    """The plan from ``start`` (the reference being flown, now) to a goal; p, v, a and heading continue the start's.

    The goal is expected to have passed ``reachability``. A stream brakes until its first reference comes.
    """
    if parameters.velocity_yaw:
        goal = _without_heading(goal)
    if isinstance(goal, WaypointGoal):
        return _waypoint(start, goal, limits, parameters)
    if isinstance(goal, PathGoal):
        return _path(start, goal, limits, parameters)
    if isinstance(goal, ShapeGoal):
        return _shape(start, goal, limits, parameters)
    if isinstance(goal, PolynomialGoal):
        return _polynomial(start, goal, limits, parameters)
    stopped = brake(start, limits)
    if isinstance(goal, HoldGoal):
        return SequencePlan((stopped, HoldPlan(rest_after(stopped), goal.duration_s)))
    return stopped


def _without_heading(goal: Goal) -> Goal:
    """The goal without a heading of its own; a goal that is a mere turn keeps it."""
    if isinstance(goal, WaypointGoal):
        return goal if goal.mode is WaypointMode.ONLY_ORIENTATION else replace(goal, attitude_wb=None)
    if isinstance(goal, PathGoal):
        return replace(goal, waypoints=tuple(replace(waypoint, attitude_wb=None) for waypoint in goal.waypoints))
    if isinstance(goal, ShapeGoal | PolynomialGoal):
        return replace(goal, heading=VelocityHeading())
    return goal


def _waypoint(start: Reference, goal: WaypointGoal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    pose = waypoint_pose(start, goal, limits)
    yaw = yaw_of(pose.attitude_wb)
    found: Plan | None = None
    if parameters.profile is Profile.JERK_LIMITED:
        found = to_goal(start, pose.position_ned_m, yaw, limits)
    if found is None:
        found = FilterPlan(start, pose.position_ned_m, yaw, limits, parameters)
    return found if goal.mode is WaypointMode.ONLY_ORIENTATION else _headed(found, start, limits, parameters)


def _path(start: Reference, goal: PathGoal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    if goal.through is Through.FLY_BY:
        found = fly_by_path(start, goal.waypoints, limits, parameters.omega_yaw_rad_s)
    else:
        found = stop_path(start, goal.waypoints, limits)
    return _headed(found, start, limits, parameters)


def _headed(found: Plan, start: Reference, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    """The plan as it is, or with its heading along the velocity where that is asked for."""
    if not parameters.velocity_yaw:
        return found
    return HeadedPlan(found, start, along_velocity, limits, parameters.omega_yaw_rad_s)


def _shape(start: Reference, goal: ShapeGoal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    """To rest in the shape's nearest point, turning to its first heading in time, or waiting for that; then around."""
    stop = brake(start, limits).target.position_ned_m
    entry_rad = entry_phase(goal.shape, stop)
    place, along, *_ = goal.shape.at(entry_rad)
    legs = legs_to(start, place, start.yaw_rad, limits)
    there, omega_rad_s = rest_after(legs[-1]), parameters.omega_yaw_rad_s
    wish = wish_of(goal.heading, goal.shape.center_ned_m, start.yaw_rad)
    first_rad = wish(replace(there, velocity_ned_m_s=scale(along, goal.rate_rad_s)))
    turning_s = 0.0 if first_rad is None else turn_s(wrap_pi(first_rad - start.yaw_rad), 0.0, omega_rad_s, limits)
    turn_from_s = max(start.time_s, there.time_s - turn_s(pi, 0.0, omega_rad_s, limits))
    wait = HoldPlan(there, max(0.0, turn_from_s + turning_s - there.time_s))
    around = ShapePlan(rest_after(wait), goal.shape, entry_rad, goal.rate_rad_s, goal.turns, limits)

    def turned_first(reference: Reference) -> float | None:
        if first_rad is not None and turn_from_s <= reference.time_s <= around.start_s:
            return first_rad
        return wish(reference)

    return HeadedPlan(SequencePlan((*legs, wait, around)), start, turned_first, limits, omega_rad_s)


def _polynomial(start: Reference, goal: PolynomialGoal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    """The constant jerk, then a brake."""
    pushed = PolynomialPlan(start, goal.jerk_ned_m_s3, goal.duration_s)
    path = SequencePlan((pushed, brake(pushed.target, limits)))
    wish = wish_of(goal.heading, path.target.position_ned_m, start.yaw_rad)
    return HeadedPlan(path, start, wish, limits, parameters.omega_yaw_rad_s)
