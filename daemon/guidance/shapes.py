"""Circle and lemniscate: curves of a phase, and plans that run the phase up, around and down again."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, copysign, cos, hypot, pi, sin, sqrt

from daemon.frames import add, cross, norm, scale, subtract
from daemon.guidance.limits import MotionLimits, share_of_limits
from daemon.guidance.plan import Plan, straights
from daemon.messages import Reference, Vec3

_ENTRIES = 72  # phases among which the entry nearest to the vehicle is looked for
_PARALLEL = 0.99  # cosine beyond which the axis counts as pointing north
_LOOKS = 40  # instants of a ramp that are held against the limits,
_LOOK_RAD = 0.1  # and one more for so much of the phase
_LONGER = 1.2  # factor by which the ramps grow while they ask for too much,
_LENGTHENINGS = 25  # and how often at most: a turn that is itself beyond the limits stays there
_SLACK = 1.005  # a turn that is just within the limits where it is looked at may pass them so far between

Derivatives = tuple[Vec3, Vec3, Vec3, Vec3]  # of the curve by its phase, from the zeroth to the third


@dataclass(frozen=True, slots=True, kw_only=True)
class Circle:
    """Circle about a centre; seen along ``axis`` (the default looks down) it starts in the north.

    ``axis_ned`` needs a length, no unit length.
    """

    center_ned_m: Vec3
    radius_m: float
    axis_ned: Vec3 = (0.0, 0.0, 1.0)

    @property
    def path_speed_m(self) -> float:
        """Peak speed per unit of the phase's rate."""
        return self.radius_m

    def at(self, phase_rad: float) -> Derivatives:
        """Position and its derivatives by the phase."""
        first, second = plane_of(self.axis_ned)
        c, s = cos(phase_rad), sin(phase_rad)
        r = self.radius_m
        out, on = _combine(first, r * c, second, r * s), _combine(first, -r * s, second, r * c)
        return add(self.center_ned_m, out), on, scale(out, -1.0), scale(on, -1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lemniscate:
    """Figure of eight about a centre: a sin along the first axis of its plane, b sin 2 along the second."""

    center_ned_m: Vec3
    size_m: tuple[float, float]
    axis_ned: Vec3 = (0.0, 0.0, 1.0)

    @property
    def path_speed_m(self) -> float:
        """Peak speed, in the centre, per unit of the phase's rate."""
        return hypot(self.size_m[0], 2.0 * self.size_m[1])

    def at(self, phase_rad: float) -> Derivatives:
        """Position and its derivatives by the phase."""
        first, second = plane_of(self.axis_ned)
        (a, b), c, s = self.size_m, cos(phase_rad), sin(phase_rad)
        c2, s2 = cos(2.0 * phase_rad), sin(2.0 * phase_rad)
        return (
            add(self.center_ned_m, _combine(first, a * s, second, b * s2)),
            _combine(first, a * c, second, 2.0 * b * c2),
            _combine(first, -a * s, second, -4.0 * b * s2),
            _combine(first, -a * c, second, -8.0 * b * c2),
        )


Shape = Circle | Lemniscate


@lru_cache(maxsize=16)
def plane_of(axis_ned: Vec3) -> tuple[Vec3, Vec3]:
    """Two unit vectors that span the plane across an axis: north as seen in the plane, and the one clockwise of it.

    Clockwise as seen looking along the axis. An axis that points north or south takes east for north.
    """
    along = scale(axis_ned, 1.0 / norm(axis_ned))
    north = (1.0, 0.0, 0.0) if abs(along[0]) < _PARALLEL else (0.0, 1.0, 0.0)
    share = along[0] * north[0] + along[1] * north[1]
    first = subtract(north, scale(along, share))
    first = scale(first, 1.0 / norm(first))
    return first, cross(along, first)


def entry_phase(shape: Shape, position_ned_m: Vec3) -> float:
    """Phase at which a shape comes nearest to a position, to 5 degrees."""
    phases = [2.0 * pi * i / _ENTRIES for i in range(_ENTRIES)]
    return min(phases, key=lambda phase: norm(subtract(shape.at(phase)[0], position_ned_m)))


class ShapePlan(Plan):
    """Turns of a shape from rest to rest: the phase's rate grows smoothly, stays, and falls smoothly.

    ``rate_rad_s`` is the rate between run-in and run-out, negative for counter-clockwise; ``turns`` counts both. Turns
    that are over before the ramps are take less rate. The ramps are quintic, so that acceleration is continuous. They
    last 2 v / a or sqrt(12 v / j), which would do on a straight line, or as much longer as it takes to keep what the
    bend asks for and what the ramp adds within the limits together.
    """

    def __init__(
        self,
        start: Reference,
        shape: Shape,
        entry_rad: float,
        rate_rad_s: float,
        turns: float,
        limits: MotionLimits,
    ) -> None:
        self.start_s = start.time_s
        self._shape = shape
        self._entry_rad = entry_rad
        self._yaw_rad = start.yaw_rad
        whole_rad = 2.0 * pi * turns
        self._whole_rad = copysign(whole_rad, rate_rad_s)
        speed = abs(rate_rad_s) * shape.path_speed_m
        least_m_s2 = min(limits.acceleration_m_s2, limits.vertical_acceleration_m_s2)
        self._set_ramps(max(2.0 * speed / least_m_s2, sqrt(12.0 * speed / limits.jerk_m_s3)), rate_rad_s, whole_rad)
        for _ in range(_LENGTHENINGS):
            if self._ramps_share(limits) <= _SLACK:
                break
            self._set_ramps(_LONGER * self._ramp_s, rate_rad_s, whole_rad)
        end = shape.at(entry_rad + self._whole_rad)[0]
        self._target = Reference(self.end_s, end, yaw_rad=start.yaw_rad)

    @property
    def end_s(self) -> float:
        """End of the run-out."""
        return self.start_s + self._duration_s

    @property
    def target(self) -> Reference:
        """Rest where the turns end."""
        return self._target

    def sample(self, time_s: float) -> Reference:
        """The shape at the phase of a time, derivatives by the chain rule."""
        since_s = min(max(0.0, time_s - self.start_s), self._duration_s)
        phase, w, w1, w2 = self._phase(since_s)
        p, d1, d2, d3 = self._shape.at(self._entry_rad + phase)
        acceleration = add(scale(d2, w * w), scale(d1, w1))
        jerk = add(add(scale(d3, w * w * w), scale(d2, 3.0 * w * w1)), scale(d1, w2))
        return Reference(time_s, p, scale(d1, w), acceleration, jerk, self._yaw_rad)

    def polyline(self) -> Iterator[Vec3]:
        """The first turn. The curve's second derivative by the phase is at most twice the peak of the first."""
        turn_rad = copysign(min(abs(self._whole_rad), 2.0 * pi), self._whole_rad)
        count = straights(abs(turn_rad), 2.0 * self._shape.path_speed_m)
        for i in range(count + 1):
            yield self._shape.at(self._entry_rad + turn_rad * i / count)[0]

    def _set_ramps(self, ramp_s: float, rate_rad_s: float, whole_rad: float) -> None:
        rate = min(abs(rate_rad_s), whole_rad / ramp_s)
        self._ramp_s = ramp_s
        self._duration_s = whole_rad / rate + ramp_s
        self._rate_rad_s = copysign(rate, rate_rad_s)

    def _ramps_share(self, limits: MotionLimits) -> float:
        """The largest share of the limits that run-in and run-out ask for."""
        count = _LOOKS + ceil(0.5 * abs(self._rate_rad_s) * self._ramp_s / _LOOK_RAD)
        into = [self._ramp_s * i / count for i in range(count + 1)]
        looks = [self.sample(self.start_s + s) for s in (*into, *(self._duration_s - s for s in into))]
        return max(share_of_limits(r.velocity_ned_m_s, r.acceleration_ned_m_s2, r.jerk_ned_m_s3, limits) for r in looks)

    def _phase(self, since_s: float) -> tuple[float, float, float, float]:
        """Phase, its rate and two more derivatives."""
        ramp, rate, left_s = self._ramp_s, self._rate_rad_s, self._duration_s - since_s
        if since_s < ramp:
            area, height, slope, bend = smooth_step(since_s / ramp)
            return rate * ramp * area, rate * height, rate * slope / ramp, rate * bend / ramp**2
        if left_s < ramp:
            area, height, slope, bend = smooth_step(left_s / ramp)
            whole = rate * (self._duration_s - ramp)
            return whole - rate * ramp * area, rate * height, -rate * slope / ramp, rate * bend / ramp**2
        return rate * (since_s - 0.5 * ramp), rate, 0.0, 0.0


def smooth_step(s: float) -> tuple[float, float, float, float]:
    """Integral, value, slope and bend of 10 s^3 - 15 s^4 + 6 s^5, which goes from 0 to 1 without a kink."""
    return (
        2.5 * s**4 - 3.0 * s**5 + s**6,
        10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5,
        30.0 * s**2 * (1.0 - s) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )


def _combine(first: Vec3, x: float, second: Vec3, y: float) -> Vec3:
    return (first[0] * x + second[0] * y, first[1] * x + second[1] * y, first[2] * x + second[2] * y)
