"""Goals of every kind replace each other at random times in one virtual flight."""

import asyncio
import os
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot, radians
from random import Random
from typing import Any

from support.flight import CALLER, Flight, fly

from daemon import frames
from daemon.config import load
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import ReferenceSet
from daemon.guidance.limits import MotionLimits
from daemon.messages import Reference, Vec3
from daemon.pipeline import Record

PROFILES = ("jerk_limited", "reference_filter")
MODES = ("full_pose", "only_position", "forward_heading", "only_orientation", "position_and_yaw", "xy_and_yaw")
HEADINGS: tuple[Any, ...] = ("fixed", "target", "velocity", {"point": [0.0, 0.0, -5.0]})
REFERENCE_PERIOD_S = 0.03
SEAM = 1e-6
SEED = int(os.environ.get("FLIGHTD_SEED", "20"))
GOALS = 1000 if int(os.environ.get("FLIGHTD_SOAK", "1")) >= 100 else 300
TILT_OVER_RAD = radians(1.0)  # the vehicle answers the tilt guard with a lag


@dataclass
class Replaced:
    """The goals in the order in which they were taken, and what was refused."""

    taken: list[str] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)


def place(rng: Random) -> list[float]:
    return [rng.uniform(-25.0, 25.0), rng.uniform(-25.0, 25.0), rng.uniform(-14.0, -4.0)]


def waypoint(rng: Random) -> dict[str, Any]:
    given: dict[str, Any] = {"position": place(rng), "mode": rng.choice(MODES)}
    return given | ({"yaw_deg": rng.uniform(-180.0, 180.0)} if rng.random() < 0.7 else {})


def shape(rng: Random, kind: str) -> dict[str, Any]:
    size = {"radius_m": rng.uniform(3.0, 8.0)} if kind == "circle" else {"size_m": [rng.uniform(5.0, 9.0), 3.0]}
    return size | {
        "kind": kind,
        "center": [*place(rng)[:2], -9.0],
        "speed_m_s": rng.uniform(0.5, 1.3),
        "direction": rng.choice(("cw", "ccw")),
        "heading": rng.choice(HEADINGS),
    }


def goal(rng: Random) -> tuple[str, dict[str, Any]]:
    kind = rng.choice(
        ("waypoint", "waypoint", "stop", "fly_by", "circle", "lemniscate", "polynomial", "hold", "stream")
    )
    if kind == "waypoint":
        return kind, {"waypoint": waypoint(rng)}
    if kind in ("stop", "fly_by"):
        corners = [{"position": place(rng)} for _ in range(rng.randint(1, 3))]
        return kind, {"path": {"waypoints": corners, "through": kind}}
    if kind in ("circle", "lemniscate"):
        return kind, {"trajectory": shape(rng, kind)}
    if kind == "polynomial":
        jerk = [rng.uniform(-3.0, 3.0) for _ in range(3)]
        return kind, {"trajectory": {"kind": kind, "jerk_m_s3": jerk, "duration_s": rng.uniform(0.2, 0.8)}}
    if kind == "hold":
        return kind, {"trajectory": {"kind": kind, "duration_s": rng.uniform(0.1, 2.0)}}
    return kind, {"stream": {"timeout_s": rng.uniform(0.1, 1.0)}}


async def send_references(flight: Flight, goal_id: str, rng: Random, until_s: float) -> None:
    """A planner of one's own: straight on from where the vehicle was, at a speed and heading of its own."""
    begin_s, begin = flight.now_s, flight.position
    velocity: Vec3 = (rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0), rng.uniform(-0.5, 0.5))
    yaw_deg = rng.uniform(-180.0, 180.0)
    while flight.now_s < until_s and flight.vehicle.trajectory.goal_id == goal_id:
        position = frames.add(begin, frames.scale(velocity, flight.now_s - begin_s))
        given = {"goal_id": goal_id, "position": position, "velocity": velocity, "yaw_deg": yaw_deg}
        flight.service.reference_set(ReferenceSet.model_validate(given), CALLER)
        await asyncio.sleep(REFERENCE_PERIOD_S)


