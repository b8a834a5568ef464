"""Whether a goal can be flown, decided when it is accepted: the field at fault and the reason in words."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, degrees, floor, hypot, isfinite, pi, radians

from daemon.frames import is_finite, norm, scale, subtract, tilt_of, wrap_pi
from daemon.guidance.brake import brake
from daemon.guidance.convergence import Tolerance
from daemon.guidance.goals import Goal, PathGoal, PolynomialGoal, ShapeGoal, StreamGoal, WaypointGoal
from daemon.guidance.heading import (
    DEAD_BAND_M,
    DEAD_BAND_M_S,
    FixedHeading,
    Heading,
    PointHeading,
    VelocityHeading,
    wish_of,
)
from daemon.guidance.limits import MotionLimits, motion_excess
from daemon.guidance.plan import Plan
from daemon.guidance.polynomial import PolynomialPlan
from daemon.guidance.shapes import Circle
from daemon.messages import Reference, Vec3

_MOST_TILT_RAD = radians(1.0)
_PHASES = 72  # at which a shape's derivatives are looked at
_HEADINGS = 360  # phases between which a shape's heading is looked at
_FOLLOWED = 0.9  # of the yaw rate's limit: with nothing left a heading that is behind would never catch up
_OUTLINE = 60  # instants at which the brake after a polynomial is looked at


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a goal is not taken: a path such as ``waypoint.position[2]``, and the reason in words."""

    field: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """What a goal may be at most.

    ``fence`` says by (axis, reason) where a position is outside, None inside. ``between`` names the places of a
    straight way between two positions that have to be asked for besides its ends.
    """

    limits: MotionLimits
    fence: Callable[[Vec3], tuple[int, str] | None] = lambda _: None
    between: Callable[[Vec3, Vec3], tuple[Vec3, ...]] = lambda _start, _end: ()
    max_distance_m: float = 1000.0  # of any point of the goal from the vehicle
    max_waypoints: int = 50
    max_duration_s: float = 3600.0
    max_stream_timeout_s: float = 2.0  # a streamed reference is carried on for so long, each time that one comes


def refusal(goal: Goal, start: Reference, reach: Reach) -> Refusal | None:
    """The first thing wrong with a goal itself, seen from the flown reference; None when nothing is.

    ``path_refusal`` then checks the way there, on the plan.
    """
    return next(_refusals(goal, start, reach), None)


def path_refusal(plan: Plan, goal: Goal, reach: Reach) -> Refusal | None:
    """What is wrong with the way to a goal and along it, the overshoot of a moving start included.

    A start outside of the fence is not held against a plan that leads back in: what comes after the first place
    inside counts, and the end. The plan's polyline is looked at, so that nothing of the way passes unseen however long
    it takes. A polynomial's motion is held against the limits too. Costs 0.1 to 2 ms.
    """
    lasts_s = plan.end_s - plan.start_s + _stay_s(goal)
    allowed_s = 2.0 * reach.max_duration_s  # the goal, and the way there
    if not lasts_s <= allowed_s:
        takes = f"{lasts_s:.5g} s" if isfinite(lasts_s) else "too long to be planned"
        return Refusal(_place_of(goal), f"takes {takes}; at most {allowed_s:g} s are allowed")
    if isinstance(goal, PolynomialGoal):
        pushed = PolynomialPlan(plan.path.sample(plan.start_s), goal.jerk_ned_m_s3, goal.duration_s)
        for reference in (*pushed.extremes(), *brake(pushed.target, reach.limits).outline(_OUTLINE)):
            excess = motion_excess(reference.velocity_ned_m_s, reference.acceleration_ned_m_s2, reach.limits)
            if excess is not None:
                return Refusal("trajectory.jerk_m_s3", f"after some time {excess[1]}")
    return way_refusal(plan, _place_of(goal), reach)


def way_refusal(plan: Plan, field: str, reach: Reach) -> Refusal | None:
    """Where a plan leaves the fence, as a refusal of a field."""
    inside = False
    for place in _places(plan, reach):
        found = reach.fence(place)
        inside = inside or found is None
        if inside and found is not None:
            return Refusal(f"{field}[{found[0]}]", f"on the way: {found[1]}")
    end = reach.fence(plan.path.target.position_ned_m)
    return None if end is None else Refusal(f"{field}[{end[0]}]", end[1])


def _places(plan: Plan, reach: Reach) -> Iterator[Vec3]:
    """The places to ask the fence for: where the plan's path bends, and what lies between."""
    yield plan.path.sample(plan.start_s).position_ned_m
    for start, end in pairwise(plan.path.polyline()):
        yield from reach.between(start, end)
        yield end


