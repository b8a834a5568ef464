"""Where the nose points while a path is flown: a wish per instant, followed within the limits of the heading."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import atan2, floor, hypot, radians

from daemon.frames import wrap_pi
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import WINDOW_COUNT, Plan
from daemon.guidance.saturation import run_out_m, step_heading
from daemon.messages import WINDOW_SPACING_S, Reference, Vec3

DEAD_BAND_M_S = 0.5  # horizontal speed below which the direction of flight says nothing
DEAD_BAND_M = 0.5  # distance below which the direction to a point says nothing

_LOOK_BACK = 0.03  # of the time before a path's end: how finely its last wish is looked for
_MET_RAD = radians(5.0)  # a heading so near to its wish has met it
_MOST_TURN_STEPS = 6000  # after which turning counts as done, whatever the limits
_STEADY = 1e-4  # of the rate: what changes less in a step is at its limit
_REST = 1e-7  # rad and rad/s below which a heading has arrived

HeadingWish = Callable[[Reference], float | None]  # heading wanted at a reference, None: keep the last one


@dataclass(frozen=True, slots=True)
class FixedHeading:
    """Keep a heading; None: the one that the plan starts with."""

    yaw_rad: float | None = None


@dataclass(frozen=True, slots=True)
class VelocityHeading:
    """Look along the horizontal velocity."""


@dataclass(frozen=True, slots=True)
class TargetHeading:
    """Look at the target: the centre of a shape, the end of a path."""


@dataclass(frozen=True, slots=True)
class PointHeading:
    """Look at a point."""

    point_ned_m: Vec3


Heading = FixedHeading | VelocityHeading | TargetHeading | PointHeading


def wish_of(heading: Heading, target_ned_m: Vec3, start_yaw_rad: float) -> HeadingWish:
    """The wish that a heading stands for; ``target_ned_m`` is what ``TargetHeading`` looks at."""
    if isinstance(heading, VelocityHeading):
        return along_velocity
    if isinstance(heading, FixedHeading):
        yaw_rad = start_yaw_rad if heading.yaw_rad is None else heading.yaw_rad
        return lambda _: yaw_rad
    return towards(heading.point_ned_m if isinstance(heading, PointHeading) else target_ned_m)


def towards(point_ned_m: Vec3) -> HeadingWish:
    """Look at a point; straight above or below it keep the heading."""

    def wish(reference: Reference) -> float | None:
        dx, dy = point_ned_m[0] - reference.position_ned_m[0], point_ned_m[1] - reference.position_ned_m[1]
        return atan2(dy, dx) if hypot(dx, dy) > DEAD_BAND_M else None

    return wish


def along_velocity(reference: Reference) -> float | None:
    """Look where the flight goes; at a hover keep the heading."""
    vx, vy, _ = reference.velocity_ned_m_s
    return atan2(vy, vx) if hypot(vx, vy) > DEAD_BAND_M_S else None


@lru_cache(maxsize=16)
def turn_s(
    turn_rad: float,
    rate_rad_s: float,
    omega_rad_s: float,
    limits: MotionLimits,
    near_rad: float = _MET_RAD,
    step_s: float = WINDOW_SPACING_S,
) -> float:
    """How long a heading takes to meet a wish that stands still, from a rate on; stepped as ``HeadedPlan`` does."""
    off, rate, since_s = turn_rad, rate_rad_s, 0.0
    top, gain, most = limits.yaw_rate_rad_s, 0.5 * omega_rad_s, 0.7 * limits.yaw_acceleration_rad_s2
    for _ in range(_MOST_TURN_STEPS):
        if max(abs(off), abs(rate) / omega_rad_s) <= near_rad:
            break
        turning = step_heading(off, rate, 0.0, omega_rad_s, limits) * step_s
        lasts_s = step_s
        if abs(turning) < _STEADY * top:
            lasts_s = max(lasts_s, (abs(off) - run_out_m(top, gain, most)) / top)
        off -= (rate + 0.5 * turning) * lasts_s
        rate += turning
        since_s += lasts_s
    return since_s


class HeadedPlan(Plan):
    """A plan's path with a heading of its own, from the start's heading and rate on.

    The wish is followed in steps of ``WINDOW_SPACING_S`` within the limits of rate and acceleration, the shorter way;
    the steps made so far are kept.
    """

    def __init__(
        self, path: Plan, start: Reference, wish: HeadingWish, limits: MotionLimits, omega_rad_s: float
    ) -> None:
        self.start_s = path.start_s
        self._path = path
        self._wish = wish
        self._limits = limits
        self._omega_rad_s = omega_rad_s
        before = self._wish(path.sample(self.start_s))
        self._wanted = start.yaw_rad if before is None else before  # by the next step
        self._yaw, self._rate = start.yaw_rad, start.yaw_rate_rad_s
        self._nodes: list[tuple[float, float, float]] = []  # heading, rate, acceleration from there on
        self._resting = False
        self._start_yaw_rad = start.yaw_rad
        self._foreseen_yaw_rad: float | None = None

    @property
    def end_s(self) -> float:
        """End of the path."""
        return self._path.end_s

    @property
    def target(self) -> Reference:
        """End of the path, with the heading that is wanted last: foreseen, and known once the end has been stepped."""
        yaw_rad = self._wanted
        if self.start_s + len(self._nodes) * WINDOW_SPACING_S <= self.end_s:
            if self._foreseen_yaw_rad is None:
                self._foreseen_yaw_rad = self._last_wish()
            yaw_rad = self._foreseen_yaw_rad
        return replace(self._path.target, yaw_rad=wrap_pi(yaw_rad))

    def sample(self, time_s: float) -> Reference:
        """The path's reference with this heading."""
        return self._headed(self._path.sample(time_s))

    def window(self, from_s: float, count: int = WINDOW_COUNT) -> tuple[Reference, ...]:
        """The path's window with this heading."""
        return tuple(map(self._headed, self._path.window(from_s, count)))

    def _headed(self, reference: Reference) -> Reference:
        since_s = max(0.0, reference.time_s - self.start_s)
        index = floor(since_s / WINDOW_SPACING_S)
        while index >= len(self._nodes) and not self._resting:
            self._step()
        index = min(index, len(self._nodes) - 1)
        yaw, rate, acceleration = self._nodes[index]
        dt = since_s - index * WINDOW_SPACING_S
        return replace(
            reference,
            yaw_rad=wrap_pi(yaw + rate * dt + 0.5 * acceleration * dt * dt),
            yaw_rate_rad_s=rate + acceleration * dt,
        )

    @property
    def path(self) -> Plan:
        """The path, whose heading is not this plan's."""
        return self._path.path

    def polyline(self) -> Iterator[Vec3]:
        """The path's."""
        return self._path.polyline()

    def _last_wish(self) -> float:
        """The last wish of the path, looked for from its end backwards, ever more coarsely; the start's heading."""
        path, back_s, whole_s = self._path.path, 0.0, self.end_s - self.start_s
        while back_s < whole_s + WINDOW_SPACING_S:
            wanted = self._wish(path.sample(self.end_s - min(back_s, whole_s)))
            if wanted is not None:
                return wanted
            back_s += max(WINDOW_SPACING_S, _LOOK_BACK * back_s)
        return self._start_yaw_rad

    def _step(self) -> None:
        """Append the next node; the last one, at rest in the wished heading, is good for ever."""
        time_s = self.start_s + len(self._nodes) * WINDOW_SPACING_S
        now = self._wanted
        wish = self._wish(self._path.sample(time_s + WINDOW_SPACING_S))
        self._wanted = soon = now if wish is None else wish
        off, turning = wrap_pi(now - self._yaw), wrap_pi(soon - now) / WINDOW_SPACING_S
        self._resting = time_s >= self.end_s and max(abs(off), abs(self._rate), abs(turning)) < _REST
        if self._resting:
            self._nodes.append((self._yaw, 0.0, 0.0))
            return
        acceleration = step_heading(off, self._rate, turning, self._omega_rad_s, self._limits)
        self._nodes.append((self._yaw, self._rate, acceleration))
        self._yaw += (self._rate + 0.5 * acceleration * WINDOW_SPACING_S) * WINDOW_SPACING_S
        self._rate += acceleration * WINDOW_SPACING_S
