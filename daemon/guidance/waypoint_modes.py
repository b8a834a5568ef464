"""The six waypoint modes of the reference filter: which pose is the goal, and which error counts.

Source: the reference filter's action of vortex-auv, one fault mended: a goal straight above or below keeps the heading
of now in ``forward_heading``.
"""

from dataclasses import dataclass
from enum import Enum
from math import asin, atan2, hypot

from daemon.frames import conjugate, from_yaw, multiply, norm, subtract, yaw_of
from daemon.messages import Quat, Vec3

_STRAIGHT_UP_M = 1e-6  # horizontal distance below which a goal has no direction


class WaypointMode(Enum):
    """What a waypoint determines."""

    FULL_POSE = "full_pose"
    ONLY_POSITION = "only_position"
    FORWARD_HEADING = "forward_heading"
    ONLY_ORIENTATION = "only_orientation"
    POSITION_AND_YAW = "position_and_yaw"
    XY_AND_YAW = "xy_and_yaw"


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Position in NED, metres, and attitude, body to world."""

    position_ned_m: Vec3
    attitude_wb: Quat


@dataclass(frozen=True, slots=True)
class PoseError:
    """What is left to a goal as the mode counts it: distance, angle, and both in one norm.

    ``combined`` holds 2 sin of half the angle beside the metres, as the original's threshold does.
    """

    position_m: float
    angle_rad: float
    combined: float


def goal_pose(mode: WaypointMode, wanted: Pose, now: Pose) -> Pose:
    """The pose that a waypoint stands for, seen from the pose of now."""
    if mode is WaypointMode.FULL_POSE:
        return wanted
    if mode is WaypointMode.ONLY_POSITION:
        return Pose(wanted.position_ned_m, now.attitude_wb)
    if mode is WaypointMode.ONLY_ORIENTATION:
        return Pose(now.position_ned_m, wanted.attitude_wb)
    if mode is WaypointMode.FORWARD_HEADING:
        dx, dy, _ = subtract(wanted.position_ned_m, now.position_ned_m)
        yaw = atan2(dy, dx) if hypot(dx, dy) > _STRAIGHT_UP_M else yaw_of(now.attitude_wb)
        return Pose(wanted.position_ned_m, from_yaw(yaw))
    level = from_yaw(yaw_of(wanted.attitude_wb))
    if mode is WaypointMode.POSITION_AND_YAW:
        return Pose(wanted.position_ned_m, level)
    return Pose((wanted.position_ned_m[0], wanted.position_ned_m[1], now.position_ned_m[2]), level)


def pose_error(mode: WaypointMode, measured: Pose, goal: Pose) -> PoseError:
    """Error of a measured pose against the goal's, of the axes that the mode determines.

    The vector part of the turn between them, ``q_measured^-1 q_goal``, or the z part of it, is sin of half the angle.
    """
    ex, ey, ez = subtract(measured.position_ned_m, goal.position_ned_m)
    turn = multiply(conjugate(measured.attitude_wb), goal.attitude_wb)
    position, half_sine = norm((ex, ey, ez)), abs(turn[3])
    if mode is WaypointMode.FULL_POSE:
        half_sine = norm(turn[1:])
    elif mode is WaypointMode.ONLY_POSITION:
        half_sine = 0.0
    elif mode is WaypointMode.ONLY_ORIENTATION:
        position, half_sine = 0.0, norm(turn[1:])
    elif mode is WaypointMode.XY_AND_YAW:
        position = hypot(ex, ey)
    return PoseError(position, 2.0 * asin(min(1.0, half_sine)), hypot(position, 2.0 * half_sine))
