"""Gyro, accelerometer, magnetometer and GPS as they read: truth plus the noise of PX4's SIH, flying and at rest."""

from collections.abc import Iterator
from math import cos, radians

from daemon.frames import rotate_inverse
from daemon.messages import GlobalPosition, Vec3
from daemon.sim.vehicle import VehicleState

# Standard deviations per sample, rad/s and m/s^2 (``Sih::reconstruct_sensors_signals``)
_GYRO_FLYING = (0.14, 0.07, 0.03)
_GYRO_REST = 0.01
_ACCELEROMETER_FLYING = (0.5, 1.7, 1.4)
_ACCELEROMETER_REST = 0.1
_IMU_SHARE = 0.71  # HIGHRES_IMU is the mean of two samples (recorded)
_MAGNETIC_FIELD_NED_GAUSS = (0.2155, 0.0136, 0.4280)
_MAGNETOMETER_STD_GAUSS = 0.012
_EARTH_RADIUS_M = 6371000.0  # PX4 projects on a sphere (MapProjection)


class Sensors:
    """Without noise the readings are exact. ``draw``: for the gyro, each step; ``draw_imu``: for what is sent."""

    def __init__(self, draw: Iterator[float], draw_imu: Iterator[float], *, noise: bool) -> None:
        self._draw = draw
        self._draw_imu = draw_imu
        self._noise = noise

    def gyro(self, truth: VehicleState) -> Vec3:
        """One raw gyro sample, rad/s (FRD)."""
        p, q, r = truth.rates_frd_rad_s
        if not self._noise:
            return (p, q, r)
        draw = self._draw
        sx, sy, sz = (_GYRO_REST, _GYRO_REST, _GYRO_REST) if truth.on_ground else _GYRO_FLYING
        return (p + sx * next(draw), q + sy * next(draw), r + sz * next(draw))

    def imu(self, truth: VehicleState) -> tuple[Vec3, Vec3, Vec3]:
        """Specific force (m/s^2), angular rate (rad/s), magnetic field (gauss), FRD, as HIGHRES_IMU has them."""
        force, rates = truth.specific_force_frd_m_s2, truth.rates_frd_rad_s
        field = rotate_inverse(truth.attitude_wb, _MAGNETIC_FIELD_NED_GAUSS)
        if not self._noise:
            return force, rates, field
        resting = truth.on_ground
        return (
            self._noisy(force, (_ACCELEROMETER_REST,) * 3 if resting else _ACCELEROMETER_FLYING, _IMU_SHARE),
            self._noisy(rates, (_GYRO_REST,) * 3 if resting else _GYRO_FLYING, _IMU_SHARE),
            self._noisy(field, (_MAGNETOMETER_STD_GAUSS,) * 3, 1.0),
        )

    def _noisy(self, value: Vec3, std: Vec3, share: float) -> Vec3:
        draw = self._draw_imu
        return (
            value[0] + std[0] * share * next(draw),
            value[1] + std[1] * share * next(draw),
            value[2] + std[2] * share * next(draw),
        )


def global_of(position_ned_m: Vec3, home: GlobalPosition) -> GlobalPosition:
    """Latitude, longitude, altitude on PX4's sphere; within millimetres of its projection up to a kilometre."""
    degrees_per_m = 1.0 / radians(_EARTH_RADIUS_M)
    return GlobalPosition(
        home.latitude_deg + position_ned_m[0] * degrees_per_m,
        home.longitude_deg + position_ned_m[1] * degrees_per_m / cos(radians(home.latitude_deg)),
        home.altitude_amsl_m - position_ned_m[2],
    )


def ned_of(position: GlobalPosition, home: GlobalPosition) -> Vec3:
    """The inverse of ``global_of``."""
    m_per_degree = radians(_EARTH_RADIUS_M)
    return (
        (position.latitude_deg - home.latitude_deg) * m_per_degree,
        (position.longitude_deg - home.longitude_deg) * m_per_degree * cos(radians(home.latitude_deg)),
        home.altitude_amsl_m - position.altitude_amsl_m,
    )
