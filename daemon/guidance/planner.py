"""The way in: from a flown reference and a goal to a plan."""

from daemon.frames import from_yaw, yaw_of
from daemon.guidance.brake import brake
from daemon.guidance.filter_plan import FilterPlan
from daemon.guidance.goals import Goal, HoldGoal, WaypointGoal
from daemon.guidance.jerk_limited import to_goal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.plan import Plan
from daemon.guidance.waypoint_modes import Pose, WaypointMode, goal_pose
from daemon.messages import Reference

_PLACE_FROM_NOW = (WaypointMode.ONLY_ORIENTATION, WaypointMode.XY_AND_YAW)


def plan(start: Reference, goal: Goal, limits: MotionLimits, parameters: GuidanceParameters) -> Plan:
    """The plan from ``start`` (the reference being flown, now) to a goal; p, v, a and heading continue the start's.

    The goal is expected to have passed ``reachability``.
    """
    if isinstance(goal, HoldGoal):
        return brake(start, limits)
    pose = waypoint_pose(start, goal, limits)
    yaw = yaw_of(pose.attitude_wb)
    if parameters.profile is Profile.JERK_LIMITED:
        found = to_goal(start, pose.position_ned_m, yaw, limits)
        if found is not None:
            return found
    return FilterPlan(start, pose.position_ned_m, yaw, limits, parameters)


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
