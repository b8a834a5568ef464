"""What subscribers of the topic ``plan`` get while the daemon flies in virtual time."""

import json
from itertools import pairwise
from math import dist
from typing import Any

import pytest
from support.flight import Flight, fly
from support.trajectory_rig import slow_planning

from daemon.frames import norm
from daemon.goals.results import PlanTelemetry
from daemon.journal import Journal
from daemon.reports import Reports
from daemon.telemetry import Telemetry


class Subscriber:
    def __init__(self) -> None:
        self.plans: list[PlanTelemetry] = []

    def send(self, line: bytes, *, essential: bool) -> None:
        message: dict[str, Any] = json.loads(line)
        if message["method"] == "telemetry.plan":
            self.plans.append(message["params"])


async def flown_plans(flight: Flight, allow_s: float = 0.3, **goal: Any) -> list[PlanTelemetry]:
    """The plans of a goal flown from rest at (0, 0, -10), as a subscriber hears of them ten times a second."""
    Telemetry(flight.vehicle, Reports(flight.vehicle), flight.hub, Journal(flight.hub, None))
    subscriber = Subscriber()
    await flight.airborne(10.0)
    await flight.result(await flight.goto(0.0, 0.0, -10.0, hold_s=1.0))
    flight.hub.subscribe(subscriber, ["plan"], 10.0)
    goal_id = await flight.submit(**goal)
    entry = await flight.result(goal_id)
    assert entry.outcome == "succeeded" and entry.duration_s is not None
    heard = [plan for plan in subscriber.plans if plan["goal_id"] == goal_id]
    assert len(heard) == pytest.approx(10.0 * entry.duration_s, abs=10.0 * allow_s)
    return heard


def test_a_plan_is_the_whole_way_from_the_flown_reference_to_the_goal() -> None:
    async def scenario(flight: Flight) -> None:
        heard = await flown_plans(flight, waypoint={"position": [6.0, 2.0, -8.0]})
        assert heard
        for plan in heard:
            path = plan["positions_ned_m"]
            assert dist(path[0], (0.0, 0.0, -10.0)) < 1e-3
            assert dist(path[-1], (6.0, 2.0, -8.0)) < 1e-6
            assert plan["candidates_ned_m"] == []
            flown = next(r.reference for r in flight.records if r.now_s >= plan["time_s"])
            assert flown is not None
            index = round((flown.time_s - plan["start_s"]) / plan["spacing_s"])
            half_a_spacing_m = 0.5 * plan["spacing_s"] * norm(flown.velocity_ned_m_s)
            assert dist(path[min(index, len(path) - 1)], flown.position_ned_m) < half_a_spacing_m + 0.01

    fly(scenario)


def test_the_plan_of_a_path_is_the_path_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = [[6.0, 0.0, -10.0], [6.0, 6.0, -10.0], [0.0, 6.0, -10.0]]

    async def scenario(flight: Flight) -> None:
        slow_planning(monkeypatch, [0.0, 0.3])  # the check when it is submitted, and the plan that is flown
        path = {"waypoints": [{"position": corner} for corner in corners], "through": "fly_by"}
        heard = await flown_plans(flight, path=path, allow_s=0.5)
        for plan in heard:
            ways = plan["positions_ned_m"]
            assert dist(ways[0], (0.0, 0.0, -10.0)) < 1e-3
            assert dist(ways[-1], corners[-1]) < 1e-6
            assert all(min(dist(corner, place) for place in ways) < 0.5 for corner in corners)
            assert sum(dist(one, two) > 0.01 for one, two in pairwise(ways)) > 80

    fly(scenario)


def test_a_polynomials_plan_comes_with_the_seven_primitives_of_its_jerk() -> None:
    async def scenario(flight: Flight) -> None:
        goal = {"kind": "polynomial", "jerk_m_s3": [0.0, -2.0, 0.0], "duration_s": 1.2}
        heard = await flown_plans(flight, trajectory=goal)
        assert heard
        for plan in heard:
            start, ends = plan["positions_ned_m"][0], [one[-1] for one in plan["candidates_ned_m"]]
            way = 2.0 * 1.2**3 / 6.0
            expected = [
                [start[0] + way * n, start[1] + way * e, start[2] + way * d]
                for n, e, d in ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
            ]
            assert all(dist(a, b) < 1e-3 for a, b in zip(ends, expected, strict=True))
            assert all(dist(one[0], start) == 0.0 for one in plan["candidates_ned_m"])

    fly(scenario)
