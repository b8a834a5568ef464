"""Time-optimal motion with bounded jerk as plans: to a goal, or to a hover.

Straight ahead a goal is one motion, as quick as the bounds allow. A start that moves or accelerates sideways is first
brought onto the line to the goal, within bounds that along and across share, or its velocity is turned until the goal
lies straight ahead, to one of some speeds or to a stop, after its acceleration has been taken back; then it goes
straight on with the whole bounds. The quickest of these ways is taken.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from math import atan2, cos, hypot, sin

import ruckig

from daemon.frames import add, norm, subtract, wrap_pi
from daemon.guidance.bounded_motion import (
    Motion,
    changing,
    goes_sideways,
    keeps,
    sharing,
    solve,
    straight,
    travel_heading,
)
from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan, straights
from daemon.guidance.velocity_turn import unaccelerated, velocity_towards
from daemon.messages import ZERO3, Reference, Vec3

_Goal = tuple[Vec3, float]  # place and heading

_SPEEDS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # of the bound, that a velocity is turned to on the way to a goal

_POSITION, _VELOCITY = ruckig.ControlInterface.Position, ruckig.ControlInterface.Velocity
_NO_SYNC, _IN_PHASE = ruckig.Synchronization.No, ruckig.Synchronization.Phase


class JerkLimitedPlan(Plan):
    """Motions that ruckig solved, one after the other; ``goal`` None: rest, wherever that is."""

    def __init__(self, motions: tuple[Motion, ...], limits: MotionLimits, goal: _Goal | None) -> None:
        self.start_s = motions[0].start_s
        self._motions = motions
        self._starts_s = [motion.start_s for motion in motions]
        self._limits = limits
        self._goal = goal
        self._target = motions[-1].rest()
        if goal is not None:
            self._target = replace(self._target, position_ned_m=goal[0], yaw_rad=wrap_pi(goal[1]))

    @property
    def end_s(self) -> float:
        """When the last motion ends."""
        return self._target.time_s

    @property
    def target(self) -> Reference:
        """Rest at the end."""
        return self._target

    def sample(self, time_s: float) -> Reference:
        """The motion that is flown at a time."""
        if time_s >= self.end_s:
            return replace(self._target, time_s=time_s)
        return self._motions[max(0, bisect_right(self._starts_s, time_s) - 1)].at(time_s)

    def polyline(self) -> Iterator[Vec3]:
        """From rest a straight way; else each stretch of constant jerk by its acceleration, largest at one end."""
        start = self.sample(self.start_s)
        yield start.position_ned_m
        if (start.velocity_ned_m_s, start.acceleration_ned_m_s2) != (ZERO3, ZERO3):
            for motion in self._motions:
                for begin, end in pairwise(map(motion.at, motion.bends_s())):
                    largest = max(norm(begin.acceleration_ned_m_s2), norm(end.acceleration_ned_m_s2))
                    lasts_s = end.time_s - begin.time_s
                    count = straights(lasts_s, largest)
                    for i in range(1, count + 1):
                        yield motion.at(begin.time_s + lasts_s * i / count).position_ned_m
        yield self._target.position_ned_m

    def shifted(self, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> Plan:
        """Moved with the estimate; after a velocity jump solved anew from the shifted state to the same goal."""
        if dv_ned_m_s != ZERO3 and self._goal is not None:
            now = self.sample(at_s)
            start = replace(
                now,
                position_ned_m=add(now.position_ned_m, dp_ned_m),
                velocity_ned_m_s=add(now.velocity_ned_m_s, dv_ned_m_s),
                yaw_rad=wrap_pi(now.yaw_rad + dyaw_rad),
            )
            plan = to_goal(start, add(self._goal[0], dp_ned_m), self._goal[1] + dyaw_rad, self._limits)
            if plan is not None:
                return plan
        return super().shifted(dp_ned_m, dv_ned_m_s, dyaw_rad, at_s)


def to_goal(start: Reference, position_ned_m: Vec3, yaw_rad: float, limits: MotionLimits) -> JerkLimitedPlan | None:
    """The quickest way from a flown reference to rest at a goal, heading the shorter way; None if there is none."""
    goal = (position_ned_m, yaw_rad)
    heading = _heading_to(position_ned_m, start)
    turns: Iterable[tuple[tuple[Motion, ...], float]] = (((), heading),)
    if goes_sideways(start, heading):
        turns = (*_onto_line(goal, start, heading, limits), *_curves(goal, start, limits))
    found: list[tuple[Motion, ...]] = []
    for turn, onward in turns:
        last = _straight_to(goal, _after(turn, start), onward, limits)
        found += [] if last is None else [(*turn, last)]
    if not found:
        return None
    return JerkLimitedPlan(min(found, key=_ends_s), limits, goal)


def to_hover(start: Reference, limits: MotionLimits) -> JerkLimitedPlan | None:
    """A quick motion from a flown reference to rest, wherever that is; None only if the start is not finite.

    A start that goes sideways is braked within bounds that along and across share, or its acceleration is taken back
    along itself and then it is braked straight, whichever is quicker. The second passes no limit that could be kept:
    speed is the most where it begins or where it ends.
    """
    heading = travel_heading(start)
    found: list[tuple[Motion, ...]] = []
    for wanted in sharing(start, heading, limits):
        motion = _hovering(wanted, start, heading)
        if motion is not None and keeps(wanted, motion, start, limits):
            found.append((motion,))
            break
    if goes_sideways(start, heading):
        found += _levelled_first(start, limits)
    return JerkLimitedPlan(min(found, key=_ends_s), limits, None) if found else None


def _levelled_first(start: Reference, limits: MotionLimits) -> list[tuple[Motion, ...]]:
    """A brake that takes the acceleration back first, if there is one."""
    first = _changed(start, unaccelerated(start, limits), limits)
    if first is None:
        return []
    onward = _after((first,), start)
    heading = travel_heading(onward)
    last = _hovering(straight(onward, heading, limits), onward, heading)
    return [] if last is None else [(first, last)]


def _ends_s(motions: tuple[Motion, ...]) -> float:
    return motions[-1].end_s


def _hovering(wanted: ruckig.InputParameter, start: Reference, heading_rad: float) -> Motion | None:
    wanted.control_interface = _VELOCITY
    wanted.synchronization = _NO_SYNC
    return _solved(wanted, start, heading_rad)


def _heading_to(position_ned_m: Vec3, start: Reference) -> float:
    """Direction of a goal; of the start's motion when that is straight above or below."""
    north = position_ned_m[0] - start.position_ned_m[0]
    east = position_ned_m[1] - start.position_ned_m[1]
    return atan2(east, north) if hypot(north, east) > 0.0 else travel_heading(start)


