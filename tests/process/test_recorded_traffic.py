"""Traffic recorded from PX4 1.17 SITL, played as UDP into real MAVSDK: it must come out of the link as recorded."""

import asyncio
import contextlib
import gzip
import itertools
import json
import socket
from bisect import bisect_left
from pathlib import Path
from typing import Any, Generic, TypeVar

import pytest
from support.processes import free_udp_port

from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.frames import angle_between, norm, subtract
from daemon.latest import Latest
from daemon.messages import AutopilotStatus, FlightMode, LandedState, MavFrame, Odometry
from daemon.sim.mavlink_codec import MavlinkCodec

TRAFFIC = Path(__file__).parent.parent / "fixtures" / "traffic"
SPEED = 8.0
PATIENCE_S = 120.0
FLOAT32 = 1e-5
UNDER_WAY = 5  # ODOMETRY; what comes after a standstill at once, the kernel's buffer would not hold

T = TypeVar("T")
Line = dict[str, Any]


class Kept(Latest[T], Generic[T]):
    """A cell that remembers all that was ever written to it."""

    __slots__ = ("all",)

    def __init__(self, value: T) -> None:
        super().__init__(value)
        self.all: list[T] = []

    def set(self, value: T) -> None:
        super().set(value)
        self.all.append(value)


def recorded(name: str) -> list[Line]:
    with gzip.open(TRAFFIC / f"{name}.jsonl.gz", "rt") as file:
        return [json.loads(line) for line in file]


async def until_version(cell: Latest[Any], version: int) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while cell.version < version:  # noqa: ASYNC110  # written from MAVSDK's threads
            await asyncio.sleep(0.005)


