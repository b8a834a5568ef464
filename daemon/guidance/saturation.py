"""Steps of a third-order filter whose velocity, acceleration and jerk never leave their bounds.

The linear filter of Fossen (2021, 12.1), written as a cascade: with c = 2 zeta + 1 its jerk is
``c w (w (w/c (goal - p) - v) - a)``: a commanded velocity, a commanded acceleration, a jerk. Saturating the commands
alone does not bound the states, so the acceleration after the step is picked from those from which the bounds can still
be kept: with ``E(a) = a (|a|/J + dt) / 2``, the velocity gained while the acceleration is taken back to zero, the set
``|v| <= V, |v + E(a)| <= V, |a| <= A`` is left by no step that brakes. From outside the state returns as fast as the
bounds on acceleration and jerk allow. Within a step the jerk is constant and the integration exact; velocity may peak
between two steps by J dt^2 / 8, which is taken off V.
"""

from dataclasses import dataclass
from math import hypot, sqrt

from daemon.frames import clamp
from daemon.guidance.constant_jerk import Motion
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters
from daemon.messages import Vec3

_PUSHING = 2.0  # J / omega; an acceleration that takes longer to come and go lets the filter circle about its goal
_SHORTENINGS = 7  # halvings of the search along the way from braking to the wanted acceleration


@dataclass(frozen=True, slots=True, kw_only=True)
class Cascade:
    """Gains and bounds of one filter; see ``cascade`` for how they come from frequency and limits."""

    velocity_gain_1_s: float  # w / c
    acceleration_gain_1_s: float  # w
    jerk_gain_1_s: float  # c w
    braking_m_s2: float  # deceleration that the approach to the goal is planned with
    pushing_m_s2: float  # acceleration towards the wanted velocity, at most
    speed_high_m_s: float
    speed_low_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float
    dt_s: float


def cascade(
    *,
    omega_rad_s: float,
    zeta: float,
    speed_high_m_s: float,
    speed_low_m_s: float,
    acceleration_m_s2: float,
    jerk_m_s3: float,
    dt_s: float,
) -> Cascade:
    """Gains for a natural frequency and damping, and bounds for steps of ``dt_s``.

    The approach brakes with 0.7 of the acceleration, or less when the jerk would not let it build up in time. For the
    same reason less than the acceleration may be asked for to come to the wanted velocity.
    """
    c = 2.0 * zeta + 1.0
    ripple = jerk_m_s3 * dt_s * dt_s / 8.0
    return Cascade(
        velocity_gain_1_s=omega_rad_s / c,
        acceleration_gain_1_s=omega_rad_s,
        jerk_gain_1_s=c * omega_rad_s,
        braking_m_s2=min(0.7 * acceleration_m_s2, 0.5 * jerk_m_s3 / omega_rad_s),
        pushing_m_s2=min(acceleration_m_s2, _PUSHING * jerk_m_s3 / omega_rad_s),
        speed_high_m_s=max(speed_high_m_s - ripple, 0.5 * speed_high_m_s),
        speed_low_m_s=min(speed_low_m_s + ripple, 0.5 * speed_low_m_s),
        acceleration_m_s2=acceleration_m_s2,
        jerk_m_s3=jerk_m_s3,
        dt_s=dt_s,
    )


def cascades(limits: MotionLimits, parameters: GuidanceParameters, step_s: float) -> tuple[Cascade, Cascade]:
    """Gains of the horizontal and of the vertical filter."""
    shared = {"omega_rad_s": parameters.omega_rad_s, "zeta": parameters.zeta, "jerk_m_s3": limits.jerk_m_s3}
    horizontal = cascade(
        **shared,
        speed_high_m_s=limits.speed_m_s,
        speed_low_m_s=-limits.speed_m_s,
        acceleration_m_s2=limits.acceleration_m_s2,
        dt_s=step_s,
    )
    vertical = cascade(
        **shared,
        speed_high_m_s=limits.descent_m_s,
        speed_low_m_s=-limits.climb_m_s,
        acceleration_m_s2=limits.vertical_acceleration_m_s2,
        dt_s=step_s,
    )
    return horizontal, vertical


