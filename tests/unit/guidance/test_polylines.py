"""What a plan's way is made of when it is held against the fence: near what is flown, and short whatever the time."""

from math import dist

import numpy as np
import pytest

from daemon.guidance.goals import Goal, HoldGoal, PathGoal, PolynomialGoal, ShapeGoal, Through, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.plan import Plan
from daemon.guidance.planner import plan
from daemon.guidance.polynomial import PolynomialPlan
from daemon.guidance.shapes import Circle, Lemniscate
from daemon.messages import Reference, Vec3

LIMITS = MotionLimits()
STRAY_M = 0.25
REST = Reference(100.0, (0.0, 0.0, -5.0))
MOVING = Reference(100.0, (0.0, 0.0, -5.0), (1.0, -4.0, 0.5), (1.0, 1.5, 0.0))
AROUND = tuple(
    WaypointGoal(position_ned_m=place) for place in ((30.0, 0.0, -6.0), (30.0, 25.0, -9.0), (3.0, 4.0, -5.0))
)
GOALS: dict[str, Goal] = {
    "waypoint": WaypointGoal(position_ned_m=(50.0, 20.0, -12.0)),
    "path, stopping": PathGoal(waypoints=AROUND),
    "path, fly-by": PathGoal(waypoints=AROUND, through=Through.FLY_BY),
    "circle": ShapeGoal(shape=Circle(center_ned_m=(0.0, 30.0, -8.0), radius_m=12.0), speed_m_s=4.0, turns=2.3),
    "part of a circle": ShapeGoal(
        shape=Circle(center_ned_m=(0.0, 30.0, -8.0), radius_m=12.0), speed_m_s=4.0, turns=0.4, clockwise=False
    ),
    "lemniscate": ShapeGoal(shape=Lemniscate(center_ned_m=(10.0, 0.0, -8.0), size_m=(14.0, 3.0)), speed_m_s=3.0),
    "polynomial": PolynomialGoal(jerk_ned_m_s3=(0.5, 0.4, -0.1), duration_s=2.0),
    "hold": HoldGoal(duration_s=5.0),
}


def planned(goal: Goal, start: Reference, profile: Profile = Profile.JERK_LIMITED) -> Plan:
    return plan(start, goal, LIMITS, GuidanceParameters(profile=profile))


def places(flown: Plan) -> tuple[Vec3, ...]:
    return tuple(flown.path.polyline())


def distance_m(place: Vec3, corners: tuple[Vec3, ...]) -> float:
    """From a place to the nearest of the straight ways between corners."""
    begins, ends = np.array(corners[:1] + corners[:-1]), np.array(corners)
    ways, away = ends - begins, np.array(place) - begins
    share = np.clip((ways * away).sum(axis=1) / np.maximum((ways * ways).sum(axis=1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(away - share[:, None] * ways, axis=1).min())


@pytest.mark.parametrize("start", [REST, MOVING], ids=["at rest", "moving"])
@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS.keys())
@pytest.mark.parametrize("profile", Profile)
def test_what_is_flown_is_near_the_polyline(goal: Goal, start: Reference, profile: Profile) -> None:
    flown = planned(goal, start, profile)
    corners = places(flown)
    assert corners[0] == pytest.approx(start.position_ned_m)
    for i in range(1000):
        at_s = flown.start_s + (flown.end_s - flown.start_s) * i / 999
        assert distance_m(flown.sample(at_s).position_ned_m, corners) < STRAY_M


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS.keys())
def test_the_polyline_is_near_what_is_flown(goal: Goal) -> None:
    flown = planned(goal, MOVING)
    count = round((flown.end_s - flown.start_s) / 0.01)
    track = tuple(flown.sample(flown.start_s + 0.01 * i).position_ned_m for i in range(count + 1))
    for place in places(flown):
        assert distance_m(place, track) < STRAY_M


def test_rests_and_further_turns_add_nothing() -> None:
    def around(turns: float) -> ShapeGoal:
        return ShapeGoal(shape=Circle(center_ned_m=(0.0, 30.0, -8.0), radius_m=12.0), speed_m_s=4.0, turns=turns)

    def resting(hold_s: float) -> PathGoal:
        waypoints = ((30.0, 0.0, -6.0), (30.0, 25.0, -9.0), (3.0, 4.0, -5.0))
        return PathGoal(waypoints=tuple(WaypointGoal(position_ned_m=place, hold_s=hold_s) for place in waypoints))

    assert places(planned(around(150.0), MOVING)) == places(planned(around(1.0), MOVING))
    np.testing.assert_allclose(places(planned(resting(3000.0), MOVING)), places(planned(resting(0.0), MOVING)))
    assert len(places(planned(HoldGoal(duration_s=3600.0), REST))) < 10


def test_straight_legs_from_rest_are_as_many_as_the_waypoints() -> None:
    far = tuple(WaypointGoal(position_ned_m=((-1.0) ** i * 900.0, 10.0 * i, -20.0 - i)) for i in range(50))
    corners = places(planned(PathGoal(waypoints=far), REST))
    assert len(corners) == 100  # the two ends of each leg
    for waypoint in far:
        assert waypoint.position_ned_m is not None
        assert min(dist(waypoint.position_ned_m, corner) for corner in corners) < 1e-9


def test_a_slow_plan_is_as_short_as_its_way() -> None:
    slow = LIMITS.tightened(speed_m_s=0.2)
    moving = Reference(0.0, (0.0, 0.0, -5.0), (0.1, 0.1, 0.0))
    goal = WaypointGoal(position_ned_m=(0.0, 300.0, -5.0))
    corners = tuple(plan(moving, goal, slow, GuidanceParameters(profile=Profile.JERK_LIMITED)).path.polyline())
    assert len(corners) < 100


@pytest.mark.parametrize("jerk", [(0.0, 0.0, 0.0), (1e-6, 0.0, 0.0)])
def test_an_hour_of_next_to_no_jerk_is_a_few_places(jerk: Vec3) -> None:
    drifting = Reference(0.0, (0.0, 0.0, -5.0), (0.5, 0.0, 0.0))
    corners = tuple(PolynomialPlan(drifting, jerk, 3600.0).polyline())
    assert 2 <= len(corners) < 500