async def replace_goals(flight: Flight, rng: Random, count: int) -> Replaced:
    seen = Replaced()
    while len(seen.taken) < count:
        if len(seen.taken) % 50 == 0:
            profile = PROFILES[len(seen.taken) // 50 % 2]
            flight.vehicle.set_config(load([], {"guidance": {"profile": profile}}))
        kind, params = goal(rng)
        try:
            goal_id = await flight.submit(**params)
        except ProtocolError as error:
            assert error.code is ErrorCode.REFUSED, error
            seen.refused[kind] += 1
            continue
        seen.taken.append(goal_id)
        seen.kinds[kind] += 1
        assert flight.vehicle.trajectory.goal_id == goal_id
        until_s = flight.now_s + rng.choice((0.0, rng.uniform(0.0, 0.1), rng.uniform(0.1, 0.6)))
        if kind == "stream" and rng.random() < 0.8:
            await send_references(flight, goal_id, rng, until_s)
        await asyncio.sleep(max(0.0, until_s - flight.now_s))
    return seen


def assert_one_result_each(flight: Flight, seen: Replaced) -> None:
    """Each goal ended once and in order; who was preempted was so by the very next; the last one taken flew on."""
    assert [entry.goal_id for entry in flight.ended] == seen.taken
    after = dict(pairwise(seen.taken))
    for entry in flight.ended:
        if entry.outcome == "preempted":
            assert entry.by == after[entry.goal_id]
        else:
            natural = ("succeeded", None), ("aborted", "stream_timeout")
            assert (entry.outcome, entry.reason) in natural, entry


def assert_continuous(records: list[Record], limits: MotionLimits) -> None:
    """From tick to tick p, v and a go on by themselves, but for what the jerk allowed changes in the time."""
    flown = [record.reference for record in records if record.reference is not None]
    for one, two in pairwise(flown):
        dt = two.time_s - one.time_s
        by_jerk = (limits.jerk_m_s3 * dt**3 / 6.0, limits.jerk_m_s3 * dt**2 / 2.0, limits.jerk_m_s3 * dt)
        for name, miss, allowed in zip("pva", _misses(one, two, dt), by_jerk, strict=True):
            assert hypot(miss[0], miss[1]) <= allowed + SEAM, (name, one, two)
            assert abs(miss[2]) <= allowed + SEAM, (name, one, two)
        turned = abs(frames.wrap_pi(two.yaw_rad - one.yaw_rad))
        assert turned <= limits.yaw_rate_rad_s * dt + SEAM, (one, two)
        assert abs(two.yaw_rate_rad_s - one.yaw_rate_rad_s) <= limits.yaw_acceleration_rad_s2 * dt + SEAM, (one, two)


def _misses(one: Reference, two: Reference, dt: float) -> tuple[Vec3, Vec3, Vec3]:
    """What of p, v and a does not follow from the tick before when its acceleration is kept."""
    p = frames.add(one.position_ned_m, frames.scale(one.velocity_ned_m_s, dt))
    p = frames.add(p, frames.scale(one.acceleration_ned_m_s2, 0.5 * dt * dt))
    v = frames.add(one.velocity_ned_m_s, frames.scale(one.acceleration_ned_m_s2, dt))
    return (
        frames.subtract(two.position_ned_m, p),
        frames.subtract(two.velocity_ned_m_s, v),
        frames.subtract(two.acceleration_ned_m_s2, one.acceleration_ned_m_s2),
    )


def assert_within_limits(flight: Flight, since: int) -> None:
    control = flight.vehicle.config.control
    for record in flight.records[since:]:
        assert record.setpoint is not None and record.predicted is not None
        roll, pitch, yaw = record.setpoint.rates_frd_rad_s
        assert max(abs(roll), abs(pitch)) <= radians(control.rate_max_deg_s) + 1e-9
        assert abs(yaw) <= radians(control.yaw_rate_max_deg_s) + 1e-9
        assert control.thrust_min <= record.setpoint.thrust <= control.thrust_max
        assert frames.tilt_of(record.predicted.attitude_wb) <= radians(control.tilt_max_deg) + TILT_OVER_RAD


def test_hundreds_of_goals_preempt_each_other_at_random_times() -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(10.0)
        await flight.result(await flight.goto(0.0, 0.0, -10.0))
        flight.ended.clear()
        since = len(flight.records)
        seen = await replace_goals(flight, Random(SEED), GOALS)
        await flight.result(seen.taken[-1], 200.0)
        assert_one_result_each(flight, seen)
        assert min(seen.kinds.values()) > GOALS / 20, seen.kinds
        assert_continuous(flight.records[since:], flight.vehicle.parameters.value.limits)
        assert_within_limits(flight, since)

    fly(scenario)
