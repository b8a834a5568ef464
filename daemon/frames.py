"""The one owner of rotations and frames.

Conventions, everywhere in the daemon:

- world: local NED (x north, y east, z down); body: FRD (x forward, y right, z down);
- quaternions Hamilton ``(w, x, y, z)``, body to world: ``v_world = rotate(attitude_wb, v_body)``;
- composition reads left to right from world to body: ``q_wc = multiply(q_wb, q_bc)``;
- yaw is clockwise from north seen from above, roll-pitch-yaw is the intrinsic z-y-x sequence;
- angles in radians, wrapped to [-pi, pi).

ENU/FLU and WGS84 exist at the edges only; the functions that cross say so in their names.
Three numbers are quicker as unpacked floats than as numpy arrays, hence the tuples.
"""

from collections.abc import Callable
from functools import partial
from math import asin, atan2, copysign, cos, dist, hypot, isfinite, pi, sin, sqrt
from typing import cast

from daemon.messages import GlobalPosition, Quat, Vec3

_SMALL_ANGLE_RAD = 1e-6  # below it the Taylor branch of exp and log is exact to double precision


def add(a: Vec3, b: Vec3) -> Vec3:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, factor: float) -> Vec3:
    """a times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a: Vec3, b: Vec3) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


norm: Callable[[Vec3], float] = partial(dist, (0.0, 0.0, 0.0))
"""Euclidean length; does not overflow. The distance from nothing, because that is one call without a Python frame."""


def clip_norm(a: Vec3, limit: float) -> Vec3:
    """The vector, shortened to ``limit`` when it is longer."""
    length = norm(a)
    return a if length <= limit else scale(a, limit / length)


def clamp(value: float, low: float, high: float) -> float:
    """The value within [low, high]."""
    return low if value < low else high if value > high else value


def is_finite(values: tuple[float, ...]) -> bool:
    """True when no number is NaN or infinite."""
    return all(map(isfinite, values))


def wrap_pi(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    if -pi <= angle_rad < pi:
        return angle_rad
    wrapped = (angle_rad + pi) % (2.0 * pi) - pi
    return -pi if wrapped >= pi else wrapped


def normalized(q: Quat) -> Quat:
    """Unit quaternion of the same direction. The norm must not be zero."""
    length = hypot(*q)
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def conjugate(q: Quat) -> Quat:
    """Inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def multiply(a: Quat, b: Quat) -> Quat:
    """Hamilton product a b."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotate(q: Quat, v: Vec3) -> Vec3:
    """Turn a vector: body to world for ``attitude_wb``."""
    w, x, y, z = q
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def rotate_inverse(q: Quat, v: Vec3) -> Vec3:
    """Turn a vector back: world to body for ``attitude_wb``."""
    w, x, y, z = q
    tx = 2.0 * (z * v[1] - y * v[2])
    ty = 2.0 * (x * v[2] - z * v[0])
    tz = 2.0 * (y * v[0] - x * v[1])
    return (
        v[0] + w * tx - y * tz + z * ty,
        v[1] + w * ty - z * tx + x * tz,
        v[2] + w * tz - x * ty + y * tx,
    )


def exp(rotation_vector_rad: Vec3) -> Quat:
    """Unit quaternion of a rotation vector."""
    angle = norm(rotation_vector_rad)
    factor = 0.5 - angle * angle / 48.0 if angle < _SMALL_ANGLE_RAD else sin(0.5 * angle) / angle
    return (
        cos(0.5 * angle),
        rotation_vector_rad[0] * factor,
        rotation_vector_rad[1] * factor,
        rotation_vector_rad[2] * factor,
    )


def log(q: Quat) -> Vec3:
    """Rotation vector of a unit quaternion, of length at most pi (the shorter way)."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    length = hypot(x, y, z)
    factor = 2.0 / w if length < _SMALL_ANGLE_RAD else 2.0 * atan2(length, w) / length
    return (x * factor, y * factor, z * factor)


def integrate(q: Quat, rates_frd_rad_s: Vec3, dt_s: float) -> Quat:
    """Attitude after turning with constant body rates for ``dt_s``."""
    angle = norm(rates_frd_rad_s) * abs(dt_s)
    factor = dt_s * (0.5 - angle * angle / 48.0 if angle < _SMALL_ANGLE_RAD else sin(0.5 * angle) / angle)
    x, y, z = rates_frd_rad_s
    return normalized(multiply(q, (cos(0.5 * angle), x * factor, y * factor, z * factor)))


def angle_between(a: Quat, b: Quat) -> float:
    """Angle of the rotation from a to b, in [0, pi]."""
    return norm(log(multiply(conjugate(a), b)))