def step_towards(plane: Cascade, vertical: Cascade, offset_ned_m: Vec3, motion: Motion) -> Vec3:
    """Jerk of the next step towards a place that rests ``offset_ned_m`` away, m/s^3."""
    _, (vx, vy, vz), (ax, ay, az) = motion
    jx, jy = step_plane(plane, offset_ned_m[0], offset_ned_m[1], vx, vy, ax, ay)
    return jx, jy, step_axis(vertical, offset_ned_m[2], vz, az)


def approach_speed(distance_m: float, gain_1_s: float, braking_m_s2: float) -> float:
    """Speed from which the goal is reached: proportional to the distance near it, then with constant braking."""
    linear_m = braking_m_s2 / (gain_1_s * gain_1_s)
    if distance_m <= linear_m:
        return gain_1_s * distance_m
    return sqrt(2.0 * braking_m_s2 * (distance_m - 0.5 * linear_m))


def run_out_m(speed: float, gain_1_s: float, braking_m_s2: float) -> float:
    """Distance from which the approach begins at a speed: the inverse of ``approach_speed``."""
    if speed <= braking_m_s2 / gain_1_s:
        return speed / gain_1_s
    return speed * speed / (2.0 * braking_m_s2) + 0.5 * braking_m_s2 / gain_1_s**2


def step_axis(
    gains: Cascade,
    to_goal_m: float,
    velocity_m_s: float,
    acceleration_m_s2: float,
    goal_velocity_m_s: float = 0.0,
    goal_acceleration_m_s2: float = 0.0,
) -> float:
    """Jerk of the next step on one axis towards a goal that may move, m/s^3."""
    speed = approach_speed(abs(to_goal_m), gains.velocity_gain_1_s, gains.braking_m_s2)
    wanted_v = goal_velocity_m_s + (speed if to_goal_m >= 0.0 else -speed)
    wanted_v = clamp(wanted_v, gains.speed_low_m_s, gains.speed_high_m_s)
    limit, push = gains.acceleration_m_s2, gains.pushing_m_s2
    wanted_a = goal_acceleration_m_s2 + clamp(gains.acceleration_gain_1_s * (wanted_v - velocity_m_s), -push, push)
    wanted_jerk = gains.jerk_gain_1_s * (clamp(wanted_a, -limit, limit) - acceleration_m_s2)
    return keep_axis(gains, velocity_m_s, acceleration_m_s2, wanted_jerk)


def keep_axis(gains: Cascade, velocity_m_s: float, acceleration_m_s2: float, wanted_jerk_m_s3: float) -> float:
    """The jerk nearest to the wanted one after which the bounds of the axis can still be kept, m/s^3."""
    dt, jerk, limit = gains.dt_s, gains.jerk_m_s3, gains.acceleration_m_s2
    high = min(limit, _largest_acceleration(gains.speed_high_m_s - velocity_m_s, acceleration_m_s2, jerk, dt))
    low = max(-limit, -_largest_acceleration(velocity_m_s - gains.speed_low_m_s, -acceleration_m_s2, jerk, dt))
    after = clamp(acceleration_m_s2 + wanted_jerk_m_s3 * dt, max(low, -limit), min(max(high, -limit), limit))
    return clamp((after - acceleration_m_s2) / dt, -jerk, jerk)


def step_heading(
    to_goal_rad: float, rate_rad_s: float, goal_rate_rad_s: float, omega_rad_s: float, limits: MotionLimits
) -> float:
    """Yaw acceleration towards a heading that may turn itself: second order, critically damped, saturated, rad/s^2."""
    most = limits.yaw_acceleration_rad_s2
    speed = approach_speed(abs(to_goal_rad), 0.5 * omega_rad_s, 0.7 * most)
    wanted = goal_rate_rad_s + (speed if to_goal_rad >= 0.0 else -speed)
    wanted = clamp(wanted, -limits.yaw_rate_rad_s, limits.yaw_rate_rad_s)
    return clamp(2.0 * omega_rad_s * (wanted - rate_rad_s), -most, most)


def _largest_acceleration(margin_m_s: float, acceleration: float, jerk: float, dt: float) -> float:
    """Largest acceleration after the step with v + E(a) within a bound that is ``margin_m_s`` away now."""
    margin_after_zero = margin_m_s - 0.5 * acceleration * dt
    if margin_after_zero < 0.0:
        return 2.0 * margin_after_zero / dt
    return jerk * (sqrt(dt * dt + 2.0 * margin_after_zero / jerk) - dt)


