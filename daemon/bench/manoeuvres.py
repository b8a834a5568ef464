"""What the tracking benchmark flies: references as functions of the time since their beginning, from the origin."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt

from daemon.frames import scale, wrap_pi
from daemon.guidance.shapes import Circle, Lemniscate, Shape
from daemon.messages import Reference, Vec3

RAMP_S = 4.0
_STEP_AT_S = 2.0
_EIGHT = Lemniscate(center_ned_m=(0.0, 0.0, 0.0), size_m=(10.0, 5.0))
_UPRIGHT = Circle(center_ned_m=(0.0, 0.0, 0.0), radius_m=2.0, axis_ned=(0.0, 1.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """``reference_at``: the reference at seconds since the beginning, which is at rest in the origin.

    Errors count from ``run_in_s`` to ``duration_s``. ``step_m``: the length of a step north at ``step_at_s``, 0: none.
    """

    name: str
    reference_at: Callable[[float], Reference]
    run_in_s: float
    duration_s: float
    tilt_max_deg: float = 35.0
    step_m: float = 0.0
    step_at_s: float = _STEP_AT_S


def hover() -> Manoeuvre:
    """Stay for half a minute."""
    return Manoeuvre(name="hover", reference_at=lambda t: Reference(t, (0.0, 0.0, 0.0)), run_in_s=0.0, duration_s=30.0)


def step(length_m: float) -> Manoeuvre:
    """The reference jumps north."""

    def at(t: float) -> Reference:
        return Reference(t, (length_m if t >= _STEP_AT_S else 0.0, 0.0, 0.0))

    return Manoeuvre(name=f"step_{length_m:g}m", reference_at=at, run_in_s=_STEP_AT_S, duration_s=14.0, step_m=length_m)


def leg(speed_m_s: float, duration_s: float) -> Manoeuvre:
    """Straight north."""

    def at(t: float) -> Reference:
        area_s, share, slope, bend = (speed_m_s * value for value in _ramp(t))
        return Reference(t, (area_s, 0.0, 0.0), (share, 0.0, 0.0), (slope, 0.0, 0.0), (bend, 0.0, 0.0))

    return Manoeuvre(name=f"leg_{speed_m_s:g}", reference_at=at, run_in_s=RAMP_S, duration_s=duration_s)


def lemniscate(peak_m_s: float, yaw_rate_rad_s: float = 0.0, name: str | None = None) -> Manoeuvre:
    """x = 10 sin, y = 5 sin 2, two laps of which the second counts; optionally with a heading that turns."""
    rate = peak_m_s / _EIGHT.path_speed_m
    lap_s = 2.0 * pi / rate

    def at(t: float) -> Reference:
        return _along(_EIGHT, (0.0, 0.0, 0.0), t, rate, yaw_rate_rad_s)

    return Manoeuvre(
        name=name or f"lemniscate_{peak_m_s:g}",
        reference_at=at,
        run_in_s=RAMP_S + lap_s,
        duration_s=RAMP_S + 2.0 * lap_s,
        tilt_max_deg=60.0,
    )


def vertical_circle() -> Manoeuvre:
    """A circle of 2 m upright, 2.4 m/s; the first lap does not count."""
    rate = 1.2
    start = _UPRIGHT.at(0.0)[0]

    def at(t: float) -> Reference:
        return _along(_UPRIGHT, scale(start, -1.0), t, rate, 0.0)

    lap_s = 2.0 * pi / rate
    return Manoeuvre(
        name="vertical_circle",
        reference_at=at,
        run_in_s=RAMP_S + lap_s,
        duration_s=RAMP_S + 3.0 * lap_s,
        tilt_max_deg=60.0,
    )


def all_manoeuvres() -> tuple[Manoeuvre, ...]:
    """In the order of the table."""
    return (
        hover(),
        step(1.0),
        step(5.0),
        step(10.0),
        lemniscate(2.0),
        lemniscate(5.0),
        lemniscate(8.0),
        vertical_circle(),
        lemniscate(3.0, yaw_rate_rad_s=1.0, name="heading_spin"),
    )


def _along(shape: Shape, offset: Vec3, t: float, rate_rad_s: float, yaw_rate_rad_s: float) -> Reference:
    """The shape at a phase whose rate grows from 0 within ``RAMP_S``, by the chain rule."""
    area_s, share, slope_1_s, bend_1_s2 = _ramp(t)
    w, w1, w2 = rate_rad_s * share, rate_rad_s * slope_1_s, rate_rad_s * bend_1_s2
    p, d1, d2, d3 = shape.at(rate_rad_s * area_s)
    return Reference(
        t,
        _sum((p, 1.0), (offset, 1.0)),
        scale(d1, w),
        _sum((d2, w * w), (d1, w1)),
        _sum((d3, w**3), (d2, 3.0 * w * w1), (d1, w2)),
        wrap_pi(yaw_rate_rad_s * area_s),
        yaw_rate_rad_s * share,
    )


def _ramp(t: float) -> tuple[float, float, float, float]:
    """A quintic smooth step from 0 to 1 within ``RAMP_S``: its integral, itself, its first two derivatives."""
    s = min(max(t, 0.0) / RAMP_S, 1.0)
    share = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
    area_s = RAMP_S * (2.5 * s**4 - 3.0 * s**5 + s**6) + max(0.0, t - RAMP_S)
    slope = 30.0 * s**2 * (1.0 - s) ** 2 / RAMP_S
    return area_s, share, slope, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / RAMP_S**2


def _sum(*terms: tuple[Vec3, float]) -> Vec3:
    return (
        sum(v[0] * k for v, k in terms),
        sum(v[1] * k for v, k in terms),
        sum(v[2] * k for v, k in terms),
    )


def moved(reference: Reference, by_ned_m: Vec3, since_s: float, yaw_rad: float) -> Reference:
    """The reference of a manoeuvre that begins at ``since_s`` in another place and heading (the path is not turned)."""
    p = reference.position_ned_m
    return Reference(
        since_s + reference.time_s,
        (p[0] + by_ned_m[0], p[1] + by_ned_m[1], p[2] + by_ned_m[2]),
        reference.velocity_ned_m_s,
        reference.acceleration_ned_m_s2,
        reference.jerk_ned_m_s3,
        wrap_pi(yaw_rad + reference.yaw_rad),
        reference.yaw_rate_rad_s,
    )


def rms(values: list[float]) -> float:
    """Root of the mean square; NaN of nothing."""
    return sqrt(sum(v * v for v in values) / len(values)) if values else float("nan")
