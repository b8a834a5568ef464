"""A reference window as the control task reads it: at a moment between its samples, in the frame of now; pure."""

from dataclasses import replace

from daemon import frames
from daemon.guidance.constant_jerk import carried
from daemon.messages import WINDOW_SPACING_S, FrameShift, Reference, ReferenceWindow, Vec3


def covers(window: ReferenceWindow, time_s: float) -> bool:
    """Whether the window has the moment, the spacing after its last sample included."""
    samples = window.samples
    return bool(samples) and samples[0].time_s <= time_s <= samples[-1].time_s + WINDOW_SPACING_S


def sample(window: ReferenceWindow, shift: FrameShift, time_s: float) -> Reference:
    """The window at a moment, by its own derivatives from the nearest sample, in the frame of now.

    Not from the sample before: on the window's own grid, rounding would choose between a sample and a whole spacing.
    """
    first = window.samples[0].time_s
    index = min(round((time_s - first) / WINDOW_SPACING_S), len(window.samples) - 1)
    reference = _extrapolated(window.samples[index], time_s)
    if window.shift.count == shift.count:
        return reference
    return shifted(reference, *shift.since(window.shift), shift.time_s)


def _extrapolated(r: Reference, time_s: float) -> Reference:
    dt_s = time_s - r.time_s
    motion = (r.position_ned_m, r.velocity_ned_m_s, r.acceleration_ned_m_s2)
    yaw_rad = frames.wrap_pi(r.yaw_rad + r.yaw_rate_rad_s * dt_s)
    return Reference(time_s, *carried(motion, r.jerk_ned_m_s3, dt_s), r.jerk_ned_m_s3, yaw_rad, r.yaw_rate_rad_s)


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