def _stay_s(goal: Goal) -> float:
    """How long a goal stays in its last waypoint, which is not planned: it begins when the vehicle has converged."""
    last = goal.waypoints[-1] if isinstance(goal, PathGoal) else goal
    return last.hold_s if isinstance(last, WaypointGoal) else 0.0


def _place_of(goal: Goal) -> str:
    """The field that a way out of the fence is blamed on."""
    if isinstance(goal, WaypointGoal):
        return "waypoint.position"
    if isinstance(goal, PathGoal):
        return "path.waypoints"
    if isinstance(goal, StreamGoal):
        return "stream"
    return "trajectory.center" if isinstance(goal, ShapeGoal) else "trajectory"


def _refusals(goal: Goal, start: Reference, reach: Reach) -> Iterator[Refusal]:
    """All that is wrong, worked out as far as it is asked for."""
    if isinstance(goal, WaypointGoal):
        yield from _waypoint(goal, "waypoint", start, reach)
    elif isinstance(goal, PathGoal):
        count = len(goal.waypoints)
        if not 1 <= count <= reach.max_waypoints:
            yield Refusal("path.waypoints", f"{count} waypoints are not within 1 to {reach.max_waypoints}")
        for i, waypoint in enumerate(goal.waypoints):
            yield from _waypoint(waypoint, f"path.waypoints[{i}]", start, reach)
    elif isinstance(goal, ShapeGoal):
        yield from _shape(goal, start, reach)
    elif isinstance(goal, PolynomialGoal):
        yield from _polynomial(goal, start, reach)
    elif isinstance(goal, StreamGoal):
        if not 0.0 < goal.timeout_s <= reach.max_stream_timeout_s:
            most = f"{reach.max_stream_timeout_s:g} s"
            yield Refusal("stream.timeout_s", f"{goal.timeout_s:g} s are not within 0 to {most}")
    else:
        yield from _duration(goal.duration_s, "trajectory.duration_s", reach)


def _waypoint(goal: WaypointGoal, field: str, start: Reference, reach: Reach) -> Iterator[Refusal]:
    if goal.position_ned_m is not None:
        yield from _finite(goal.position_ned_m, f"{field}.position")
        yield from _near(goal.position_ned_m, f"{field}.position", start, reach)
        found = reach.fence(goal.position_ned_m)
        if found is not None:
            yield Refusal(f"{field}.position[{found[0]}]", found[1])
    if goal.attitude_wb is not None:
        yield from _finite(goal.attitude_wb, f"{field}.orientation")
        if not 0.99 < hypot(*goal.attitude_wb) < 1.01:
            yield Refusal(f"{field}.orientation", "is not a unit quaternion")
        tilt_rad = tilt_of(goal.attitude_wb)
        if tilt_rad > _MOST_TILT_RAD:
            reason = f"tilts by {degrees(tilt_rad):.1f} deg; at rest a multirotor is level: 1 deg at most"
            yield Refusal(f"{field}.orientation", reason)
    yield from _duration(goal.hold_s, f"{field}.hold_s", reach)
    if isinstance(goal.convergence, Tolerance):
        yield from _duration(goal.convergence.dwell_s, f"{field}.convergence.dwell_s", reach)


def _shape(goal: ShapeGoal, start: Reference, reach: Reach) -> Iterator[Refusal]:
    shape = goal.shape
    yield from _finite(shape.center_ned_m, "trajectory.center")
    yield from _near(shape.center_ned_m, "trajectory.center", start, reach)
    if not is_finite(shape.axis_ned) or norm(shape.axis_ned) < 1e-6:
        yield Refusal("trajectory.axis", "has no direction")
    field, lengths = ("radius_m", (shape.radius_m,)) if isinstance(shape, Circle) else ("size_m", shape.size_m)
    for length in lengths:
        if not 0.0 < length <= reach.max_distance_m:
            yield Refusal(f"trajectory.{field}", f"{length:g} m is not within 0 to {reach.max_distance_m:g} m")
    field = "trajectory.period_s" if goal.speed_m_s is None else "trajectory.speed_m_s"
    rate = abs(goal.rate_rad_s)
    if not (isfinite(rate) and rate > 0.0):
        yield Refusal(field, "is not a positive, finite number")
    if not goal.turns > 0.0:
        yield Refusal("trajectory.turns", f"{goal.turns:g} is not more than 0")
    yield from _duration(goal.turns * 2.0 * pi / rate, "trajectory.turns", reach)
    yield from _heading(goal.heading, start, reach)
    for i in range(_PHASES):
        yield from _shape_at(goal, 2.0 * pi * i / _PHASES, field, reach)
    yield from _turning(goal, field, reach)