def step_plane(
    gains: Cascade,
    to_goal_x: float,
    to_goal_y: float,
    vx: float,
    vy: float,
    ax: float,
    ay: float,
    goal_velocity: tuple[float, float] = (0.0, 0.0),
    goal_acceleration: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, float]:
    """Jerk of the next step in a plane, where the bounds hold for the lengths of the vectors, m/s^3."""
    distance, gain = hypot(to_goal_x, to_goal_y), gains.velocity_gain_1_s
    if distance > 0.0:
        gain = approach_speed(distance, gain, gains.braking_m_s2) / distance
    wx, wy = _shortened(gain * to_goal_x + goal_velocity[0], gain * to_goal_y + goal_velocity[1], gains.speed_high_m_s)
    omega = gains.acceleration_gain_1_s
    px, py = _shortened(omega * (wx - vx), omega * (wy - vy), gains.pushing_m_s2)
    wx, wy = _shortened(goal_acceleration[0] + px, goal_acceleration[1] + py, gains.acceleration_m_s2)
    return keep_plane(gains, vx, vy, ax, ay, gains.jerk_gain_1_s * (wx - ax), gains.jerk_gain_1_s * (wy - ay))


def _shortened(x: float, y: float, limit: float) -> tuple[float, float]:
    length = hypot(x, y)
    return (x, y) if length <= limit else (x * limit / length, y * limit / length)


def keep_plane(
    gains: Cascade, vx: float, vy: float, ax: float, ay: float, wanted_jx: float, wanted_jy: float
) -> tuple[float, float]:
    """A jerk towards the wanted one after which the bounds of the plane can still be kept, m/s^3."""
    dt, jerk = gains.dt_s, gains.jerk_m_s3
    wanted_jx, wanted_jy = _shortened(wanted_jx, wanted_jy, jerk)
    speed_excess, acceleration_excess = _plane_excess(gains, vx, vy, ax, ay, wanted_jx, wanted_jy)
    if speed_excess <= 0.0 and acceleration_excess <= 0.0:
        return wanted_jx, wanted_jy
    acceleration = hypot(ax, ay)
    back = -min(1.0 / dt, jerk / acceleration) if acceleration > 0.0 else 0.0
    brake_jx, brake_jy = back * ax, back * ay
    allowed_speed, allowed_acceleration = _plane_excess(gains, vx, vy, ax, ay, brake_jx, brake_jy)
    allowed_speed, allowed_acceleration = max(0.0, allowed_speed), max(0.0, allowed_acceleration)
    if speed_excess <= allowed_speed and acceleration_excess <= allowed_acceleration:
        return wanted_jx, wanted_jy
    kept, refused = 0.0, 1.0
    for _ in range(_SHORTENINGS):
        share = 0.5 * (kept + refused)
        jx = brake_jx + share * (wanted_jx - brake_jx)
        jy = brake_jy + share * (wanted_jy - brake_jy)
        speed_excess, acceleration_excess = _plane_excess(gains, vx, vy, ax, ay, jx, jy)
        if speed_excess <= allowed_speed and acceleration_excess <= allowed_acceleration:
            kept = share
        else:
            refused = share
    return brake_jx + kept * (wanted_jx - brake_jx), brake_jy + kept * (wanted_jy - brake_jy)


def _plane_excess(
    gains: Cascade, vx: float, vy: float, ax: float, ay: float, jx: float, jy: float
) -> tuple[float, float]:
    """By how much speed and acceleration after a step lie outside the set from which they can be kept."""
    dt = gains.dt_s
    after_ax, after_ay = ax + jx * dt, ay + jy * dt
    after_vx, after_vy = vx + 0.5 * (ax + after_ax) * dt, vy + 0.5 * (ay + after_ay) * dt
    after_a = hypot(after_ax, after_ay)
    taken_back = 0.5 * (after_a / gains.jerk_m_s3 + dt)
    end_speed = hypot(after_vx + after_ax * taken_back, after_vy + after_ay * taken_back)
    return max(hypot(after_vx, after_vy), end_speed) - gains.speed_high_m_s, after_a - gains.acceleration_m_s2
