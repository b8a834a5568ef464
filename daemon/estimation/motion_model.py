"""Constant-acceleration motion of a body in six degrees of freedom: the model behind the Kalman filters.

State of 15, as robot_localization orders it (Moore, Stouch 2014): position, roll-pitch-yaw, velocity in the body,
angular velocity in the body, acceleration in the body. The equations know no gravity and hold for any pair of frames
joined by ``R = Rz(yaw) Ry(pitch) Rx(roll)``: FRD in NED here, FLU in ENU there. ``d/dt v = a`` leaves the turning of
the body out (``w x v``): whoever knows the acceleration in the world subtracts it, see ``filter_control``.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import copysign, cos, sin

import numpy as np
from numpy.typing import NDArray

from daemon.frames import wrap_pi

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

STATE_SIZE = 15
POSE_SIZE = 6
TWIST_SIZE = 6
_MIN_COS_PITCH = 1e-3  # nearer than 0.06 deg to the pole Euler rates are cut off rather than infinite


class Member(IntEnum):
    """Places in the state vector."""

    X = 0
    Y = 1
    Z = 2
    ROLL = 3
    PITCH = 4
    YAW = 5
    VX = 6
    VY = 7
    VZ = 8
    VROLL = 9
    VPITCH = 10
    VYAW = 11
    AX = 12
    AY = 13
    AZ = 14


ANGLES = (Member.ROLL, Member.PITCH, Member.YAW)
_IDENTITY = np.eye(STATE_SIZE)
_IDENTITY.flags.writeable = False


class _Rotation:
    """Sines, cosines and body-to-world rows of one attitude."""

    __slots__ = ("axis_pitch", "cos_pitch", "cos_roll", "rows", "sin_pitch", "sin_roll")

    def __init__(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> None:
        sr, cr = sin(roll_rad), cos(roll_rad)
        sp, cp = sin(pitch_rad), cos(pitch_rad)
        sy, cy = sin(yaw_rad), cos(yaw_rad)
        self.rows = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        self.axis_pitch = (-sy, cy)  # horizontal axis about which pitch turns
        self.sin_roll, self.cos_roll, self.sin_pitch = sr, cr, sp
        self.cos_pitch = cp if abs(cp) > _MIN_COS_PITCH else copysign(_MIN_COS_PITCH, cp)


def project(x: Sequence[float], dt_s: float) -> list[float]:
    """State of 15 after ``dt_s`` with constant acceleration and angular velocity; angles wrapped."""
    rotation = _Rotation(x[3], x[4], x[5])
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.rows
    sx, sy, sz = _displacement(x, dt_s)
    wx, wy, wz = x[9], x[10], x[11]
    about_z = (rotation.sin_roll * wy + rotation.cos_roll * wz) / rotation.cos_pitch
    return [
        x[0] + r00 * sx + r01 * sy + r02 * sz,
        x[1] + r10 * sx + r11 * sy + r12 * sz,
        x[2] + r20 * sx + r21 * sy + r22 * sz,
        wrap_pi(x[3] + (wx + rotation.sin_pitch * about_z) * dt_s),
        wrap_pi(x[4] + (rotation.cos_roll * wy - rotation.sin_roll * wz) * dt_s),
        wrap_pi(x[5] + about_z * dt_s),
        x[6] + x[12] * dt_s,
        x[7] + x[13] * dt_s,
        x[8] + x[14] * dt_s,
        *x[9:15],
    ]


def jacobian(x: Sequence[float], dt_s: float) -> Matrix:
    """Derivative of ``project`` by the state, 15 x 15."""
    rotation = _Rotation(x[3], x[4], x[5])
    rows = np.array(rotation.rows)
    F = _IDENTITY.copy()
    F[0:3, 3:6] = _position_by_angles(rotation, _displacement(x, dt_s))
    F[0:3, 6:9] = rows * dt_s
    F[0:3, 12:15] = rows * (0.5 * dt_s * dt_s)
    F[3:6, 3:5] += _angles_by_angles(rotation, x[10] * dt_s, x[11] * dt_s)
    F[3:6, 9:12] = _angles_by_rates(rotation, dt_s)
    F[6, 12] = F[7, 13] = F[8, 14] = dt_s
    return F


def _displacement(x: Sequence[float], dt_s: float) -> tuple[float, float, float]:
    half = 0.5 * dt_s
    return (
        (x[6] + x[12] * half) * dt_s,
        (x[7] + x[13] * half) * dt_s,
        (x[8] + x[14] * half) * dt_s,
    )


def _position_by_angles(rotation: _Rotation, s: tuple[float, float, float]) -> list[list[float]]:
    """Each angle turns the displacement about its own axis: x of the body, the line of nodes, z of the world."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.rows
    px = r00 * s[0] + r01 * s[1] + r02 * s[2]
    py = r10 * s[0] + r11 * s[1] + r12 * s[2]
    pz = r20 * s[0] + r21 * s[1] + r22 * s[2]
    ax, ay = rotation.axis_pitch
    return [
        [r02 * s[1] - r01 * s[2], ay * pz, -py],
        [r12 * s[1] - r11 * s[2], -ax * pz, px],
        [r22 * s[1] - r21 * s[2], ax * py - ay * px, 0.0],
    ]


def _angles_by_angles(rotation: _Rotation, turn_y: float, turn_z: float) -> list[list[float]]:
    secant = 1.0 / rotation.cos_pitch
    tangent = rotation.sin_pitch * secant
    about_y = rotation.cos_roll * turn_y - rotation.sin_roll * turn_z
    about_z = rotation.sin_roll * turn_y + rotation.cos_roll * turn_z
    return [
        [about_y * tangent, about_z * secant * secant],
        [-about_z, 0.0],
        [about_y * secant, about_z * tangent * secant],
    ]


def _angles_by_rates(rotation: _Rotation, dt_s: float) -> list[list[float]]:
    sr, cr = rotation.sin_roll * dt_s, rotation.cos_roll * dt_s
    secant = 1.0 / rotation.cos_pitch
    tangent = rotation.sin_pitch * secant
    return [
        [dt_s, sr * tangent, cr * tangent],
        [0.0, cr, -sr],
        [0.0, sr * secant, cr * secant],
    ]
