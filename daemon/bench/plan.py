"""What planning costs: from a goal to its first reference window, and each window after it."""

from math import cos, pi, sin
from time import perf_counter

from daemon.bench.quantiles import quantile
from daemon.guidance import planner
from daemon.guidance.goals import Goal, PathGoal, ShapeGoal, Through, WaypointGoal
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.guidance.shapes import Circle, Lemniscate
from daemon.messages import Reference

WINDOW = 100
WINDOWS = 20
START = Reference(0.0, (0.0, 0.0, -5.0), (1.0, -0.5, 0.2), (0.2, 0.1, 0.0))


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
    """Milliseconds, p50 and p99: ``plan`` with its first window, and ``window`` for each further one."""
    limits = MotionLimits()
    figures = {}
    for name, (goal, profile) in goals().items():
        parameters = GuidanceParameters(profile=profile)
        plans, windows = [], []
        for _ in range(rounds):
            begun_s = perf_counter()
            plan = planner.plan(START, goal, limits, parameters)
            plan.window(0.0, WINDOW)
            plans.append(1e3 * (perf_counter() - begun_s))
            for i in range(1, WINDOWS):
                begun_s = perf_counter()
                plan.window(0.1 * i, WINDOW)
                windows.append(1e3 * (perf_counter() - begun_s))
        figures[name] = {
            "plan_p50_ms": quantile(plans, 0.5),
            "plan_p99_ms": quantile(plans, 0.99),
            "window_p50_ms": quantile(windows, 0.5),
            "window_p99_ms": quantile(windows, 0.99),
        }
    return figures
