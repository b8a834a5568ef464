"""Every kind of goal flown by the whole daemon in virtual time."""

import asyncio
from math import atan2, cos, dist, hypot, pi, radians, sin

import pytest
from support.flight import CALLER, Flight, fly

from daemon import frames
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import GoalUpdate, ReferenceSet
from daemon.goals.service import Caller
from daemon.messages import GlobalPosition
from daemon.safety.supervisor import State


def reference_positions(flight: Flight, since: int) -> list[tuple[float, float, float]]:
    return [r.reference.position_ned_m for r in flight.records[since:] if r.reference is not None]


@pytest.mark.parametrize("through", ["stop", "fly_by"])
def test_a_path_passes_its_waypoints_in_order(through: str) -> None:
    corners = [(8.0, 0.0, -5.0), (8.0, 8.0, -7.0), (0.0, 8.0, -5.0)]

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(path={"waypoints": [{"position": list(c)} for c in corners], "through": through})
        since = len(flight.records)
        entry = await flight.result(goal_id)
        assert entry.outcome == "succeeded", entry
        assert dist(flight.position, corners[-1]) < 0.3
        flown = reference_positions(flight, since)
        nearest = [min(range(len(flown)), key=lambda i, c=c: dist(flown[i], c)) for c in corners]
        assert nearest == sorted(nearest)
        assert all(dist(flown[i], c) < 0.05 for i, c in zip(nearest, corners, strict=True))

    fly(scenario)