def from_yaw(yaw_rad: float) -> Quat:
    """Level attitude with a heading."""
    return (cos(0.5 * yaw_rad), 0.0, 0.0, sin(0.5 * yaw_rad))


def from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quat:
    """Attitude from intrinsic z-y-x angles."""
    cr, sr = cos(0.5 * roll_rad), sin(0.5 * roll_rad)
    cp, sp = cos(0.5 * pitch_rad), sin(0.5 * pitch_rad)
    cy, sy = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_rpy(q: Quat) -> Vec3:
    """Roll, pitch, yaw in radians; at the poles of pitch roll is put to zero."""
    w, x, y, z = q
    sin_pitch = 2.0 * (w * y - x * z)
    if abs(sin_pitch) > 1.0 - 1e-12:
        return (0.0, copysign(0.5 * pi, sin_pitch), wrap_pi(2.0 * atan2(z, w)))
    roll = atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return (roll, asin(sin_pitch), yaw_of(q))


def yaw_of(q: Quat) -> float:
    """Heading of the body's x axis in the horizontal plane, radians."""
    w, x, y, z = q
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tilt_of(q: Quat) -> float:
    """Angle between the body's z axis and the vertical, in [0, pi]."""
    return 2.0 * atan2(hypot(q[1], q[2]), hypot(q[0], q[3]))


def down_axis(q: Quat) -> Vec3:
    """The body's z axis (down; thrust points against it) in the world."""
    w, x, y, z = q
    return (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))


def rotate_about_down(v_ned: Vec3, yaw_rad: float) -> Vec3:
    """Turn a world vector by a heading change."""
    c, s = cos(yaw_rad), sin(yaw_rad)
    return (c * v_ned[0] - s * v_ned[1], s * v_ned[0] + c * v_ned[1], v_ned[2])


Matrix3 = tuple[Vec3, Vec3, Vec3]


def to_matrix(q: Quat) -> Matrix3:
    """Rotation matrix by rows, body to world for ``attitude_wb``."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(m: Matrix3) -> Quat:
    """Unit quaternion, w >= 0, of a rotation matrix by rows (the largest of the four components first)."""
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = m
    trace = m00 + m11 + m22
    candidates = (trace, m00, m11, m22)
    largest = candidates.index(max(candidates))
    if largest == 0:
        q = (1.0 + trace, m21 - m12, m02 - m20, m10 - m01)
    elif largest == 1:
        q = (m21 - m12, 1.0 + m00 - m11 - m22, m01 + m10, m02 + m20)
    elif largest == 2:
        q = (m02 - m20, m01 + m10, 1.0 - m00 + m11 - m22, m12 + m21)
    else:
        q = (m10 - m01, m02 + m20, m12 + m21, 1.0 - m00 - m11 + m22)
    if q[0] < 0.0:
        q = (-q[0], -q[1], -q[2], -q[3])
    return normalized(q)


def ned_from_enu(v_enu: Vec3) -> Vec3:
    """East-north-up to north-east-down (its own inverse)."""
    return (v_enu[1], v_enu[0], -v_enu[2])


_HALF = sqrt(0.5)
_NED_FROM_ENU: Quat = (0.0, _HALF, _HALF, 0.0)
_FRD_FROM_FLU: Quat = (0.0, 1.0, 0.0, 0.0)


def attitude_ned_from_enu(attitude_enu_flu: Quat) -> Quat:
    """FLU-to-ENU attitude as FRD-to-NED attitude, w >= 0."""
    return attitude_ned_from_enu_frd(multiply(attitude_enu_flu, _FRD_FROM_FLU))


def attitude_ned_from_enu_frd(attitude_enu_frd: Quat) -> Quat:
    """FRD-to-ENU attitude as FRD-to-NED attitude, w >= 0."""
    q = multiply(_NED_FROM_ENU, attitude_enu_frd)
    return q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


def yaw_ned_from_enu(yaw_enu_rad: float) -> float:
    """Counter-clockwise from east to clockwise from north (its own inverse)."""
    return wrap_pi(0.5 * pi - yaw_enu_rad)


def ned_from_global(position: GlobalPosition, origin: GlobalPosition) -> Vec3:
    """WGS84 to local NED about ``origin``, metres. Altitudes above mean sea level: the geoid is taken as level here."""
    import pymap3d

    return cast(
        Vec3,
        tuple(
            float(v)
            for v in pymap3d.geodetic2ned(
                position.latitude_deg,
                position.longitude_deg,
                position.altitude_amsl_m,
                origin.latitude_deg,
                origin.longitude_deg,
                origin.altitude_amsl_m,
            )
        ),
    )