def _shape_at(goal: ShapeGoal, phase_rad: float, field: str, reach: Reach) -> Iterator[Refusal]:
    """A shape at one phase: inside the fence, and within the limits at the rate wanted."""
    position, first, second, third = goal.shape.at(phase_rad)
    rate = goal.rate_rad_s  # multiplied, not raised to a power: that raises where it is too large for a number
    found = reach.fence(position)
    if found is not None:
        yield Refusal(f"trajectory.center[{found[0]}]", f"on the way round: {found[1]}")
    excess = motion_excess(scale(first, rate), scale(second, rate * rate), reach.limits)
    if excess is not None:
        yield Refusal(field, f"on this shape {excess[1]}")
    yield from _jerk(scale(third, rate * rate * rate), field, "on this shape ", reach)


def _turning(goal: ShapeGoal, field: str, reach: Reach) -> Iterator[Refusal]:
    """A heading that turns faster on the way round than can be followed; where it is left as it is, nothing counts."""
    if isinstance(goal.heading, FixedHeading):
        return
    wish = wish_of(goal.heading, goal.shape.center_ned_m, 0.0)
    wishes = []
    for i in range(_HEADINGS + 1):
        position, along, *_ = goal.shape.at(2.0 * pi * i / _HEADINGS)
        wishes.append(wish(Reference(0.0, position, scale(along, goal.rate_rad_s))))
    if not isinstance(goal.heading, VelocityHeading) and not any(wish is not None for wish in wishes):
        near = f"what is looked at is within {DEAD_BAND_M:g} m all the way round"
        yield Refusal("trajectory.heading", f"turns nowhere on this shape: {near}")
    turns = [abs(wrap_pi(b - a)) for a, b in pairwise(wishes) if a is not None and b is not None]
    needed = max(turns, default=0.0) * _HEADINGS / (2.0 * pi) * abs(goal.rate_rad_s)
    most = _FOLLOWED * reach.limits.yaw_rate_rad_s
    if needed > most:
        if _too_slow_to_head(goal, most / needed):
            would_do = f"none does: below {DEAD_BAND_M_S:g} m/s no heading is along the flight"
        elif goal.speed_m_s is None:
            would_do = f"at least {ceil(10.0 * (goal.period_s or 0.0) * needed / most) / 10.0:g} s"
        else:
            would_do = f"at most {floor(100.0 * goal.speed_m_s * most / needed) / 100.0:g} m/s"
        turning = f"its heading turns by up to {degrees(needed):.0f} deg/s"
        yield Refusal(field, f"on this shape {turning}; {degrees(most):.0f} deg/s can be followed: {would_do}")


def _too_slow_to_head(goal: ShapeGoal, share: float) -> bool:
    """Whether at this share of its rate a shape is flown too slowly for a heading along the velocity."""
    slowed = share * abs(goal.rate_rad_s) * goal.shape.path_speed_m
    return isinstance(goal.heading, VelocityHeading) and slowed <= DEAD_BAND_M_S


def _polynomial(goal: PolynomialGoal, start: Reference, reach: Reach) -> Iterator[Refusal]:
    yield from _finite(goal.jerk_ned_m_s3, "trajectory.jerk_m_s3")
    yield from _jerk(goal.jerk_ned_m_s3, "trajectory.jerk_m_s3", "", reach)
    yield from _duration(goal.duration_s, "trajectory.duration_s", reach)
    yield from _heading(goal.heading, start, reach)


def _finite(values: tuple[float, ...], field: str) -> Iterator[Refusal]:
    for i, value in enumerate(values):
        if not isfinite(value):
            yield Refusal(f"{field}[{i}]", f"{value} is not finite")


def _near(position: Vec3, field: str, start: Reference, reach: Reach) -> Iterator[Refusal]:
    distance = norm(subtract(position, start.position_ned_m))
    if distance > reach.max_distance_m:
        yield Refusal(field, f"is {distance:.4g} m away; at most {reach.max_distance_m:g} m are allowed")


def _duration(value_s: float, field: str, reach: Reach) -> Iterator[Refusal]:
    if not 0.0 <= value_s <= reach.max_duration_s:
        yield Refusal(field, f"{value_s:g} s are not within 0 to {reach.max_duration_s:g} s")


def _heading(heading: Heading, start: Reference, reach: Reach) -> Iterator[Refusal]:
    if isinstance(heading, PointHeading):
        yield from _finite(heading.point_ned_m, "trajectory.heading.point")
        yield from _near(heading.point_ned_m, "trajectory.heading.point", start, reach)


def _jerk(jerk_ned_m_s3: Vec3, field: str, where: str, reach: Reach) -> Iterator[Refusal]:
    jx, jy, jz = jerk_ned_m_s3
    worst, most = max(hypot(jx, jy), abs(jz)), reach.limits.jerk_m_s3
    if worst > most * (1.0 + 1e-6):
        yield Refusal(field, f"{where}{worst:.2f} m/s^3 is more than the {most:g} m/s^3 allowed")
