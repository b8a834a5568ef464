"""Differential flatness of a multirotor: thrust vector and heading to attitude, jerk and yaw rate to body rates.

Source: Faessler, Franchi, Scaramuzza, Differential Flatness of Quadrotor Dynamics Subject to Rotor Drag (2018), here
in NED and FRD: thrust points against the body's z axis.
"""

from math import cos, hypot, sin

from daemon.control.parameters import HeadingAxis
from daemon.frames import cross, from_matrix, multiply, norm, rotate, rotate_inverse
from daemon.messages import ZERO3, Quat, Vec3

FREE_FALL_M_S2 = 1e-3  # a shorter thrust vector has no direction
_HEADING_MIN = 1e-6  # sine between heading and thrust axis, below which the heading says nothing


def is_isotropic(drag_1_s: Vec3) -> bool:
    """Whether the drag is the same along each axis, so that the attitude does not matter to it."""
    return drag_1_s[0] == drag_1_s[1] == drag_1_s[2]


def rotor_drag(attitude_wb: Quat, velocity_ned_m_s: Vec3, drag_1_s: Vec3) -> Vec3:
    """Acceleration by rotor drag, m/s2 NED: -R D R' v with D along the body axes."""
    dx, dy, dz = drag_1_s
    if is_isotropic(drag_1_s):
        return (-dx * velocity_ned_m_s[0], -dx * velocity_ned_m_s[1], -dx * velocity_ned_m_s[2])
    vx, vy, vz = rotate_inverse(attitude_wb, velocity_ned_m_s)
    return rotate(attitude_wb, (-dx * vx, -dy * vy, -dz * vz))


def attitude_from_thrust(
    thrust_ned_m_s2: Vec3, yaw_rad: float, attitude_now_wb: Quat, heading_axis: HeadingAxis = HeadingAxis.NOSE
) -> Quat:
    """Attitude whose thrust axis points along the thrust vector, with a heading; two singular cases have names.

    Free fall: no thrust is wanted, so any attitude serves; the attitude of now stays.
    Heading along the thrust axis: the vehicle stands on its side and the heading is undefined; the thrust axis is
    reached from the attitude of now by the shortest turn.
    """
    length = norm(thrust_ned_m_s2)
    if length < FREE_FALL_M_S2:
        return attitude_now_wb
    z = (-thrust_ned_m_s2[0] / length, -thrust_ned_m_s2[1] / length, -thrust_ned_m_s2[2] / length)
    c, s = cos(yaw_rad), sin(yaw_rad)
    square = cross((-s, c, 0.0), z) if heading_axis is HeadingAxis.NOSE else cross(z, (c, s, 0.0))
    sine = norm(square)
    if sine < _HEADING_MIN:
        return shortest_turn(attitude_now_wb, z)
    unit = (square[0] / sine, square[1] / sine, square[2] / sine)
    x, y = (unit, cross(z, unit)) if heading_axis is HeadingAxis.NOSE else (cross(unit, z), unit)
    return from_matrix(((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])))


def shortest_turn(attitude_wb: Quat, down_axis_ned: Vec3) -> Quat:
    """The attitude nearest to ``attitude_wb`` whose z axis is the unit vector ``down_axis_ned``."""
    bx, by, bz = rotate_inverse(attitude_wb, down_axis_ned)
    w = 1.0 + bz
    turn: Quat = (0.0, 1.0, 0.0, 0.0)  # exactly upside down: over the nose's axis
    if w > 1e-9:
        length = hypot(w, bx, by)
        turn = (w / length, -by / length, bx / length, 0.0)
    return multiply(attitude_wb, turn)


def thrust_rate(thrust_ned_m_s2: Vec3, thrust_derivative_ned_m_s3: Vec3) -> float:
    """Derivative of the thrust vector's length, m/s3; zero in free fall."""
    length = norm(thrust_ned_m_s2)
    if length < FREE_FALL_M_S2:
        return 0.0
    fx, fy, fz = thrust_ned_m_s2
    jx, jy, jz = thrust_derivative_ned_m_s3
    return (fx * jx + fy * jy + fz * jz) / length


def body_rates(
    attitude_wb: Quat,
    thrust_ned_m_s2: Vec3,
    thrust_derivative_ned_m_s3: Vec3,
    yaw_rad: float,
    yaw_rate_rad_s: float,
    heading_axis: HeadingAxis = HeadingAxis.NOSE,
) -> Vec3:
    """Body rates (FRD, rad/s) that turn the thrust axis with the thrust vector's derivative and the nose with the yaw.

    Free fall, and a heading along the axis that it is told by, give zero for what is undefined.
    """
    length = norm(thrust_ned_m_s2)
    if length < FREE_FALL_M_S2:
        return ZERO3
    jx, jy, _ = rotate_inverse(attitude_wb, thrust_derivative_ned_m_s3)
    roll_rate, pitch_rate = jy / length, -jx / length
    c, s = cos(yaw_rad), sin(yaw_rad)
    side = rotate_inverse(attitude_wb, (-s, c, 0.0))
    ahead = rotate_inverse(attitude_wb, (c, s, 0.0))
    # The nose stays square to the heading's side, or the right side to the heading: the products' derivatives are zero.
    if heading_axis is HeadingAxis.NOSE:
        turning, along = yaw_rate_rad_s * ahead[0] + pitch_rate * side[2], side[1]
    else:
        turning, along = yaw_rate_rad_s * side[1] + roll_rate * ahead[2], ahead[0]
    return (roll_rate, pitch_rate, turning / along if abs(along) >= _HEADING_MIN else 0.0)
