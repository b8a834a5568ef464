"""A plan: the reference as a function of time, from the flown state to rest at a goal."""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import replace
from math import ceil, sqrt

from daemon.frames import add, norm, scale, wrap_pi
from daemon.messages import WINDOW_SPACING_S, ZERO3, Reference, Vec3

WINDOW_COUNT = 60  # samples of a window: 0.6 s, a tenth more than must be there
STRAY_M = 0.2  # by which the straight ways between the places of a polyline may miss the path
_LOOK_S = 0.2  # between two places of a motion of which nothing is known: at 10 m/s^2 it strays by 5 cm
_RESET_ACCELERATION_M_S2 = 1.0  # what taking a velocity reset out of the reference may ask for on top of the plan
_DECAY_PEAK = 6.0  # bounds |f''| of the decay below on [0, 1]


class Plan(ABC):
    """The reference from ``start_s`` on; times are those of the clock the start was given in."""

    start_s: float

    @property
    @abstractmethod
    def end_s(self) -> float:
        """When the reference rests at the goal; an estimate that can be flown, infinite for a stream."""

    @property
    @abstractmethod
    def target(self) -> Reference:
        """The reference at rest at the end; its time is ``end_s``."""

    @abstractmethod
    def sample(self, time_s: float) -> Reference:
        """The reference at a time; before the start the start's, after the end the target."""

    def window(self, from_s: float, count: int = WINDOW_COUNT) -> tuple[Reference, ...]:
        """``count`` references from ``from_s`` on at ``WINDOW_SPACING_S``."""
        return tuple(self.sample(from_s + i * WINDOW_SPACING_S) for i in range(count))

    @property
    def path(self) -> "Plan":
        """The same way through space, cheap to look at far ahead: coarse where it is stepped, and without a heading."""
        return self

    def progress(self, time_s: float) -> float:
        """Share of the plan's time that has gone by, 0 to 1."""
        whole_s = self.end_s - self.start_s
        return 1.0 if whole_s <= 0.0 else min(1.0, max(0.0, (time_s - self.start_s) / whole_s))

    def outline(self, count: int = 100) -> tuple[Reference, ...]:
        """``count`` references spread over the whole plan's time: its path, to look at."""
        path, spacing_s = self.path, (self.end_s - self.start_s) / max(1, count - 1)
        return tuple(path.sample(self.start_s + i * spacing_s) for i in range(count))

    def polyline(self) -> Iterator[Vec3]:
        """Places from the start to the target whose straight connections stay within ``STRAY_M`` of the path.

        Plans that know their way name no more than it takes, however long it lasts: a rest is one place, of the turns
        of a shape the first is all. Ask the ``path`` for it, which is cheap to look at far ahead.
        """
        for i in range(ceil((self.end_s - self.start_s) / _LOOK_S)):
            yield self.sample(self.start_s + i * _LOOK_S).position_ned_m
        yield self.target.position_ned_m

    def shifted(self, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> "Plan":
        """The same plan after the estimate jumped by these amounts at ``at_s``: it keeps its physical place."""
        return ShiftedPlan(self, dp_ned_m, dv_ned_m_s, dyaw_rad, at_s)

    def remaining(self, _from_s: float) -> "Plan":
        """The same plan from a time on, without the plans that are over by then."""
        return self


class HoldPlan(Plan):
    """Rest in a place and heading, for a time."""

    def __init__(self, place: Reference, duration_s: float = 0.0) -> None:
        self.start_s = place.time_s
        self._duration_s = duration_s
        self._place = Reference(place.time_s, place.position_ned_m, yaw_rad=place.yaw_rad)

    @property
    def end_s(self) -> float:
        """When the time is over."""
        return self.start_s + self._duration_s

    @property
    def target(self) -> Reference:
        """The place."""
        return self._place

    def sample(self, time_s: float) -> Reference:
        """The place."""
        return replace(self._place, time_s=time_s)

    def polyline(self) -> Iterator[Vec3]:
        """The place."""
        yield self._place.position_ned_m


class SequencePlan(Plan):
    """Plans one after the other, each starting in the state and at the time in which the one before it ends."""

    def __init__(self, legs: tuple[Plan, ...]) -> None:
        self.start_s = legs[0].start_s
        self._legs = legs
        self._starts_s = [leg.start_s for leg in legs]

    @property
    def end_s(self) -> float:
        """End of the last leg."""
        return self._legs[-1].end_s

    @property
    def target(self) -> Reference:
        """Target of the last leg."""
        return self._legs[-1].target

    @property
    def path(self) -> Plan:
        """The legs' paths."""
        return SequencePlan(tuple(leg.path for leg in self._legs))

    def sample(self, time_s: float) -> Reference:
        """The reference of the leg that is being flown then."""
        return self._legs[max(0, bisect_right(self._starts_s, time_s) - 1)].sample(time_s)

    def polyline(self) -> Iterator[Vec3]:
        """The legs' polylines; between two legs the plan rests."""
        for leg in self._legs:
            yield from leg.polyline()


class JoinedPlan(Plan):
    """A plan that starts some time ahead, and what is flown until then; all but ``sample`` tells of the plan alone."""

    def __init__(self, before: Plan, plan: Plan) -> None:
        self.start_s = plan.start_s
        self._before = before
        self._plan = plan

    @property
    def end_s(self) -> float:
        """End of the plan."""
        return self._plan.end_s

    @property
    def target(self) -> Reference:
        """The plan's target."""
        return self._plan.target

    @property
    def path(self) -> Plan:
        """The plan's path."""
        return self._plan.path

    def sample(self, time_s: float) -> Reference:
        """The reference of what is flown then."""
        return (self._before if time_s < self.start_s else self._plan).sample(time_s)

    def remaining(self, from_s: float) -> Plan:
        """The plan alone once it has started: a chain of goals that are planned ahead does not grow."""
        if from_s >= self.start_s:
            return self._plan
        return JoinedPlan(self._before.remaining(from_s), self._plan)


class ShiftedPlan(Plan):
    """A plan moved by a position and a heading; a velocity jump is taken over at once and taken out again smoothly.

    The way it takes is ``dv T f(s)``, ``f = s (1 - s)^3 (1 + 3 s)``, ``s = (t - at) / T``: velocity dv and no
    acceleration at the beginning, nothing at the end.
    """

    def __init__(self, plan: Plan, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> None:
        self._plan = plan
        self._dp = dp_ned_m
        self._dv = dv_ned_m_s
        self._dyaw = dyaw_rad
        self._at_s = at_s
        self._decay_s = norm(dv_ned_m_s) * _DECAY_PEAK / _RESET_ACCELERATION_M_S2
        self.start_s = plan.start_s

    @property
    def end_s(self) -> float:
        """End of the plan, or of the velocity's decay when that is later."""
        return max(self._plan.end_s, self._at_s + self._decay_s)

    @property
    def target(self) -> Reference:
        """The plan's target where it is called now."""
        target = self._plan.target
        return replace(
            target,
            time_s=self.end_s,
            position_ned_m=add(target.position_ned_m, self._dp),
            yaw_rad=wrap_pi(target.yaw_rad + self._dyaw),
        )

    @property
    def path(self) -> Plan:
        """The plan's path, moved."""
        return ShiftedPlan(self._plan.path, self._dp, self._dv, self._dyaw, self._at_s)

    def sample(self, time_s: float) -> Reference:
        """The plan's reference, moved."""
        reference = self._plan.sample(time_s)
        moved = replace(
            reference,
            position_ned_m=add(reference.position_ned_m, self._dp),
            yaw_rad=wrap_pi(reference.yaw_rad + self._dyaw),
        )
        since_s = time_s - self._at_s
        if not 0.0 <= since_s < self._decay_s:
            return moved
        f, f1, f2, f3 = _decay(since_s / self._decay_s)
        whole_s = self._decay_s
        return replace(
            moved,
            position_ned_m=add(moved.position_ned_m, scale(self._dv, f * whole_s)),
            velocity_ned_m_s=add(moved.velocity_ned_m_s, scale(self._dv, f1)),
            acceleration_ned_m_s2=add(moved.acceleration_ned_m_s2, scale(self._dv, f2 / whole_s)),
            jerk_ned_m_s3=add(moved.jerk_ned_m_s3, scale(self._dv, f3 / whole_s**2)),
        )

    def shifted(self, dp_ned_m: Vec3, dv_ned_m_s: Vec3, dyaw_rad: float, at_s: float) -> Plan:
        """Moved further; mere positions and headings add up, so that a long hold does not pile up layers."""
        if dv_ned_m_s == ZERO3:
            return ShiftedPlan(self._plan, add(self._dp, dp_ned_m), self._dv, self._dyaw + dyaw_rad, self._at_s)
        return ShiftedPlan(self, dp_ned_m, dv_ned_m_s, dyaw_rad, at_s).remaining(at_s)

    def remaining(self, from_s: float) -> Plan:
        """What remains of the plan, moved; a jump within it whose velocity is taken out by then adds up too."""
        inner = self._plan.remaining(from_s)
        if isinstance(inner, ShiftedPlan) and from_s >= inner._at_s + inner._decay_s:
            dp, dyaw = add(self._dp, inner._dp), self._dyaw + inner._dyaw
            return ShiftedPlan(inner._plan, dp, self._dv, dyaw, self._at_s)
        return ShiftedPlan(inner, self._dp, self._dv, self._dyaw, self._at_s)


def straights(duration_s: float, acceleration_m_s2: float) -> int:
    """How many straight ways a motion takes that strays by a t^2 / 8 from each: ``STRAY_M`` at most."""
    return max(1, ceil(duration_s * sqrt(acceleration_m_s2 / (8.0 * STRAY_M))))


def _decay(s: float) -> tuple[float, float, float, float]:
    """f = s (1 - s)^3 (1 + 3 s) = s - 6 s^3 + 8 s^4 - 3 s^5 and its three derivatives."""
    return (
        s - 6.0 * s**3 + 8.0 * s**4 - 3.0 * s**5,
        1.0 - 18.0 * s**2 + 32.0 * s**3 - 15.0 * s**4,
        -36.0 * s + 96.0 * s**2 - 60.0 * s**3,
        -36.0 + 192.0 * s - 180.0 * s**2,
    )
