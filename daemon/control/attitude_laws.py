"""Attitude laws: attitude error to body rates, with one meaning of the time constant.

For a small error each law turns back with rate = error / time constant. Times are per body axis.
"""

from math import atan2, copysign, cos, hypot, sin

from daemon.frames import clamp, conjugate, multiply, norm, rotate_inverse
from daemon.messages import ZERO3, Quat, Vec3


def tilt_first(attitude_wb: Quat, desired_wb: Quat, heading_error_max_rad: float) -> Quat:
    """The desired attitude with its heading brought near, so that the error's tilt part keeps its direction.

    The error is a tilt followed by a turn about the thrust axis (Brescianini and D'Andrea 2018); only the turn is
    limited. Upside down to each other the turn is undefined and left out.
    """
    error = multiply(conjugate(attitude_wb), desired_wb)
    length = hypot(error[0], error[3])
    if length < 1e-9:
        return desired_wb
    turn_rad = 2.0 * atan2(copysign(1.0, error[0]) * error[3], abs(error[0]))
    excess_rad = clamp(turn_rad, -heading_error_max_rad, heading_error_max_rad) - turn_rad
    if excess_rad == 0.0:
        return desired_wb
    return multiply(desired_wb, (cos(0.5 * excess_rad), 0.0, 0.0, sin(0.5 * excess_rad)))


def quaternion(attitude_wb: Quat, desired_wb: Quat, time_constant_s: Vec3) -> Vec3:
    """Rates from the vector part of the error quaternion (Brescianini, Hehn, D'Andrea 2013), rad/s FRD."""
    w, x, y, z = multiply(conjugate(attitude_wb), desired_wb)
    twice = copysign(2.0, w)
    return (twice * x / time_constant_s[0], twice * y / time_constant_s[1], twice * z / time_constant_s[2])


def geometric(attitude_wb: Quat, desired_wb: Quat, time_constant_s: Vec3, *, original_gain: bool = False) -> Vec3:
    """Rates from the skew part of the error matrix (Lee, Leok, McClamroch 2010), rad/s FRD.

    vee(R_d' R - R' R_d) = -4 w (x, y, z) of the error quaternion; the original takes it whole, which is twice the
    gain of the quaternion law.
    """
    w, x, y, z = multiply(conjugate(attitude_wb), desired_wb)
    gain = 4.0 * w if original_gain else 2.0 * w
    return (gain * x / time_constant_s[0], gain * y / time_constant_s[1], gain * z / time_constant_s[2])


def jerk(attitude_wb: Quat, thrust_ned_m_s2: Vec3, jerk_ned_m_s3: Vec3) -> Vec3:
    """Rates that turn the thrust axis as a jerk turns the thrust vector (Lopez 2016), rad/s FRD; no yaw rate.

    Zero for a thrust vector without length.
    """
    length = norm(thrust_ned_m_s2)
    if length < 1e-3:
        return ZERO3
    ax, ay, az = thrust_ned_m_s2
    jx, jy, jz = jerk_ned_m_s3
    along = (ax * jx + ay * jy + az * jz) / length**3
    across = (jx / length - ax * along, jy / length - ay * along, jz / length - az * along)
    vx, vy, _ = rotate_inverse(attitude_wb, across)
    return (vy, -vx, 0.0)


def jerk_to(attitude_wb: Quat, thrust_ned_m_s2: Vec3, down_axis_ned: Vec3, time_constant_s: float) -> Vec3:
    """The jerk law's feedback: the jerk that brings the thrust vector of now to the wanted one in one time constant.

    The original differentiates the wanted vector over a tick and never sees the attitude, so that its error of tilt
    stays; here the difference is taken to what is flown.
    """
    length = norm(thrust_ned_m_s2)
    flown = (-length * down_axis_ned[0], -length * down_axis_ned[1], -length * down_axis_ned[2])
    difference = (
        (thrust_ned_m_s2[0] - flown[0]) / time_constant_s,
        (thrust_ned_m_s2[1] - flown[1]) / time_constant_s,
        (thrust_ned_m_s2[2] - flown[2]) / time_constant_s,
    )
    return jerk(attitude_wb, flown, difference)
