"""The whole daemon over real MAVSDK, stopped, blocked and killed in flight; the simulated PX4 flies in the test."""

import asyncio
import contextlib
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from math import degrees
from pathlib import Path

import pytest
from support.processes import Child, blocking_daemon, daemon_on, free_udp_port, until

from daemon import frames
from daemon.goals.client import FlightClient
from daemon.messages import FlightMode
from daemon.sim.airframe_files import load
from daemon.sim.faults import PilotTakesOver
from daemon.sim.mavlink_server import MavlinkServer
from daemon.sim.px4 import SimulatedPx4

PATIENCE_S = 120.0
HEIGHT_M = 30.0
TILT_MAX_DEG = 45.0


@dataclass
class Air:
    """A simulated PX4 in the air, and what was seen of it: times are of its own clock, so that a busy machine counts
    for nothing."""

    px4: SimulatedPx4
    connection: str
    modes: list[tuple[float, FlightMode]] = field(default_factory=list)
    tilt_deg: float = 0.0

    @property
    def now_s(self) -> float:
        return self.px4.simulated_us * 1e-6

    @property
    def silent_s(self) -> float:
        """Since the last setpoint that arrived."""
        return self.px4.receiver.setpoint_age_s

    async def watch(self) -> None:
        while True:
            if not self.modes or self.modes[-1][1] is not self.px4.mode:
                self.modes.append((self.now_s, self.px4.mode))
            self.tilt_deg = max(self.tilt_deg, degrees(frames.tilt_of(self.px4.truth.attitude_wb)))
            await asyncio.sleep(0.004)

    async def until(self, done: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not done():  # noqa: ASYNC110 - what is waited for is physics
                await asyncio.sleep(0.005)

    async def passes(self, seconds: float) -> None:
        since_s = self.now_s
        await self.until(lambda: self.now_s - since_s >= seconds)


@asynccontextmanager
async def air() -> AsyncIterator[Air]:
    port = free_udp_port()
    px4 = SimulatedPx4(airframe=load("sih"), seed=5)
    px4.start_in_air(HEIGHT_M)
    seen = Air(px4, f"udpin://127.0.0.1:{port}")
    tasks = [asyncio.ensure_future(MavlinkServer([px4], port=port).run()), asyncio.ensure_future(seen.watch())]
    try:
        yield seen
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def take(child: Child, seen: Air) -> None:
    """Engage, and fly towards a far goal."""
    assert child.socket is not None
    async with FlightClient(child.socket) as flight:
        await until(flight, lambda status: status["state"] == "pilot" and status["vehicle"] is not None)
        await seen.passes(1.0)
        await flight.engage()
        await flight.goto(60.0, 0.0, -HEIGHT_M)
    await seen.until(lambda: seen.px4.truth.velocity_ned_m_s[0] > 3.0)
    seen.modes.clear()
    seen.tilt_deg = 0.0


async def state_of(child: Child) -> str:
    assert child.socket is not None
    async with FlightClient(child.socket) as flight:
        return str((await flight.status())["state"])


async def test_sigterm_in_flight_hands_over_to_hold_and_exits(tmp_path: Path) -> None:
    async with air() as seen, daemon_on(tmp_path, seen.connection) as child:
        await take(child, seen)
        struck_s = seen.now_s
        assert await child.stop(signal.SIGTERM) == 0
        await seen.until(lambda: seen.px4.mode is FlightMode.HOLD)
        assert seen.modes[-1][0] - struck_s < 1.5
        assert [mode for _, mode in seen.modes] == [FlightMode.OFFBOARD, FlightMode.HOLD], "no failsafe was needed"
        assert seen.tilt_deg < TILT_MAX_DEG


async def test_killed_and_restarted_in_flight_it_touches_nothing_until_asked(tmp_path: Path) -> None:
    async with air() as seen:
        with contextlib.suppress(ProcessLookupError):
            async with daemon_on(tmp_path, seen.connection) as child:
                await take(child, seen)
                await child.stop(signal.SIGKILL)
        await seen.until(lambda: seen.px4.mode is FlightMode.RETURN)
        async with daemon_on(tmp_path, seen.connection) as child:
            assert child.socket is not None
            async with FlightClient(child.socket) as flight:
                status = await until(flight, lambda status: status["state"] not in ("disconnected", "standby"))
                assert status["state"] in ("pilot", "fault")
                silent_s = seen.silent_s
                await seen.passes(2.0)
                assert seen.silent_s >= silent_s + 1.9
                assert seen.px4.mode is FlightMode.RETURN
                await flight.hold()
                await flight.engage()
                assert seen.px4.mode is FlightMode.OFFBOARD


async def test_stopped_for_long_and_continued_not_one_setpoint_leaves(tmp_path: Path) -> None:
    async with air() as seen, daemon_on(tmp_path, seen.connection) as child:
        await take(child, seen)
        child.process.send_signal(signal.SIGSTOP)
        await seen.until(lambda: seen.px4.mode is FlightMode.RETURN)
        seen.px4.inject(PilotTakesOver(mode="position"))
        await seen.passes(1.0)
        silent_s = seen.silent_s
        child.process.send_signal(signal.SIGCONT)
        await seen.passes(3.0)
        assert seen.silent_s >= silent_s + 2.9
        assert seen.px4.mode is FlightMode.POSITION, "the pilot keeps it"
        assert await state_of(child) in ("fault", "pilot")


async def test_a_short_block_of_the_loop_is_survived(tmp_path: Path) -> None:
    async with air() as seen, blocking_daemon(tmp_path, seen.connection, 0.3) as child:
        await take(child, seen)
        child.process.send_signal(signal.SIGUSR1)
        await seen.passes(3.0)
        assert seen.tilt_deg < TILT_MAX_DEG
        assert await state_of(child) in ("tracking", "fault"), "0.3 s is where the dead-man latches"
        assert seen.px4.mode in (FlightMode.OFFBOARD, FlightMode.HOLD)


async def test_a_blocked_loop_is_levelled_and_handed_over_while_it_is_blocked(tmp_path: Path) -> None:
    async with air() as seen, blocking_daemon(tmp_path, seen.connection, 5.0) as child:
        await take(child, seen)
        struck_s = seen.now_s
        child.process.send_signal(signal.SIGUSR1)
        await seen.until(lambda: seen.px4.mode is not FlightMode.OFFBOARD)
        assert seen.px4.mode is FlightMode.HOLD
        assert seen.modes[-1][0] - struck_s < 0.9
        await seen.until(lambda: seen.now_s - struck_s > 5.5)
        assert seen.silent_s > 4.5, "after the block the gate is shut"
        assert seen.tilt_deg < TILT_MAX_DEG
        assert await state_of(child) == "fault"
        names = [event.get("event") for event in child.events()]
        assert "dead_man_latched" in names
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            await flight.engage()
        assert seen.px4.mode is FlightMode.OFFBOARD


async def test_a_call_that_holds_the_interpreter_lock_ends_the_stream_and_the_autopilot_acts(tmp_path: Path) -> None:
    async with air() as seen, blocking_daemon(tmp_path, seen.connection, 3.0) as child:
        await take(child, seen)
        struck_s = seen.now_s
        child.process.send_signal(signal.SIGUSR2)
        await seen.until(lambda: seen.px4.mode is not FlightMode.OFFBOARD)
        assert seen.px4.mode is FlightMode.RETURN, "its offboard-loss failsafe"
        assert seen.modes[-1][0] - struck_s < 1.6
        silent_s = seen.silent_s
        await seen.passes(4.0)
        assert seen.silent_s >= silent_s + 3.9
        assert seen.px4.mode is FlightMode.RETURN
        assert await state_of(child) in ("fault", "pilot")


@pytest.mark.parametrize("number", [signal.SIGTERM])
async def test_a_daemon_that_flies_nothing_stops_at_once(tmp_path: Path, number: signal.Signals) -> None:
    async with air() as seen, daemon_on(tmp_path, seen.connection) as child:
        assert await child.stop(number) == 0
        assert seen.silent_s > 1e6
