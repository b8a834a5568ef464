"""status.get tells of the active goal from its acceptance on, also while the vehicle is still being engaged for it."""

from support.flight import CALLER, Flight, fly

from daemon.goals.methods import NoParams
from daemon.goals.results import GoalProgress


def test_goal_that_waits_for_the_vehicle_to_be_engaged_is_told() -> None:
    async def scenario(flight: Flight) -> None:
        async def told() -> GoalProgress | None:
            return (await flight.service.status_get(NoParams(), CALLER))["goal"]

        await flight.airborne(5.0, engage=False)
        assert await told() is None
        goal_id = await flight.goto(3.0, 0.0, -5.0)
        waiting = await told()
        assert waiting is not None
        assert (waiting["goal_id"], waiting["kind"], waiting["progress"]) == (goal_id, "waypoint", 0.0)
        assert (waiting["distance_m"], waiting["angle_deg"], waiting["eta_s"]) == (None, None, None)
        await flight.until(lambda: flight.vehicle.trajectory.progress is not None)
        flying = await told()
        assert flying is not None and flying["goal_id"] == goal_id and flying["distance_m"] is not None
        assert (await flight.result(goal_id)).outcome == "succeeded"
        assert await told() is None

    fly(scenario)
