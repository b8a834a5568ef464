"""What a reference may ask of the vehicle."""

from dataclasses import dataclass, fields, replace
from math import hypot, isfinite, radians

from daemon.messages import Vec3

_SLACK = 1.0 + 1e-6  # rounding is not an excess


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionLimits:
    """Bounds on the reference's motion, all positive and finite. The horizontal ones bound the length of the vector.

    Raises ``ValueError`` naming the field for a bound that is not a positive, finite number.
    """

    speed_m_s: float = 5.0  # horizontal
    climb_m_s: float = 2.0  # upwards
    descent_m_s: float = 1.5  # downwards
    acceleration_m_s2: float = 3.0  # horizontal: 17 degrees of tilt
    vertical_acceleration_m_s2: float = 2.0
    jerk_m_s3: float = 10.0  # horizontal and vertical each
    yaw_rate_rad_s: float = radians(60.0)
    yaw_acceleration_rad_s2: float = radians(115.0)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isfinite(value) and value > 0.0):
                raise ValueError(f"{field.name}: {value} is not a positive, finite number")

    def tightened(
        self,
        *,
        speed_m_s: float | None = None,
        acceleration_m_s2: float | None = None,
        jerk_m_s3: float | None = None,
        yaw_rate_rad_s: float | None = None,
    ) -> "MotionLimits":
        """These limits with the given ones where they are tighter; speed and acceleration count vertically too."""

        def least(own: float, wanted: float | None) -> float:
            return own if wanted is None else min(own, wanted)

        return replace(
            self,
            speed_m_s=least(self.speed_m_s, speed_m_s),
            climb_m_s=least(self.climb_m_s, speed_m_s),
            descent_m_s=least(self.descent_m_s, speed_m_s),
            acceleration_m_s2=least(self.acceleration_m_s2, acceleration_m_s2),
            vertical_acceleration_m_s2=least(self.vertical_acceleration_m_s2, acceleration_m_s2),
            jerk_m_s3=least(self.jerk_m_s3, jerk_m_s3),
            yaw_rate_rad_s=least(self.yaw_rate_rad_s, yaw_rate_rad_s),
        )


def motion_excess(velocity_ned_m_s: Vec3, acceleration_ned_m_s2: Vec3, limits: MotionLimits) -> tuple[str, str] | None:
    """The first of velocity and acceleration that is beyond the limits: its name with the axis, and in words."""
    (vx, vy, vz), (ax, ay, az) = velocity_ned_m_s, acceleration_ned_m_s2
    across, down = limits.acceleration_m_s2, limits.vertical_acceleration_m_s2
    if hypot(vx, vy) > limits.speed_m_s * _SLACK:
        return "velocity", f"{hypot(vx, vy):.2f} m/s is more than the {limits.speed_m_s:g} m/s allowed"
    if vz > limits.descent_m_s * _SLACK or -vz > limits.climb_m_s * _SLACK:
        return "velocity[2]", f"{vz:.2f} m/s down is not within {-limits.climb_m_s:g} to {limits.descent_m_s:g} m/s"
    if hypot(ax, ay) > across * _SLACK:
        return "acceleration", f"{hypot(ax, ay):.2f} m/s^2 is more than the {across:g} m/s^2 allowed"
    if abs(az) > down * _SLACK:
        return "acceleration[2]", f"{abs(az):.2f} m/s^2 vertically is more than the {down:g} m/s^2 allowed"
    return None


def share_of_limits(
    velocity_ned_m_s: Vec3, acceleration_ned_m_s2: Vec3, jerk_ned_m_s3: Vec3, limits: MotionLimits
) -> float:
    """What a motion asks for over what the limits allow, of that which is nearest to its limit; 1 is just allowed."""
    (vx, vy, vz), (ax, ay, az), (jx, jy, jz) = velocity_ned_m_s, acceleration_ned_m_s2, jerk_ned_m_s3
    return max(
        hypot(vx, vy) / limits.speed_m_s,
        vz / limits.descent_m_s,
        -vz / limits.climb_m_s,
        hypot(ax, ay) / limits.acceleration_m_s2,
        abs(az) / limits.vertical_acceleration_m_s2,
        hypot(jx, jy) / limits.jerk_m_s3,
        abs(jz) / limits.jerk_m_s3,
    )
