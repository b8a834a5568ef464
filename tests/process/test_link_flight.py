"""Real MAVSDK and the live link against the simulated PX4 on a loopback socket, at several times real time."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import structlog
from support.processes import free_udp_port
from support.standstill import where_it_runs

from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.autopilot.port import Command, CommandKind
from daemon.autopilot.session import SessionParams
from daemon.messages import FlightMode, LandedState, MavFrame, Setpoint
from daemon.sim.airframe_files import load
from daemon.sim.faults import Link, Reboot
from daemon.sim.mavlink_server import MavlinkServer
from daemon.sim.px4 import SimulatedPx4

SPEED = 4.0
PATIENCE_S = 120.0
HOVER = Setpoint((0.0, 0.0, 0.0), 0.4905)


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110  # the conditions are cells, not events
            await asyncio.sleep(0.005)


@contextlib.asynccontextmanager
async def running(*runs: "asyncio.Task[None]") -> AsyncIterator[None]:
    try:
        yield
    finally:
        for task in runs:
            task.cancel()
        await asyncio.gather(*runs, return_exceptions=True)


@contextlib.asynccontextmanager
async def connected(speed: float) -> AsyncIterator[tuple[MavsdkLink, SimulatedPx4]]:
    port = free_udp_port()
    px4 = SimulatedPx4(airframe=load("sih"), seed=3, system_id=3)
    link = MavsdkLink(f"udpin://127.0.0.1:{port}", link_timeout_s=5.0)
    server = MavlinkServer([px4], port=port, first_system_id=3, speed=speed)
    try:
        async with running(asyncio.ensure_future(link.run()), asyncio.ensure_future(server.run())):
            await until(lambda: link.status.value.connected and link.odometry.value is not None)
            await until(lambda: link.status.value.landed is not LandedState.UNDEFINED)
            yield link, px4
            assert server.endpoints[0].unsendable == {}
            assert link.session.malformed == {}
    finally:
        await link.close()


async def stream(link: MavsdkLink, condition: Callable[[], bool]) -> None:
    """Hover setpoints until something is so."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():
            link.send_setpoint(HOVER)
            await asyncio.sleep(0.01 / SPEED)


async def test_a_flight_over_the_wire_goes_through_every_mode() -> None:
    async with connected(SPEED) as (link, px4):
        status = link.status
        await until(lambda: status.value.global_position is not None)
        assert status.value.landed is LandedState.ON_GROUND
        await link.command(Command(CommandKind.ARM), PATIENCE_S)
        await until(lambda: status.value.armed)
        place = status.value.global_position
        assert place is not None
        await link.command(Command(CommandKind.TAKEOFF, place.altitude_amsl_m + 5.0), PATIENCE_S)
        await until(lambda: status.value.mode is FlightMode.TAKEOFF)
        await until(lambda: status.value.mode is FlightMode.HOLD and status.value.landed is LandedState.IN_AIR)
        assert px4.height_m > 3.0
        odometry = link.odometry.value
        assert odometry is not None
        assert (odometry.frame_id, odometry.child_frame_id) == (MavFrame.LOCAL_NED, MavFrame.LOCAL_NED)
        assert abs(odometry.position_m[2] + px4.height_m) < 1.5

        before_s = px4.uptime_s
        await stream(link, lambda: px4.uptime_s > before_s + 0.5)
        assert link.request_mode(FlightMode.OFFBOARD)
        await stream(link, lambda: status.value.mode is FlightMode.OFFBOARD)
        assert px4.mode is FlightMode.OFFBOARD
        assert status.value.mode_refusal is None

        assert link.request_mode(FlightMode.LAND)
        await until(lambda: status.value.mode is FlightMode.LAND)
        await until(lambda: not status.value.armed and status.value.landed is LandedState.ON_GROUND)


async def test_offboard_without_setpoints_in_flight_is_refused_with_the_reason() -> None:
    async with connected(SPEED) as (link, _px4):
        status = link.status
        await link.command(Command(CommandKind.ARM), PATIENCE_S)
        await link.command(Command(CommandKind.TAKEOFF), PATIENCE_S)
        await until(lambda: status.value.mode is FlightMode.HOLD and status.value.landed is LandedState.IN_AIR)
        assert link.request_mode(FlightMode.OFFBOARD)
        await until(lambda: status.value.mode_refusal is not None)
        refusal = status.value.mode_refusal
        assert refusal is not None
        assert refusal.mode is FlightMode.OFFBOARD
        assert refusal.reason.startswith("temporarily rejected")


async def start_quietly(_folder: Path) -> None:
    with structlog.testing.capture_logs() as lines:
        async with connected(1.0) as (link, _px4):
            start = link.odometry.version
            await until(lambda: link.odometry.version > start + 250)
            assert await link.read_parameter("MPC_THR_HOVER", PATIENCE_S) == 0.5
            assert await link.read_parameter("COM_RC_OVERRIDE", PATIENCE_S) == 1
            assert await link.read_parameter("NO_SUCH_PARAM", PATIENCE_S) is None
            assert link.session.monitor.slow == ()
    assert [line for line in lines if line["log_level"] in ("warning", "error")] == []


async def test_mavsdk_finds_nothing_to_warn_of_in_the_start(tmp_path: Path) -> None:
    await where_it_runs(start_quietly, tmp_path)


async def test_a_reboot_is_noticed_and_the_streams_come_again() -> None:
    # In real time: a reboot is told from a clock that was set back by how long nothing was heard.
    async with connected(1.0) as (link, px4):
        px4.inject(Reboot())
        await until(lambda: link.status.value.boot_count == 1 and link.status.value.connected)
        restarted, version = px4.uptime_s, link.odometry.version
        await until(lambda: px4.uptime_s > restarted + 4.0)
        received = link.odometry.version - version
        assert received > 0.7 * 100.0 * (px4.uptime_s - restarted)


async def test_a_silent_link_is_lost_and_comes_back_by_itself() -> None:
    async with connected(1.0) as (link, px4):
        link.session.params = SessionParams(link_timeout_s=0.5)
        px4.inject(Link(silent=True, direction="down"))
        await until(lambda: not link.status.value.connected)
        assert not link.send_setpoint(HOVER)
        px4.faults.clear("link")
        await until(lambda: link.status.value.connected)
        assert link.status.value.boot_count == 0
        assert link.send_setpoint(HOVER)


async def test_a_lossy_link_is_flown_through() -> None:
    async with connected(SPEED) as (link, px4):
        px4.inject(Link(loss=0.2, delay_s=0.02, jitter_s=0.02, reordering=0.05))
        await link.command(Command(CommandKind.ARM), PATIENCE_S)
        await link.command(Command(CommandKind.TAKEOFF), PATIENCE_S)
        await until(
            lambda: link.status.value.mode is FlightMode.HOLD and link.status.value.landed is LandedState.IN_AIR
        )
        assert link.status.value.boot_count == 0
        assert link.session.malformed == {}