async def play(lines: list[Line]) -> tuple[list[Odometry], list[AutopilotStatus]]:
    """What the link made of the lines; the first HEARTBEAT goes ahead, for the link to find the vehicle."""
    loop = asyncio.get_running_loop()
    codec = MavlinkCodec(lines[0]["sys"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        target = ("127.0.0.1", free_udp_port())
        link = MavsdkLink(f"udpin://127.0.0.1:{target[1]}", link_timeout_s=PATIENCE_S)
        odometry: Kept[Odometry | None] = Kept(None)
        status: Kept[AutopilotStatus] = Kept(AutopilotStatus())
        link.odometry = link.session.odometry = odometry
        link.status = link.session.status = status
        task = asyncio.ensure_future(link.run())
        first = next(line for line in lines if line["msg"] == "HEARTBEAT")
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not status.value.connected:
                    sock.sendto(codec.encode("HEARTBEAT", first["f"]), target)
                    await asyncio.sleep(0.1)
            start_s, sent = loop.time(), 0
            for line in lines:
                await asyncio.sleep(max(0.0, start_s + line["t"] / SPEED - loop.time()))
                await until_version(odometry, sent - UNDER_WAY)
                sock.sendto(codec.encode(line["msg"], line["f"]), target)
                sent += line["msg"] == "ODOMETRY"
            await until_version(odometry, sent)
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            await link.close()
    return [sample for sample in odometry.all if sample is not None], status.all


def changes(values: list[Any]) -> list[Any]:
    return [value for value, _ in itertools.groupby(values)]


def number(values: list[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]


def assert_as_recorded(samples: list[Odometry], lines: list[Line]) -> None:
    originals = [line["f"] for line in lines if line["msg"] == "ODOMETRY"]
    assert [sample.stamp_us for sample in samples] == [f["time_usec"] for f in originals]
    for sample, f in zip(samples, originals, strict=True):
        assert (sample.frame_id, sample.child_frame_id) == (MavFrame.LOCAL_NED, MavFrame.LOCAL_NED)
        assert sample.reset_counter == f["reset_counter"]
        got = (*sample.position_m, *sample.velocity_m_s, *sample.attitude_wb, *sample.rates_frd_rad_s)
        names = ("x", "y", "z", "vx", "vy", "vz")
        told = [*(f[n] for n in names), *f["q"], f["rollspeed"], f["pitchspeed"], f["yawspeed"]]
        assert got == pytest.approx(number(told), rel=FLOAT32, abs=FLOAT32)
        assert sample.position_variance_m2 == pytest.approx([f["pose_covariance"][i] for i in (0, 6, 11)], rel=FLOAT32)


def nearest(samples: list[Odometry], stamps_us: list[int], stamp_us: int) -> Odometry | None:
    index = min(bisect_left(stamps_us, stamp_us), len(samples) - 1)
    return samples[index] if abs(stamps_us[index] - stamp_us) <= 20_000 else None


def assert_agrees_with_other_messages(samples: list[Odometry], lines: list[Line]) -> None:
    """LOCAL_POSITION_NED (NED by its definition) and ATTITUDE_QUATERNION say the same of the same moment."""
    stamps_us = [sample.stamp_us for sample in samples]
    compared = {"LOCAL_POSITION_NED": 0, "ATTITUDE_QUATERNION": 0}
    for line in lines:
        f, name = line["f"], line["msg"]
        sample = nearest(samples, stamps_us, f["time_boot_ms"] * 1000) if name in compared else None
        if sample is None:
            continue
        compared[name] += 1
        if name == "LOCAL_POSITION_NED":
            assert norm(subtract(sample.position_m, (f["x"], f["y"], f["z"]))) < 0.25
            assert norm(subtract(sample.velocity_m_s, (f["vx"], f["vy"], f["vz"]))) < 0.5
        else:
            assert angle_between(sample.attitude_wb, (f["q1"], f["q2"], f["q3"], f["q4"])) < 0.1
    assert min(compared.values()) > 50


async def test_takeoff_hold_and_land_come_out_as_recorded() -> None:
    lines = recorded("takeoff_hold_land")
    samples, statuses = await play(lines)
    assert_as_recorded(samples, lines)
    assert_agrees_with_other_messages(samples, lines)
    assert changes([status.mode for status in statuses]) == [
        FlightMode.HOLD,
        FlightMode.TAKEOFF,
        FlightMode.HOLD,
        FlightMode.LAND,
        FlightMode.HOLD,
    ]
    assert changes([status.armed for status in statuses]) == [False, True, False]
    landed = [status.landed for status in statuses if status.landed is not LandedState.UNDEFINED]
    assert changes(landed) == [
        LandedState.ON_GROUND,
        LandedState.TAKEOFF,
        LandedState.IN_AIR,
        LandedState.LANDING,
        LandedState.ON_GROUND,
    ]
    last = statuses[-1]
    remaining_pct = [line["f"]["battery_remaining"] for line in lines if line["msg"] == "SYS_STATUS"][-1]
    assert last.battery_fraction == pytest.approx(remaining_pct / 100.0)
    assert last.home is not None
    assert last.home.latitude_deg == pytest.approx(47.39774, abs=1e-4)
    assert last.home.altitude_amsl_m == pytest.approx(489.4, abs=2.0)
    assert last.boot_count == 0


async def test_the_lemniscate_in_offboard_comes_out_as_recorded() -> None:
    lines = recorded("offboard_lemniscate")
    samples, statuses = await play(lines)
    assert_as_recorded(samples, lines)
    assert_agrees_with_other_messages(samples, lines)
    assert changes([status.mode for status in statuses]) == [FlightMode.HOLD, FlightMode.OFFBOARD, FlightMode.HOLD]
    assert changes([status.intended_mode for status in statuses])[-2:] == [FlightMode.OFFBOARD, FlightMode.HOLD]
    assert changes([status.armed for status in statuses]) == [True]
    assert {status.landed for status in statuses} <= {LandedState.UNDEFINED, LandedState.IN_AIR}
    speeds = [norm(sample.velocity_m_s) for sample in samples]
    assert 4.0 < max(speeds) < 8.0  # flown with a peak of 5 m/s