@pytest.mark.parametrize(
    ("frame", "center", "direction", "clockwise_from_above"),
    [
        ("local_ned", [0.0, 10.0, -6.0], "cw", True),
        ("local_ned", [0.0, 10.0, -6.0], "ccw", False),
        ("local_enu", [10.0, 0.0, 6.0], "cw", False),
        ("local_enu", [10.0, 0.0, 6.0], "ccw", True),
    ],
)
def test_a_circle_keeps_its_radius_and_its_sense(
    frame: str, center: list[float], direction: str, clockwise_from_above: bool
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(
            trajectory={
                "kind": "circle",
                "frame": frame,
                "center": center,
                "radius_m": 5.0,
                "speed_m_s": 2.0,
                "turns": 1,
                "direction": direction,
                "heading": "target",
            }
        )
        await flight.until(lambda: abs(dist(flight.position, (0.0, 10.0, -6.0)) - 5.0) < 0.2, 30.0)
        await flight.until(lambda since=flight.now_s: flight.now_s - since > 4.0)
        turned = []
        for _ in range(400):
            n, e = flight.position[0], flight.position[1] - 10.0
            assert hypot(n, e) == pytest.approx(5.0, abs=0.35)
            v = flight.px4.truth.velocity_ned_m_s
            turned.append(n * v[1] - e * v[0])
            await asyncio.sleep(0.01)
        assert all((t > 0) == clockwise_from_above for t in turned)
        q = flight.px4.truth.attitude_wb
        towards = frames.wrap_pi(frames.yaw_of(q) - frames.yaw_of(frames.from_yaw(_bearing(flight.position))))
        assert abs(towards) < radians(25.0)
        assert (await flight.result(goal_id)).outcome == "succeeded"

    def _bearing(position: tuple[float, float, float]) -> float:
        return atan2(10.0 - position[1], -position[0])

    fly(scenario)


def test_a_narrow_orbit_looks_at_its_object_all_the_time_or_is_refused() -> None:
    orbit = {"kind": "circle", "center": [-1.5, 0.0, -6.0], "radius_m": 1.5, "turns": 3, "heading": "target"}

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        with pytest.raises(ProtocolError, match=r"80 deg/s; 54 deg/s can be followed: at most 1\.41 m/s"):
            await flight.submit(trajectory=orbit | {"speed_m_s": 2.1})
        goal_id = await flight.submit(trajectory=orbit | {"speed_m_s": 1.41})
        await flight.until(lambda: flight.px4.truth.position_ned_m[2] < -5.9 and _speed(flight) > 0.5, 30.0)
        off = []
        while _speed(flight) > 0.5:
            truth = flight.px4.truth
            bearing = atan2(-truth.position_ned_m[1], -1.5 - truth.position_ned_m[0])
            off.append(abs(frames.wrap_pi(frames.yaw_of(truth.attitude_wb) - bearing)))
            await asyncio.sleep(0.05)
        assert len(off) * 0.05 * 1.41 > 2.5 * 2.0 * pi * 1.5
        assert sum(off) / len(off) < radians(10.0)
        assert max(off) < radians(35.0)
        assert (await flight.result(goal_id)).outcome == "succeeded"

    def _speed(flight: Flight) -> float:
        return hypot(*flight.px4.truth.velocity_ned_m_s[:2])

    fly(scenario)


def test_a_lemniscate_a_polynomial_and_a_hold_succeed() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        for trajectory in (
            {"kind": "lemniscate", "center": [0, 0, -6], "size_m": [8, 4], "speed_m_s": 2.5, "heading": "velocity"},
            {"kind": "polynomial", "jerk_m_s3": [1.0, 0.0, 0.0], "duration_s": 1.5},
            {"kind": "hold", "duration_s": 2.0},
        ):
            entry = await flight.result(await flight.submit(trajectory=trajectory))
            assert entry.outcome == "succeeded", (trajectory, entry)

    fly(scenario)


@pytest.mark.parametrize(
    ("waypoint", "expected", "yaw_deg"),
    [
        ({"position": [3.0, 4.0, 6.0], "frame": "local_enu", "yaw_deg": 0.0}, (4.0, 3.0, -6.0), 90.0),
        (
            {"position": [3.0, 4.0, 6.0], "frame": "local_enu", "orientation": [0.0, 1.0, 0.0, 0.0]},
            (4.0, 3.0, -6.0),
            90.0,
        ),
        ({"position": [2.0, 1.0, -1.0], "frame": "body_frd", "yaw_deg": 30.0}, (-1.0, 2.0, -6.0), 120.0),
        ({"position": [4.0, 0.0, -6.0], "mode": "forward_heading"}, (4.0, 0.0, -6.0), 0.0),
        ({"position": [1.0, 5.0, -9.0], "mode": "xy_and_yaw", "yaw_deg": -45.0}, (1.0, 5.0, -5.0), -45.0),
        ({"mode": "only_orientation", "yaw_deg": 200.0}, (0.0, 0.0, -5.0), -160.0),
    ],
)
def test_frames_and_modes_mean_what_the_protocol_says(
    waypoint: dict[str, object], expected: tuple[float, float, float], yaw_deg: float
) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        await flight.result(await flight.goto(0.0, 0.0, -5.0, yaw_deg=90.0))
        await flight.until(lambda since=flight.now_s: flight.now_s - since > 4.0)
        entry = await flight.result(await flight.submit(waypoint=waypoint))
        assert entry.outcome == "succeeded"
        reference = flight.records[-1].reference
        assert reference is not None
        assert dist(reference.position_ned_m, expected) < 0.05
        assert abs(frames.wrap_pi(reference.yaw_rad - radians(yaw_deg))) < 0.02

    fly(scenario)


def test_a_global_waypoint_is_flown_to_its_place_on_the_globe() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        origin = flight.autopilot.status.value.global_origin
        assert origin is not None
        place = GlobalPosition(origin.latitude_deg + 1e-4, origin.longitude_deg, origin.altitude_amsl_m + 8.0)
        goal_id = await flight.goto(place.latitude_deg, place.longitude_deg, place.altitude_amsl_m, frame="global")
        assert (await flight.result(goal_id)).outcome == "succeeded"
        # One degree of latitude is 111 km at sea level; the second digit is all that this checks.
        assert flight.position[0] == pytest.approx(11.1, abs=0.3)
        assert flight.position[2] == pytest.approx(-8.0, abs=0.3)

    fly(scenario)


def test_update_moves_the_goal_without_ending_it() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.goto(15.0, 0.0, -5.0)
        for east in (1.0, 2.0, 3.0, 4.0):
            await flight.until(lambda since=flight.now_s: flight.now_s - since > 0.4)
            update = {"goal_id": goal_id, "waypoint": {"position": [10.0, east, -5.0]}}
            await flight.service.goal_update(GoalUpdate.model_validate(update), CALLER)
        entry = await flight.result(goal_id)
        assert entry.outcome == "succeeded"
        assert len(flight.ended) == 1
        assert dist(flight.position, (10.0, 4.0, -5.0)) < 0.3

    fly(scenario)


def test_a_streamed_reference_is_followed_and_its_silence_brakes_and_aborts() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(stream={"timeout_s": 0.5})
        errors = []
        for i in range(400):
            t = i * 0.03
            phase = 2 * pi * t / 12.0
            params = {
                "goal_id": goal_id,
                "position": [3.0 * sin(phase), 3.0 - 3.0 * cos(phase), -5.0],
                "velocity": [pi / 2 * cos(phase), pi / 2 * sin(phase), 0.0],
                "yaw_deg": 10.0,
            }
            flight.service.reference_set(ReferenceSet.model_validate(params), CALLER)
            await asyncio.sleep(0.03)
            if t > 4.0:
                errors.append(dist(flight.position[:2], params["position"][:2]))
        assert max(errors) < 0.3
        assert flight.state is State.TRACKING
        entry = await flight.result(goal_id, 2.0)
        assert (entry.outcome, entry.reason) == ("aborted", "stream_timeout")
        await flight.until(lambda: frames.norm(flight.px4.truth.velocity_ned_m_s) < 0.1, 10.0)

    fly(scenario)


def test_a_streamed_reference_that_comes_after_a_newer_one_is_refused_and_changes_nothing() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(stream={})
        still = {"goal_id": goal_id, "position": [0.0, 0.0, -5.0], "velocity": [0.0, 0.0, 0.0]}
        moved = {"goal_id": goal_id, "position": [4.0, 0.0, -5.0], "velocity": [1.0, 0.0, 0.0]}
        now_s = flight.now_s
        flight.service.reference_set(ReferenceSet.model_validate({**still, "stamp_s": now_s}), CALLER)
        await asyncio.sleep(0.02)
        plan = flight.vehicle.trajectory.plan.value
        for stamp_s in (now_s, now_s - 0.05):
            with pytest.raises(ProtocolError) as error:
                flight.service.reference_set(ReferenceSet.model_validate({**moved, "stamp_s": stamp_s}), CALLER)
            assert (error.value.code, error.value.field) == (ErrorCode.REFUSED, "stamp_s")
        await asyncio.sleep(0.02)
        assert flight.vehicle.trajectory.plan.value is plan

    fly(scenario)


def test_a_stream_takes_references_from_its_own_connection_and_within_limits_only() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        goal_id = await flight.submit(stream={})
        good = {"goal_id": goal_id, "position": [0.0, 0.0, -5.0], "velocity": [0.0, 0.0, 0.0]}
        other = Caller(connection=2, pid=1, uid=0, operator=True)
        with pytest.raises(ProtocolError) as error:
            flight.service.reference_set(ReferenceSet.model_validate(good), other)
        assert error.value.code is ErrorCode.NOT_PERMITTED
        for change, field in (
            ({"position": [0.0, 0.0, -500.0]}, "position[2]"),
            ({"velocity": [90.0, 0.0, 0.0]}, "velocity"),
            ({"stamp_s": 1e6}, "stamp_s"),
        ):
            with pytest.raises(ProtocolError) as error:
                flight.service.reference_set(ReferenceSet.model_validate({**good, **change}), CALLER)
            assert error.value.code is ErrorCode.REFUSED
            assert error.value.field == field

    fly(scenario)


def test_a_stream_of_wild_jerks_and_yaw_rates_is_followed_within_the_limits() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(20.0)
        goal_id = await flight.submit(stream={"timeout_s": 2.0})
        good = {"goal_id": goal_id, "position": [0.0, 0.0, -20.0], "velocity": [0.0, 0.0, 0.0], "yaw_deg": 0.0}
        for i in range(40):
            sign = 1.0 if i % 20 < 10 else -1.0
            wild = {"jerk": [500.0 * sign, 500.0, -500.0 * sign], "yaw_rate_deg_s": 500.0 * sign}
            flight.service.reference_set(ReferenceSet.model_validate(good | wild), CALLER)
            await asyncio.sleep(0.1 if i % 2 else 0.9)
        limits = flight.vehicle.parameters.value.limits
        flown = [r.reference for r in flight.records if r.reference is not None]
        assert max(hypot(*r.velocity_ned_m_s[:2]) for r in flown) <= limits.speed_m_s * 1.001
        assert max(r.velocity_ned_m_s[2] for r in flown) <= limits.descent_m_s * 1.001
        assert max(hypot(*r.acceleration_ned_m_s2[:2]) for r in flown) <= limits.acceleration_m_s2 * 1.001
        assert max(hypot(*r.jerk_ned_m_s3[:2]) for r in flown) <= limits.jerk_m_s3 * 1.001
        assert max(abs(r.yaw_rate_rad_s) for r in flown) <= limits.yaw_rate_rad_s * 1.001
        assert max(hypot(*r.velocity_ned_m_s[:2]) for r in flown) > 2.0
        assert max(abs(r.yaw_rate_rad_s) for r in flown) > 0.5

    fly(scenario)


@pytest.mark.parametrize("through", ["stop", "fly_by"])
def test_a_path_stays_at_its_last_waypoint_as_long_as_that_says(through: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        corner, end = {"position": [4.0, 0.0, -5.0]}, {"position": [4.0, 4.0, -5.0], "hold_s": 6.0}
        goal_id = await flight.submit(path={"waypoints": [corner, end], "through": through})
        there_s = None
        while not flight.ended:
            near = dist(flight.position, (4.0, 4.0, -5.0)) < 0.3
            there_s = flight.now_s if near and there_s is None else there_s
            await asyncio.sleep(0.01)
        assert (await flight.result(goal_id)).outcome == "succeeded"
        assert there_s is not None and flight.now_s - there_s > 6.0

    fly(scenario)
