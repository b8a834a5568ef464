"""Rotor drag of a vehicle that flies its reference exactly, and the drag's derivative: what the feed-forward needs.

With a drag of its own along each body axis the attitude depends on the drag and the drag on the attitude. Faessler,
Franchi, Scaramuzza 2018 solve that for an attitude that they give by the heading of its side axis; here it is solved by
a few passes, which any heading convention takes. They shrink the error by drag difference times speed over gravity.
"""

from daemon.control.flatness import attitude_from_thrust, body_rates, is_isotropic, rotor_drag
from daemon.control.parameters import HeadingAxis
from daemon.frames import add, cross, rotate, rotate_inverse, subtract
from daemon.messages import Quat, Reference, Vec3

_PASSES = 3  # at 7 m/s in a drag of (0.5, 0.2, 0.1) 1/s leave 0.005 deg, 0.0002 rad/s and 0.002 m/s2


def reference_drag(
    reference: Reference,
    bare_ned_m_s2: Vec3,
    attitude_now_wb: Quat,
    drag_1_s: Vec3,
    heading_axis: HeadingAxis,
    *,
    original: bool = False,
) -> tuple[Vec3, Vec3]:
    """Acceleration by drag along the reference, m/s2 NED, and its derivative, m/s3.

    ``bare_ned_m_s2``: the thrust that flies the reference without drag. The attitude of now serves in free fall.
    ``original``: at the attitude of that thrust, and as if it did not turn.
    """
    velocity, acceleration = reference.velocity_ned_m_s, reference.acceleration_ned_m_s2
    if is_isotropic(drag_1_s) or original:
        flat_wb = attitude_now_wb
        if original:
            flat_wb = attitude_from_thrust(bare_ned_m_s2, reference.yaw_rad, flat_wb, heading_axis)
        return rotor_drag(flat_wb, velocity, drag_1_s), rotor_drag(flat_wb, acceleration, drag_1_s)
    across = 0.5 * (drag_1_s[0] + drag_1_s[1])  # where the two are equal, the first pass is exact
    drag = rotor_drag(attitude_now_wb, velocity, (across, across, across))
    for _ in range(_PASSES):
        flat_wb = attitude_from_thrust(subtract(bare_ned_m_s2, drag), reference.yaw_rad, attitude_now_wb, heading_axis)
        drag = rotor_drag(flat_wb, velocity, drag_1_s)
    with_velocity = rotor_drag(flat_wb, acceleration, drag_1_s)
    derivative, thrust = with_velocity, subtract(bare_ned_m_s2, drag)
    for _ in range(_PASSES):
        turning = subtract(reference.jerk_ned_m_s3, derivative)
        rates = body_rates(flat_wb, thrust, turning, reference.yaw_rad, reference.yaw_rate_rad_s, heading_axis)
        derivative = add(with_velocity, _with_attitude(flat_wb, rates, velocity, drag_1_s))
    return drag, derivative


def _with_attitude(attitude_wb: Quat, rates_frd_rad_s: Vec3, velocity_ned_m_s: Vec3, drag_1_s: Vec3) -> Vec3:
    """The part of the derivative of -R D R' v that R makes: R (D (w x R' v) - w x (D R' v))."""
    dx, dy, dz = drag_1_s
    vx, vy, vz = frd = rotate_inverse(attitude_wb, velocity_ned_m_s)
    tx, ty, tz = cross(rates_frd_rad_s, frd)
    dragged = cross(rates_frd_rad_s, (dx * vx, dy * vy, dz * vz))
    return rotate(attitude_wb, subtract((dx * tx, dy * ty, dz * tz), dragged))
