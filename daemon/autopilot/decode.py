"""MAVLink field dicts to the daemon's messages: values as they came, only units and types changed.

A number that is missing (None: NaN in JSON) becomes NaN. KeyError, TypeError or ValueError for a malformed message.
"""

from math import nan
from typing import Any, cast

from daemon.messages import GlobalPosition, Imu, Odometry, Vec3

Fields = dict[str, Any]


def number(value: float | str | None) -> float:
    """A field as a float; None is NaN."""
    return nan if value is None else float(value)


def vector(*values: float | str | None) -> Vec3:
    """Three fields as floats; None is NaN."""
    if None in values:
        return cast(Vec3, tuple(map(number, values)))
    return cast(Vec3, tuple(map(float, cast(tuple[float, float, float], values))))


def odometry(fields: Fields, arrival_s: float) -> Odometry:
    """ODOMETRY; frames are named by its ids and not changed here."""
    w, x, y, z = fields["q"]
    pose, velocity = fields["pose_covariance"], fields["velocity_covariance"]
    return Odometry(
        int(fields["time_usec"]),
        arrival_s,
        int(fields["frame_id"]),
        int(fields["child_frame_id"]),
        vector(fields["x"], fields["y"], fields["z"]),
        vector(fields["vx"], fields["vy"], fields["vz"]),
        (number(w), *vector(x, y, z)),
        vector(fields["rollspeed"], fields["pitchspeed"], fields["yawspeed"]),
        vector(pose[0], pose[6], pose[11]),  # the diagonal of the upper triangle by rows
        vector(velocity[0], velocity[6], velocity[11]),
        int(fields["reset_counter"]),
    )


def imu(fields: Fields, arrival_s: float) -> Imu:
    """HIGHRES_IMU: m/s^2, rad/s, gauss, all in FRD."""
    return Imu(
        int(fields["time_usec"]),
        arrival_s,
        vector(fields["xacc"], fields["yacc"], fields["zacc"]),
        vector(fields["xgyro"], fields["ygyro"], fields["zgyro"]),
        vector(fields["xmag"], fields["ymag"], fields["zmag"]),
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
    values = vector(fields["x"], fields["y"], fields["z"])
    return None if any(value != value for value in values) else values
