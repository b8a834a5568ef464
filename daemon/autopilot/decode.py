"""MAVLink field dicts to the daemon's messages: values as they came, only units and types changed.

A number that is missing (None: NaN in JSON) becomes NaN. KeyError, TypeError or ValueError for a malformed message.
"""

from math import nan
from typing import Any

from daemon.messages import GlobalPosition, Imu, Odometry, Vec3

Fields = dict[str, Any]

# Row-major upper triangle of a 6x6 matrix: where the diagonal sits.
_DIAGONAL_FIRST = (0, 6, 11)


def number(value: float | str | None) -> float:
    """A field as a float; None is NaN."""
    return nan if value is None else float(value)


def _diagonal(covariance: list[float | None]) -> Vec3:
    first, second, third = (number(covariance[index]) for index in _DIAGONAL_FIRST)
    return (first, second, third)


def odometry(fields: Fields, arrival_s: float) -> Odometry:
    """ODOMETRY; frames are named by its ids and not changed here."""
    q = fields["q"]
    return Odometry(
        stamp_us=int(fields["time_usec"]),
        arrival_s=arrival_s,
        frame_id=int(fields["frame_id"]),
        child_frame_id=int(fields["child_frame_id"]),
        position_m=(number(fields["x"]), number(fields["y"]), number(fields["z"])),
        velocity_m_s=(number(fields["vx"]), number(fields["vy"]), number(fields["vz"])),
        attitude_wb=(number(q[0]), number(q[1]), number(q[2]), number(q[3])),
        rates_frd_rad_s=(number(fields["rollspeed"]), number(fields["pitchspeed"]), number(fields["yawspeed"])),
        position_variance_m2=_diagonal(fields["pose_covariance"]),
        velocity_variance_m2_s2=_diagonal(fields["velocity_covariance"]),
        reset_counter=int(fields["reset_counter"]),
    )


def imu(fields: Fields, arrival_s: float) -> Imu:
    """HIGHRES_IMU: m/s^2, rad/s, gauss, all in FRD."""
    return Imu(
        stamp_us=int(fields["time_usec"]),
        arrival_s=arrival_s,
        specific_force_frd_m_s2=(number(fields["xacc"]), number(fields["yacc"]), number(fields["zacc"])),
        rates_frd_rad_s=(number(fields["xgyro"]), number(fields["ygyro"]), number(fields["zgyro"])),
        magnetic_field_frd_gauss=(number(fields["xmag"]), number(fields["ymag"]), number(fields["zmag"])),
    )


def global_position(fields: Fields, latitude: str, longitude: str, altitude: str) -> GlobalPosition:
    """A WGS84 position of degrees x 1e7 and millimetres above mean sea level, from the fields so named."""
    return GlobalPosition(fields[latitude] * 1e-7, fields[longitude] * 1e-7, fields[altitude] * 1e-3)


def battery_fraction(fields: Fields) -> float | None:
    """SYS_STATUS' remaining charge, 0 to 1; None when the autopilot does not know it."""
    percent = int(fields["battery_remaining"])
    return percent * 0.01 if percent >= 0 else None


def home_ned(fields: Fields) -> Vec3 | None:
    """HOME_POSITION's place in the local frame, metres; None when it is not given."""
    values = (number(fields["x"]), number(fields["y"]), number(fields["z"]))
    return None if any(value != value for value in values) else values
