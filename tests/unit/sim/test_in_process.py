"""The in-process transport, against a stand-in that answers as PX4 does to the few messages used here."""

import asyncio
from typing import Any

import pytest

from daemon.autopilot.port import Command, CommandKind, CommandRefusedError, CommandTimeoutError, NotConnectedError
from daemon.messages import FlightMode, Odometry, Setpoint
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.virtual_time import run_virtual

HOLD, OFFBOARD = 0x03040000, 0x00060000


class TinyPx4:
    """HEARTBEAT at 1 Hz, ODOMETRY each 12 ms, two acks for a mode, one for the rest."""

    def __init__(self) -> None:
        self.time_us = 0
        self.custom_mode = HOLD
        self.refuse_mode = False
        self.silent = False
        self.arm_result: int | None = 0
        self.armings = 0
        self.setpoints: list[tuple[int, dict[str, Any]]] = []
        self._out: list[tuple[str, dict[str, Any]]] = []

    def step(self) -> None:
        self.time_us += 4000
        if self.time_us % 1_000_000 == 0:
            fields = {"type": 2, "autopilot": 12, "base_mode": 29, "custom_mode": self.custom_mode, "system_status": 3}
            self._out.append(("HEARTBEAT", fields))
        if self.time_us % 12_000 == 0:
            self._out.append(("ODOMETRY", self._odometry()))

    def _odometry(self) -> dict[str, Any]:
        return {
            "time_usec": self.time_us, "frame_id": 1, "child_frame_id": 1, "x": 1.0, "y": 2.0, "z": -3.0,
            "q": [1.0, 0.0, 0.0, 0.0], "vx": 0.0, "vy": 0.0, "vz": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0,
            "yawspeed": 0.0, "pose_covariance": [0.04] * 21, "velocity_covariance": [0.01] * 21, "reset_counter": 11,
        }  # fmt: skip

    def receive(
        self, name: str, fields: dict[str, Any], *, sender_system: int = 1, sender_component: int = 195
    ) -> None:
        if name == "SET_ATTITUDE_TARGET":
            self.setpoints.append((self.time_us, fields))
        elif name == "PARAM_REQUEST_READ":
            self._out.append(("PARAM_VALUE", {"param_id": fields["param_id"], "param_value": 0.5, "param_type": 9}))
        elif name == "COMMAND_LONG" and fields["command"] == 176:
            self._out.append(("COMMAND_ACK", {"command": 176, "result": 0}))
            self._out.append(("COMMAND_ACK", {"command": 176, "result": 1 if self.refuse_mode else 0}))
            if not self.refuse_mode:
                self.custom_mode = int(fields["param2"]) << 16 | int(fields["param3"]) << 24
                mode = {"custom_mode": self.custom_mode, "intended_custom_mode": self.custom_mode}
                self._out.append(("CURRENT_MODE", mode))
        elif name == "COMMAND_LONG" and fields["command"] == 400:
            self.armings += 1
            if self.arm_result is not None:
                self._out.append(("COMMAND_ACK", {"command": 400, "result": self.arm_result}))

    def take_outgoing(self) -> list[tuple[str, dict[str, Any]]]:
        out, self._out = self._out, []
        return [] if self.silent else out


async def connected(autopilot: InProcessAutopilot) -> "asyncio.Task[None]":
    task = asyncio.ensure_future(autopilot.run())
    await asyncio.sleep(1.1)
    assert autopilot.status.value.connected
    return task


def test_samples_arrive_at_the_moment_at_which_they_are_sent() -> None:
    async def fly() -> Odometry | None:
        autopilot = InProcessAutopilot(TinyPx4())
        task = await connected(autopilot)
        task.cancel()
        return autopilot.odometry.value

    odometry = run_virtual(fly())
    assert odometry is not None
    assert odometry.position_m == (1.0, 2.0, -3.0)
    assert odometry.arrival_s == pytest.approx(odometry.stamp_us * 1e-6, abs=1e-6)


