"""Flights on the daemon's own filters, with and without poses from outside."""

import asyncio
from bisect import bisect
from math import dist, hypot
from typing import Any

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


def test_poses_that_come_late_count_for_the_moment_at_which_they_were_true() -> None:
    """At 3 m/s, 0.15 s are 0.45 m: taken as of their arrival, such poses would pull the estimate back by that."""
    late_s = 0.15

    async def scenario(flight: Flight) -> tuple[list[float], float]:
        waiting: list[tuple[float, list[float], list[float]]] = []

        async def capture() -> None:
            while True:
                truth = flight.px4.truth
                waiting.append((flight.now_s, list(truth.position_ned_m), list(truth.attitude_wb)))
                if flight.now_s - waiting[0][0] >= late_s:
                    stamp_s, position, orientation = waiting.pop(0)
                    pose = {"position": position, "orientation": orientation, "stamp_s": stamp_s}
                    flight.service.estimator_pose(EstimatorPose.model_validate(pose), CALLER)
                await asyncio.sleep(0.02)

        task = asyncio.ensure_future(capture())
        await flight.airborne()
        goal = await flight.goto(20.0, 0.0, -5.0)
        since = len(flight.records)
        await flight.result(goal)
        task.cancel()
        return _errors(flight, since)

    errors_m, fastest_m_s = fly(scenario, noise=True, config={"estimator": {"kind": "ekf", "external_pose": "alone"}})
    assert fastest_m_s > 3.0
    assert max(errors_m) < 0.25
    assert sum(errors_m) / len(errors_m) < 0.08


def _errors(flight: Flight, since: int) -> tuple[list[float], float]:
    """Distance of each state from the true path at its own time, and the largest speed."""
    times = [record.now_s for record in flight.records]
    errors, fastest = [], 0.0
    for record in flight.records[since:]:
        newest = record.estimate.newest
        assert newest is not None
        errors.append(dist(newest.position_ned_m, flight.truths[bisect(times, newest.time_s) - 1]))
        fastest = max(fastest, hypot(*newest.velocity_ned_m_s))
    return errors, fastest


def test_a_pose_is_refused_when_the_estimator_takes_none() -> None:
    async def scenario(flight: Flight) -> None:
        pose = {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
        with pytest.raises(ProtocolError) as error:
            flight.service.estimator_pose(EstimatorPose.model_validate(pose), CALLER)
        assert error.value.code is ErrorCode.WRONG_STATE

    fly(scenario)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"stamp_s": -46_800.0}, "stamp_s"),
        ({"stamp_s": 0.6}, "stamp_s"),
        ({"position": [0.0, 1e9, 0.0]}, "position[1]"),
        ({"position": [0.0, 0.0, -1.1e5]}, "position[2]"),
    ],
)
def test_a_pose_with_a_senseless_stamp_or_place_is_refused_by_field(change: dict[str, Any], field: str) -> None:
    async def scenario(flight: Flight) -> None:
        given = {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0], "stamp_s": -0.9} | change
        given["stamp_s"] += flight.now_s
        with pytest.raises(ProtocolError) as error:
            flight.service.estimator_pose(EstimatorPose.model_validate(given), CALLER)
        assert (error.value.code, error.value.field) == (ErrorCode.REFUSED, field)
        assert flight.vehicle.control.pose.value is None

    fly(scenario, config={"estimator": {"kind": "ekf", "external_pose": "fused"}})
