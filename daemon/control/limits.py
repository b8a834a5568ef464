"""Limits that degrade well: height first, then tilt, then heading; the last word has the check that all is finite."""

from math import atan2, hypot, isfinite, sqrt, tan

from daemon.frames import clamp, rotate_inverse
from daemon.messages import Quat, Setpoint, Vec3

_SIDEWAYS_SHARE = 0.1  # of full thrust, kept where it is wanted: 5.7 degrees, half a hundredth of what lifts
_LAG_MIN_S = 0.02  # the guard turns back no quicker
_LATE_FACTOR = 1.5  # a late command acts late, and upon rates that were predicted as if it had acted
_LEVEL = 1e-6  # sine of a tilt without direction


def thrust_vector(
    thrust_ned_m_s2: Vec3, *, tilt_max_rad: float, full_m_s2: float, vertical_min_m_s2: float
) -> tuple[Vec3, bool]:
    """Thrust acceleration (NED) within tilt and full thrust, and whether it was cut.

    The vertical part is kept as far as thrust goes (always upward, never below the minimum); the horizontal part gets
    what remains. Where it is wanted, a tenth of full thrust is kept for it, as PX4 keeps MPC_THR_XY_MARG: a vehicle
    that cannot climb would otherwise drift away.
    """
    x, y, z = thrust_ned_m_s2
    horizontal = hypot(x, y)
    kept = min(horizontal, _SIDEWAYS_SHARE * full_m_s2)
    up = clamp(-z, vertical_min_m_s2, max(sqrt(full_m_s2 * full_m_s2 - kept * kept), vertical_min_m_s2))
    room = min(up * tan(tilt_max_rad), sqrt(max(full_m_s2 * full_m_s2 - up * up, 0.0)))
    if horizontal <= room:
        return (x, y, -up), up != -z
    return (x * room / horizontal, y * room / horizontal, -up), True


def tilt_guard(
    rates_frd_rad_s: Vec3,
    attitude_wb: Quat,
    rates_now_frd_rad_s: Vec3,
    *,
    tilt_max_rad: float,
    rate_lag_s: float,
    late_s: float = 0.0,
) -> Vec3:
    """Rates whose outward part would not carry the tilt across its limit; beyond the limit they turn back inward.

    Whatever the law says, the outward rate is at most (limit - tilt) / lag, where the tilt is the one that is reached
    when the rates of now have run out over the rate loop's lag: the limit is approached with critical damping.
    ``late_s``: a delay beyond those that the prediction knows; the limit is approached more carefully by it.
    """
    sx, sy, sz = rotate_inverse(attitude_wb, (0.0, 0.0, 1.0))
    sine = hypot(sx, sy)
    if sine < _LEVEL:
        return rates_frd_rad_s
    x, y, z = rates_frd_rad_s
    ox, oy = sy / sine, -sx / sine
    outward_now = max(rates_now_frd_rad_s[0] * ox + rates_now_frd_rad_s[1] * oy, 0.0)
    room_rad = tilt_max_rad - atan2(sine, sz) - outward_now * (rate_lag_s + _LATE_FACTOR * max(late_s, 0.0))
    excess = x * ox + y * oy - room_rad / max(rate_lag_s, _LAG_MIN_S)
    if excess <= 0.0:
        return rates_frd_rad_s
    return (x - excess * ox, y - excess * oy, z)


def toward(last: Setpoint, wanted: Setpoint, *, rate_step_rad_s: float, thrust_step: float) -> Setpoint:
    """The wanted setpoint, as far from the last one as the slew limits allow in a step."""
    lx, ly, lz = last.rates_frd_rad_s
    x, y, z = wanted.rates_frd_rad_s
    change = hypot(x - lx, y - ly)
    if change > rate_step_rad_s:
        part = rate_step_rad_s / change
        x, y = lx + (x - lx) * part, ly + (y - ly) * part
    return Setpoint(
        (x, y, clamp(z, lz - rate_step_rad_s, lz + rate_step_rad_s)),
        clamp(wanted.thrust, last.thrust - thrust_step, last.thrust + thrust_step),
    )


def within(
    setpoint: Setpoint,
    *,
    rate_max_rad_s: float,
    yaw_rate_max_rad_s: float,
    thrust_min: float,
    thrust_max: float,
    fallback_thrust: float,
) -> Setpoint:
    """The setpoint within rates (norm of roll and pitch, and yaw) and thrust; not finite: zero rates, fallback."""
    x, y, z = setpoint.rates_frd_rad_s
    thrust = setpoint.thrust
    if not (isfinite(x) and isfinite(y) and isfinite(z) and isfinite(thrust)):
        return Setpoint((0.0, 0.0, 0.0), clamp(fallback_thrust, thrust_min, thrust_max))
    tilt_rate = hypot(x, y)
    if tilt_rate > rate_max_rad_s:
        x, y = x * rate_max_rad_s / tilt_rate, y * rate_max_rad_s / tilt_rate
    return Setpoint((x, y, clamp(z, -yaw_rate_max_rad_s, yaw_rate_max_rad_s)), clamp(thrust, thrust_min, thrust_max))
