"""What planning costs: to accept a goal, from the goal to its first reference window, and each window after it."""

from math import cos, pi, sin
from time import perf_counter

from daemon.bench.quantiles import quantile
from daemon.guidance import planner, reachability
from daemon.guidance.goals import Goal, PathGoal, ShapeGoal, Through, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.reachability import Reach
from daemon.guidance.shapes import Circle, Lemniscate
from daemon.messages import Reference
from daemon.safety.geofence import Geofence, between, violation

WINDOW = 100
WINDOWS = 20
START = Reference(0.0, (0.0, 0.0, -5.0), (1.0, -0.5, 0.2), (0.2, 0.1, 0.0))
OCTAGON = tuple((200.0 * cos(0.25 * pi * i), 200.0 * sin(0.25 * pi * i)) for i in range(8))
FENCE = Geofence(polygon_ne_m=OCTAGON, ceiling_m=100.0)


def goals() -> dict[str, tuple[Goal, Profile]]:
    """One goal of each kind, by name, with the profile it is planned with."""

    def around(count: int) -> tuple[WaypointGoal, ...]:
        turns = [2.0 * pi * i / count for i in range(count)]
        places = [(20.0 * cos(turn), 20.0 * sin(2.0 * turn), -6.0 - sin(turn)) for turn in turns]
        return tuple(WaypointGoal(position_ned_m=place) for place in places)

    far = WaypointGoal(position_ned_m=(30.0, -20.0, -12.0))
    circle = ShapeGoal(shape=Circle(center_ned_m=(0.0, 0.0, -5.0), radius_m=8.0), speed_m_s=3.0, turns=3)
    eight = ShapeGoal(shape=Lemniscate(center_ned_m=(0.0, 0.0, -5.0), size_m=(10.0, 5.0)), speed_m_s=3.0, turns=3)
    return {
        "waypoint, jerk-limited": (far, Profile.JERK_LIMITED),
        "waypoint, reference filter": (far, Profile.REFERENCE_FILTER),
        "circle": (circle, Profile.JERK_LIMITED),
        "lemniscate": (eight, Profile.JERK_LIMITED),
        "path of 10, stopping": (PathGoal(waypoints=around(10)), Profile.JERK_LIMITED),
        "path of 10, fly-by (beside the loop)": (
            PathGoal(waypoints=around(10), through=Through.FLY_BY),
            Profile.JERK_LIMITED,
        ),
        "path of 50, fly-by (beside the loop)": (
            PathGoal(waypoints=around(50), through=Through.FLY_BY),
            Profile.JERK_LIMITED,
        ),
    }


def measure(rounds: int) -> dict[str, dict[str, float]]:
    """Milliseconds, p50 and p99: ``check`` for all that decides whether a goal in a fence of eight corners is taken,
    ``plan`` with its first window, and ``window`` for each further one."""
    limits = MotionLimits()
    reach = Reach(
        limits=limits,
        fence=lambda position: violation(FENCE, position),
        between=lambda start, end: between(FENCE, start, end),
    )
    figures = {}
    for name, (goal, profile) in goals().items():
        parameters = GuidanceParameters(profile=profile)
        checks, plans, windows = [], [], []
        for _ in range(rounds):
            begun_s = perf_counter()
            reachability.refusal(goal, START, reach)
            reachability.path_refusal(planner.plan(START, goal, limits, parameters), goal, reach)
            checks.append(1e3 * (perf_counter() - begun_s))
            begun_s = perf_counter()
            plan = planner.plan(START, goal, limits, parameters)
            plan.window(0.0, WINDOW)
            plans.append(1e3 * (perf_counter() - begun_s))
            for i in range(1, WINDOWS):
                begun_s = perf_counter()
                plan.window(0.1 * i, WINDOW)
                windows.append(1e3 * (perf_counter() - begun_s))
        figures[name] = {
            f"{what}_p{share}_ms": quantile(taken, share / 100.0)
            for what, taken in (("check", checks), ("plan", plans), ("window", windows))
            for share in (50, 99)
        }
    return figures
