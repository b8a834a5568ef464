"""The goals of the programs in examples/, flown by the whole daemon in virtual time with the default settings."""

import sys
from math import dist
from pathlib import Path
from typing import Any

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.methods import GoalUpdate

sys.path.append(str(Path(__file__).parents[2] / "examples"))

import circle_and_lemniscate
import follow_target
import inspect_point
import survey_grid

CIRCLE, EIGHT = circle_and_lemniscate.shapes(5.0)
LANES = survey_grid.lanes(20.0, 12.0, 4.0, 5.0)
GOALS = {
    "circle": {"trajectory": CIRCLE},
    "eight": {"trajectory": EIGHT},
    "lanes": {"path": {"waypoints": [{"position": corner} for corner in LANES]}, "limits": {"speed_m_s": 3.0}},
}
GOALS |= {
    f"side {yaw_deg:g}": {"waypoint": {"position": [10 + 4 * n, 4 * e, -5], "yaw_deg": yaw_deg, "hold_s": 3.0}}
    for n, e, yaw_deg in inspect_point.SIDES
}


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS)
def test_the_goal_of_an_example_succeeds(goal: dict[str, Any]) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        entry = await flight.result(await flight.submit(**goal), 300.0)
        assert entry.outcome == "succeeded", entry

    fly(scenario)


def test_the_target_that_walks_can_be_followed() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        waypoint = {"mode": "forward_heading", "hold_s": 3600.0}
        goal_id = await flight.goto(*follow_target.target(0.0), -5.0, **waypoint)
        begin_s = flight.now_s
        while flight.now_s - begin_s < 30.0:
            due_s = flight.now_s + follow_target.PERIOD_S
            place = [*follow_target.target(flight.now_s - begin_s), -5.0]
            update = {"goal_id": goal_id, "waypoint": {"position": place, **waypoint}}
            await flight.service.goal_update(GoalUpdate.model_validate(update), CALLER)
            await flight.until(lambda due_s=due_s: flight.now_s >= due_s)
        assert dist(flight.position, place) < 3.0

    fly(scenario)
