"""The daemon stands still (SIGSTOP, SIGCONT), over real MAVSDK: whoever took the vehicle meanwhile keeps it."""

import asyncio
import json
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from support.air import Air, air, state_of, take
from support.processes import Child, daemon_on, free_udp_port, until

from daemon.goals.client import FlightClient
from daemon.messages import FlightMode
from daemon.sim.airframe_files import load
from daemon.sim.faults import PilotTakesOver
from daemon.sim.mavlink_server import MavlinkServer
from daemon.sim.px4 import SimulatedPx4

DO_SET_MODE = 176
ON_ITS_WAY = 1  # a setpoint that the process was sending as it was stopped


@dataclass
class Flown:
    """A vehicle that the daemon flies; ``commands`` are what the autopilot was told to do since."""

    air: Air
    child: Child
    commands: list[int]

    async def stands_still(self, seconds: float) -> None:
        self.child.process.send_signal(signal.SIGSTOP)
        await self.air.passes(seconds)

    def goes_on(self) -> None:
        self.child.process.send_signal(signal.SIGCONT)


def told(seen: Air) -> list[int]:
    commands: list[int] = []
    receive = seen.px4.receive

    def noting(name: str, fields: dict[str, Any], **sender: int) -> None:
        if name == "COMMAND_LONG" and int(fields["command"]) < 500:  # above: messages that are asked for
            commands.append(int(fields["command"]))
        receive(name, fields, **sender)

    seen.px4.receive = noting  # type: ignore[method-assign,assignment]
    return commands


@asynccontextmanager
async def flown(folder: Path) -> AsyncIterator[Flown]:
    async with air() as seen, daemon_on(folder, seen.connection) as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            await take(flight, seen)
        yield Flown(seen, child, told(seen))


async def test_a_pilot_who_took_the_vehicle_within_a_standstill_keeps_it(tmp_path: Path) -> None:
    async with flown(tmp_path) as vehicle:
        await vehicle.stands_still(0.4)
        vehicle.air.px4.inject(PilotTakesOver(mode="position"))
        await vehicle.air.passes(0.4)
        sent = len(vehicle.air.sent)
        vehicle.goes_on()
        await vehicle.air.passes(3.0)
        assert (vehicle.air.px4.mode, vehicle.commands) == (FlightMode.POSITION, [])
        assert len(vehicle.air.sent) <= sent + ON_ITS_WAY
        assert await state_of(vehicle.child) in ("fault", "pilot")


async def test_after_a_standstill_an_autopilot_that_still_waits_is_given_hold(tmp_path: Path) -> None:
    async with flown(tmp_path) as vehicle:
        await vehicle.stands_still(0.45)
        if vehicle.air.px4.mode is not FlightMode.OFFBOARD:
            pytest.skip("this machine let PX4's failsafe act first")
        sent = len(vehicle.air.sent)
        vehicle.goes_on()
        await vehicle.air.until(lambda: vehicle.air.px4.mode is not FlightMode.OFFBOARD)
        assert vehicle.air.px4.mode is FlightMode.HOLD
        assert set(vehicle.commands) == {DO_SET_MODE}
        assert len(vehicle.air.sent) <= sent + ON_ITS_WAY


def given_up(path: Path, *requests: tuple[str, dict[str, Any]]) -> None:
    """Ask, and leave without an answer."""
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
        for number, (method, params) in enumerate(requests):
            line = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
            client.sendall(json.dumps(line).encode() + b"\n")


@pytest.mark.parametrize("stands_s", [1.5, 4.0])
async def test_nothing_that_was_asked_within_a_standstill_arms_a_vehicle_on_the_ground(
    tmp_path: Path, stands_s: float
) -> None:
    port = free_udp_port()
    px4 = SimulatedPx4(airframe=load("sih"), seed=5)
    server = asyncio.ensure_future(MavlinkServer([px4], port=port).run())
    seen = Air(px4, f"udpin://127.0.0.1:{port}")
    try:
        async with daemon_on(tmp_path, seen.connection) as child:
            assert child.socket is not None
            async with FlightClient(child.socket) as flight:
                await until(flight, lambda status: status["state"] == "standby" and status["vehicle"] is not None)
                await seen.passes(3.0)
                vehicle = Flown(seen, child, told(seen))
                await vehicle.stands_still(0.1)
                given_up(child.socket, ("vehicle.takeoff", {"altitude_m": 5}), ("vehicle.arm", {}))
                await seen.passes(stands_s)
                vehicle.goes_on()
                await seen.passes(3.0)
                assert (vehicle.commands, px4.armed) == ([], False)
                await flight.arm()
                assert px4.armed, "who asks anew is heard"
    finally:
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)
