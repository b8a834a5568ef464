"""Flights on the daemon's own filters, with and without poses from outside."""

import asyncio
from math import dist

import pytest
from support.flight import CALLER, Flight, fly

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import EstimatorPose


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_goal_is_flown_on_the_daemons_own_filter(kind: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        entry = await flight.result(await flight.goto(8.0, -3.0, -6.0, yaw_deg=45.0))
        assert entry.outcome == "succeeded"
        assert dist(flight.position, (8.0, -3.0, -6.0)) < 0.6

    fly(scenario, noise=True, config={"estimator": {"kind": kind}})


def test_motion_capture_holds_the_vehicle_where_the_autopilots_position_wanders() -> None:
    async def scenario(flight: Flight) -> None:
        async def capture() -> None:
            while True:
                truth = flight.px4.truth
                pose = {"position": list(truth.position_ned_m), "orientation": list(truth.attitude_wb)}
                flight.service.estimator_pose(EstimatorPose.model_validate(pose), CALLER)
                await asyncio.sleep(0.02)

        task = asyncio.ensure_future(capture())
        await flight.airborne()
        await flight.result(await flight.goto(3.0, 0.0, -5.0))
        since = len(flight.truths)
        await flight.until(lambda begun=flight.now_s: flight.now_s - begun > 15.0)
        task.cancel()
        departures = [dist(position, (3.0, 0.0, -5.0)) for position in flight.truths[since:]]
        assert max(departures) < 0.35
        assert sum(departures) / len(departures) < 0.12

    fly(scenario, noise=True, config={"estimator": {"kind": "ekf", "external_pose": "alone"}})


def test_a_pose_is_refused_when_the_estimator_takes_none() -> None:
    async def scenario(flight: Flight) -> None:
        pose = {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
        with pytest.raises(ProtocolError) as error:
            flight.service.estimator_pose(EstimatorPose.model_validate(pose), CALLER)
        assert error.value.code is ErrorCode.WRONG_STATE

    fly(scenario)