def _offset(goal: _Goal, start: Reference, heading_rad: float) -> list[float]:
    """The goal as ruckig's target, seen from the start along a line that leads to it, forwards or backwards."""
    north, east, down = (wanted - now for wanted, now in zip(goal[0], start.position_ned_m, strict=True))
    along = north * cos(heading_rad) + east * sin(heading_rad)
    return [along, 0.0, down, start.yaw_rad + wrap_pi(goal[1] - start.yaw_rad)]


def _straight_to(goal: _Goal, start: Reference, heading_rad: float, limits: MotionLimits) -> Motion | None:
    """The motion along a line to rest at the goal on it; height keeps pace, in phase where it can."""
    wanted = straight(start, heading_rad, limits)
    wanted.target_position = _offset(goal, start, heading_rad)
    wanted.synchronization = _IN_PHASE
    wanted.per_dof_synchronization = [_IN_PHASE] * 3 + [_NO_SYNC]
    return _solved(wanted, start, heading_rad)


def _onto_line(
    goal: _Goal, start: Reference, heading_rad: float, limits: MotionLimits
) -> Iterator[tuple[tuple[Motion, ...], float]]:
    """Ways to come onto the line to the goal, and its direction; height and heading go to the goal's meanwhile."""
    for wanted in sharing(start, heading_rad, limits):
        wanted.per_dof_control_interface = [_POSITION] * 4
        wanted.target_position = _offset(goal, start, heading_rad)
        wanted.synchronization = _NO_SYNC
        whole = _solved(wanted, start, heading_rad)
        if whole is not None:
            turn = replace(whole, duration_s=whole.trajectory.independent_min_durations[1])
            if keeps(wanted, turn, start, limits):
                yield (turn,), heading_rad


def _curves(goal: _Goal, start: Reference, limits: MotionLimits) -> Iterator[tuple[tuple[Motion, ...], float]]:
    """Ways to turn the velocity towards the goal, or to a stop, and the direction after each."""
    begun: tuple[Motion, ...] = ()
    if hypot(*start.acceleration_ned_m_s2[:2]) > 0.0:
        first = _changed(start, unaccelerated(start, limits), limits, goal)
        if first is None:
            return
        begun = (first,)
    now = _after(begun, start)
    (vx, vy, _), (x, y, _) = now.velocity_ned_m_s, subtract(goal[0], now.position_ned_m)
    for share in _SPEEDS:
        wanted = velocity_towards((vx, vy), (x, y), share * limits.speed_m_s, limits) if share > 0.0 else (0.0, 0.0)
        turn = wanted and _changed(now, wanted, limits, goal)
        if turn is None:
            continue
        after = turn.at(turn.end_s)
        onward = _heading_to(goal[0], after)
        if not goes_sideways(after, onward):
            yield (*begun, turn), onward


def _changed(
    start: Reference, velocity_m_s: tuple[float, float], limits: MotionLimits, goal: _Goal | None = None
) -> Motion | None:
    """The change to a horizontal velocity; height and heading are braked, or go to a goal's."""
    heading, wanted = changing(start, velocity_m_s, limits)
    if goal is not None:
        wanted.per_dof_control_interface = [_VELOCITY, _VELOCITY, _POSITION, _POSITION]
        wanted.target_position = _offset(goal, start, heading)
    whole = _solved(wanted, start, heading)
    return None if whole is None else replace(whole, duration_s=whole.trajectory.independent_min_durations[0])


def _after(motions: tuple[Motion, ...], start: Reference) -> Reference:
    return motions[-1].at(motions[-1].end_s) if motions else start


def _solved(wanted: ruckig.InputParameter, start: Reference, heading_rad: float) -> Motion | None:
    trajectory = solve(wanted)
    if trajectory is None:
        return None
    return Motion(
        trajectory=trajectory,
        heading_rad=heading_rad,
        origin_ned_m=start.position_ned_m,
        start_s=start.time_s,
        duration_s=float(trajectory.duration),
    )