def test_setpoints_reach_the_vehicle_at_once_and_only_when_there_is_one() -> None:
    async def fly() -> tuple[list[tuple[int, dict[str, Any]]], float]:
        px4 = TinyPx4()
        autopilot = InProcessAutopilot(px4)
        assert not autopilot.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
        task = await connected(autopilot)
        assert autopilot.send_setpoint(Setpoint((0.1, 0.2, 0.3), 0.5))
        assert not autopilot.send_setpoint(Setpoint((0.0, float("nan"), 0.0), 0.5))
        assert not autopilot.send_setpoint(Setpoint((0.0, 0.0, 0.0), float("nan")))
        task.cancel()
        return px4.setpoints, asyncio.get_running_loop().time()

    ((received_us, fields),), sent_s = run_virtual(fly())
    assert received_us * 1e-6 == pytest.approx(sent_s, abs=1e-5)
    assert fields["body_yaw_rate"] == 0.3


def test_a_mode_takes_effect_or_is_refused_with_a_reason() -> None:
    async def fly() -> None:
        px4 = TinyPx4()
        autopilot = InProcessAutopilot(px4)
        assert not autopilot.request_mode(FlightMode.OFFBOARD)
        task = await connected(autopilot)
        assert autopilot.request_mode(FlightMode.OFFBOARD)
        await asyncio.sleep(0.02)
        assert autopilot.status.value.mode is FlightMode.OFFBOARD
        px4.refuse_mode = True
        assert autopilot.request_mode(FlightMode.HOLD)
        await asyncio.sleep(0.02)
        refusal = autopilot.status.value.mode_refusal
        assert refusal is not None
        assert (refusal.mode, refusal.reason) == (FlightMode.HOLD, "temporarily rejected")
        assert not autopilot.request_mode(FlightMode.UNKNOWN)
        task.cancel()

    run_virtual(fly())


def test_commands_and_parameters_are_answered() -> None:
    async def fly() -> None:
        px4 = TinyPx4()
        autopilot = InProcessAutopilot(px4)
        with pytest.raises(NotConnectedError):
            await autopilot.command(Command(CommandKind.ARM), 1.0)
        task = await connected(autopilot)
        await autopilot.command(Command(CommandKind.ARM), 1.0)
        px4.arm_result = 1
        with pytest.raises(CommandRefusedError, match="temporarily rejected"):
            await autopilot.command(Command(CommandKind.ARM), 1.0)
        px4.arm_result = None
        with pytest.raises(CommandTimeoutError):
            await autopilot.command(Command(CommandKind.ARM), 1.0)
        assert await autopilot.read_parameter("MPC_THR_HOVER", 1.0) == 0.5
        task.cancel()

    run_virtual(fly())


def test_a_command_that_nobody_waits_for_any_more_is_not_sent_again() -> None:
    async def fly() -> None:
        px4 = TinyPx4()
        autopilot = InProcessAutopilot(px4)
        px4.arm_result = None
        task = await connected(autopilot)
        arming = asyncio.ensure_future(autopilot.command(Command(CommandKind.ARM), 2.0))
        await asyncio.sleep(0.3)
        arming.cancel()
        await asyncio.sleep(1.0)
        task.cancel()
        assert px4.armings == 1

    run_virtual(fly())


def test_silence_is_a_lost_link_and_comes_back() -> None:
    async def fly() -> None:
        px4 = TinyPx4()
        autopilot = InProcessAutopilot(px4)
        task = await connected(autopilot)
        px4.silent = True
        await asyncio.sleep(1.6)
        assert not autopilot.status.value.connected
        assert not autopilot.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
        assert px4.time_us > 1_600_000
        px4.silent = False
        await asyncio.sleep(1.1)
        assert autopilot.status.value.connected
        task.cancel()

    run_virtual(fly())


def test_a_fault_of_the_simulation_ends_the_run_with_it() -> None:
    class Broken(TinyPx4):
        def step(self) -> None:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_virtual(InProcessAutopilot(Broken()).run())
