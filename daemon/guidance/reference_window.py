"""A reference window as the control task reads it: at a moment between its samples, in the frame of now; pure."""

from bisect import bisect_right
from dataclasses import replace

from daemon import frames
from daemon.guidance.constant_jerk import carried
from daemon.messages import WINDOW_SPACING_S, ZERO3, FrameShift, Reference, ReferenceWindow, Vec3


def covers(window: ReferenceWindow, time_s: float) -> bool:
    """Whether the window has the moment, the spacing after its last sample included."""
    samples = window.samples
    return bool(samples) and samples[0].time_s <= time_s <= samples[-1].time_s + WINDOW_SPACING_S


def sample(window: ReferenceWindow, shift: FrameShift, time_s: float) -> Reference:
    """The window at a moment, by its own derivatives from the nearest sample, in the frame of now.

    Not from the sample before: on the window's own grid, rounding would choose between a sample and a whole spacing.
    Where the samples are farther apart, along the quintic between the two around the moment.
    """
    samples = window.samples
    nearest = samples[min(round((time_s - samples[0].time_s) / WINDOW_SPACING_S), len(samples) - 1)]
    if time_s >= samples[-1].time_s or abs(nearest.time_s - time_s) <= WINDOW_SPACING_S:
        reference = _extrapolated(samples[-1] if time_s >= samples[-1].time_s else nearest, time_s)
    else:
        after = bisect_right(samples, time_s, key=lambda r: r.time_s)
        reference = between(samples[after - 1], samples[after], time_s)
    if window.shift.count == shift.count:
        return reference
    return shifted(reference, *shift.since(window.shift), shift.time_s)


def _extrapolated(r: Reference, time_s: float) -> Reference:
    dt_s = time_s - r.time_s
    motion = (r.position_ned_m, r.velocity_ned_m_s, r.acceleration_ned_m_s2)
    yaw_rad = frames.wrap_pi(r.yaw_rad + r.yaw_rate_rad_s * dt_s)
    return Reference(time_s, *carried(motion, r.jerk_ned_m_s3, dt_s), r.jerk_ned_m_s3, yaw_rad, r.yaw_rate_rad_s)


def between(a: Reference, b: Reference, time_s: float) -> Reference:
    """The motion of fifth order that has position, velocity and acceleration of both, headings by a cubic."""
    whole_s, since_s = b.time_s - a.time_s, time_s - a.time_s
    motion = (a.position_ned_m, a.velocity_ned_m_s, a.acceleration_ned_m_s2)
    p, v, acceleration = carried(motion, ZERO3, whole_s)
    dp, dv = frames.subtract(b.position_ned_m, p), frames.subtract(b.velocity_ned_m_s, v)
    da = frames.subtract(b.acceleration_ned_m_s2, acceleration)
    axes = [_quintic(x, y, z, whole_s, since_s) for x, y, z in zip(dp, dv, da, strict=True)]
    now, (p, v, acceleration, jerk) = carried(motion, ZERO3, since_s), zip(*axes, strict=True)
    turn = frames.wrap_pi(b.yaw_rad - a.yaw_rad) - a.yaw_rate_rad_s * whole_s
    faster, s = b.yaw_rate_rad_s - a.yaw_rate_rad_s, since_s / whole_s
    bend, twist = 3.0 * turn - faster * whole_s, faster * whole_s - 2.0 * turn
    return Reference(
        time_s,
        frames.add(now[0], p),
        frames.add(now[1], v),
        frames.add(now[2], acceleration),
        jerk,
        frames.wrap_pi(a.yaw_rad + a.yaw_rate_rad_s * since_s + (bend + twist * s) * s * s),
        a.yaw_rate_rad_s + (2.0 * bend + 3.0 * twist * s) * s / whole_s,
    )


def _quintic(dp: float, dv: float, da: float, whole_s: float, t: float) -> tuple[float, float, float, float]:
    """What grows from nothing to ``dp``, ``dv`` and ``da`` in ``whole_s``, and its three derivatives, at ``t``."""
    v, a = dv * whole_s, da * whole_s * whole_s
    c3 = (10.0 * dp - 4.0 * v + 0.5 * a) / whole_s**3
    c4 = (7.0 * v - 15.0 * dp - a) / whole_s**4
    c5 = (6.0 * dp - 3.0 * v + 0.5 * a) / whole_s**5
    return (
        (c3 + (c4 + c5 * t) * t) * t**3,
        (3.0 * c3 + (4.0 * c4 + 5.0 * c5 * t) * t) * t**2,
        (6.0 * c3 + (12.0 * c4 + 20.0 * c5 * t) * t) * t,
        6.0 * c3 + (24.0 * c4 + 60.0 * c5 * t) * t,
    )


def shifted(r: Reference, dp: Vec3, dv: Vec3, dyaw: float, since_s: float) -> Reference:
    """The reference after the estimate jumped by ``dp`` (m), ``dv`` (m/s) and ``dyaw`` (rad) at ``since_s``, NED.

    PX4's own rule for setpoints; a window of before also moves on with ``dv``.
    """
    since = max(0.0, r.time_s - since_s)
    return replace(
        r,
        position_ned_m=frames.add(frames.add(r.position_ned_m, dp), frames.scale(dv, since)),
        velocity_ned_m_s=frames.add(r.velocity_ned_m_s, dv),
        yaw_rad=frames.wrap_pi(r.yaw_rad + dyaw),
    )
