"""The live link with real MAVSDK, against a stand-in for PX4 on a loopback socket."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import structlog
from support.processes import free_udp_port
from support.standstill import where_it_runs

from daemon.autopilot import mavsdk_link
from daemon.autopilot.mavsdk_link import LogLevel, MavsdkLink
from daemon.autopilot.port import Command, CommandKind, CommandRefusedError, NotConnectedError
from daemon.autopilot.streams import STREAMS
from daemon.messages import FlightMode, LandedState, Setpoint
from daemon.sim.mavlink_codec import MavlinkCodec

HOLD = 0x03040000
PATIENCE_S = 60.0
CLOCK_BEHIND_S = 0.75


class UdpPx4(asyncio.DatagramProtocol):
    """Sends HEARTBEAT at 5 Hz and ODOMETRY at 100 Hz to a port; answers commands and remembers what came."""

    def __init__(self, port: int, system_id: int = 7) -> None:
        self.port = port
        self.codec = MavlinkCodec(system_id)
        self.boot_us = 5_000_000
        self.custom_mode = HOLD
        self.results: dict[int, list[int]] = {}
        self.events_after_ack: list[dict[str, Any]] = []
        self.received: list[tuple[str, dict[str, Any], int, int]] = []
        self.silent = False
        self.north_m = 1.5
        self._transport: asyncio.DatagramTransport | None = None
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        self._task = asyncio.ensure_future(self._run())

    async def stop(self) -> None:
        assert self._task is not None and self._transport is not None
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        self._transport.close()

    def of(self, name: str) -> list[dict[str, Any]]:
        return [fields for got, fields, _, _ in self.received if got == name]

    def commands(self, number: int) -> list[dict[str, Any]]:
        return [fields for fields in self.of("COMMAND_LONG") if fields["command"] == number]

    def send(self, name: str, fields: dict[str, Any]) -> None:
        assert self._transport is not None
        if not self.silent:
            self._transport.sendto(self.codec.encode(name, fields), ("127.0.0.1", self.port))

    async def _run(self) -> None:
        tick = 0
        while True:
            if tick % 20 == 0:
                self.send("HEARTBEAT", {"type": 2, "autopilot": 12, "base_mode": 157, "custom_mode": self.custom_mode,
                                        "system_status": 4, "mavlink_version": 3})  # fmt: skip
                self.send("EXTENDED_SYS_STATE", {"landed_state": 2})
            self.boot_us += 10_000
            self.send("ODOMETRY", {"time_usec": self.boot_us, "frame_id": 1, "child_frame_id": 1, "x": self.north_m,
                                   "y": -2.5, "z": -10.0, "q": [0.5, 0.5, 0.5, 0.5], "vx": 3.0, "vy": 4.0, "vz": -1.0,
                                   "rollspeed": 0.125, "pitchspeed": 0.25, "yawspeed": 0.5, "reset_counter": 255,
                                   "pose_covariance": [None] * 21, "velocity_covariance": [0.0] * 21})  # fmt: skip
            tick += 1
            await asyncio.sleep(0.01)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        for message in self.codec.decode(data):
            self.received.append(message)
            name, fields = message[:2]
            if name == "COMMAND_LONG":
                number = int(fields["command"])
                for result in self.results.get(number, [0, 0] if number == 176 else [0]):
                    self.send("COMMAND_ACK", {"command": number, "result": result, "target_system": message[2],
                                              "target_component": message[3]})  # fmt: skip
                for event in self.events_after_ack if number in self.results else []:
                    self.send("EVENT", event)
            elif name == "TIMESYNC" and fields["tc1"] == 0:
                shows_s = asyncio.get_running_loop().time() - CLOCK_BEHIND_S
                self.send("TIMESYNC", {"tc1": round(shows_s * 1e9), "ts1": fields["ts1"],
                                       "target_system": message[2], "target_component": message[3]})  # fmt: skip
            elif name == "PARAM_REQUEST_READ":
                self._answer_parameter(fields["param_id"])

    def _answer_parameter(self, name: str) -> None:
        known: dict[str, tuple[float, int]] = {"MPC_THR_HOVER": (0.5, 9), "COM_RC_OVERRIDE": (3, 6)}
        if name in known:
            value, kind = known[name]
            self.send("PARAM_VALUE", {"param_id": name, "param_value": value, "param_type": kind})
        else:
            self.send("PARAM_ERROR", {"param_id": name, "error": 1, "target_system": 1, "target_component": 195})


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110  # the conditions are cells, not events
            await asyncio.sleep(0.005)


@contextlib.asynccontextmanager
async def running(link: MavsdkLink) -> AsyncIterator["asyncio.Task[None]"]:
    task = asyncio.ensure_future(link.run())
    try:
        yield task
    finally:
        task.cancel()
        async with asyncio.timeout(PATIENCE_S):
            with contextlib.suppress(asyncio.CancelledError):
                await task
            await link.close()


@contextlib.asynccontextmanager
async def connected() -> AsyncIterator[tuple[MavsdkLink, UdpPx4]]:
    port = free_udp_port()
    link, px4 = MavsdkLink(f"udpin://127.0.0.1:{port}"), UdpPx4(port)
    async with running(link):
        await px4.start()
        try:
            await until(lambda: link.status.value.connected and link.odometry.value is not None)
            yield link, px4
        finally:
            await px4.stop()


async def test_it_starts_without_an_autopilot_and_waits() -> None:
    link = MavsdkLink(f"udpin://127.0.0.1:{free_udp_port()}")
    async with running(link) as task:
        await asyncio.sleep(0.3)
        assert not task.done()
        assert not link.status.value.connected
        assert not link.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
        assert not link.request_mode(FlightMode.HOLD)
        with pytest.raises(NotConnectedError):
            await link.command(Command(CommandKind.ARM), 1.0)


async def test_on_connect_the_whole_table_is_asked_for_and_telemetry_comes_out_in_its_units() -> None:
    async with connected() as (link, px4):
        await until(lambda: link.status.value.landed is LandedState.IN_AIR)
        await until(lambda: {int(f["param1"]) for f in px4.commands(511)} >= {s.message_id for s in STREAMS})
        rates = {int(f["param1"]): f["param2"] for f in px4.commands(511)}
        assert rates[331] == pytest.approx(10_000.0)
        status, odometry = link.status.value, link.odometry.value
        assert (status.mode, status.armed) == (FlightMode.HOLD, True)
        assert odometry is not None
        assert (odometry.frame_id, odometry.child_frame_id, odometry.reset_counter) == (1, 1, 255)
        assert (odometry.position_m, odometry.velocity_m_s) == ((1.5, -2.5, -10.0), (3.0, 4.0, -1.0))
        assert (odometry.attitude_wb, odometry.rates_frd_rad_s) == ((0.5, 0.5, 0.5, 0.5), (0.125, 0.25, 0.5))
        assert odometry.position_variance_m2[0] != odometry.position_variance_m2[0]
        version = link.odometry.version
        await until(lambda: link.odometry.version > version + 5)


async def test_the_autopilots_clock_is_known_by_timesync_and_its_requests_are_answered() -> None:
    async with connected() as (link, px4):
        await until(lambda: link.clock.value is not None)
        sync = link.clock.value
        assert sync is not None
        assert abs(sync.offset_s - CLOCK_BEHIND_S) <= sync.uncertainty_s + 1e-4
        px4.send("TIMESYNC", {"tc1": 0, "ts1": 12_345_678_901})
        await until(lambda: any(f["ts1"] == 12_345_678_901 and f["tc1"] > 0 for f in px4.of("TIMESYNC")))


async def test_setpoints_arrive_as_sent_addressed_to_the_vehicle_also_from_another_thread() -> None:
    async with connected() as (link, px4):
        assert link.send_setpoint(Setpoint((0.125, -0.25, 0.5), 0.75))
        assert await asyncio.to_thread(link.send_setpoint, Setpoint((1.0, 0.0, 0.0), 0.5))
        assert not link.send_setpoint(Setpoint((float("nan"), 0.0, 0.0), 0.5))
        assert not link.send_setpoint(Setpoint((0.0, 0.0, 0.0), float("inf")))
        await until(lambda: len(px4.of("SET_ATTITUDE_TARGET")) >= 2)
        await asyncio.sleep(0.3)
        first, second = px4.of("SET_ATTITUDE_TARGET")  # exactly two: nothing is repeated by anybody
        assert (first["target_system"], first["target_component"], first["type_mask"]) == (7, 1, 128)
        assert (first["body_roll_rate"], first["body_pitch_rate"], first["body_yaw_rate"]) == (0.125, -0.25, 0.5)
        assert (first["thrust"], second["body_roll_rate"]) == (0.75, 1.0)


async def test_a_number_that_is_not_finite_does_not_even_reach_mavsdk(monkeypatch: pytest.MonkeyPatch) -> None:
    async with connected() as (link, _px4):
        handed: list[str] = []
        assert link._wire is not None
        monkeypatch.setattr(link._wire, "direct", Mock(send_message=lambda message: handed.append(message.fields_json)))
        for bad in (float("nan"), float("inf"), -float("inf")):
            assert not link.send_setpoint(Setpoint((0.0, bad, 0.0), 0.5))
            assert not link.send_setpoint(Setpoint((0.0, 0.0, 0.0), bad))
        assert handed == []
        assert link.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
        assert len(handed) == 1


async def test_what_other_components_of_the_vehicle_say_is_not_the_autopilots() -> None:
    """A gimbal or a companion of the same system may send ODOMETRY and CURRENT_MODE of its own."""
    async with connected() as (link, px4):

        def north_m() -> float:
            assert link.odometry.value is not None and link.odometry.value.position_m[0] != 77.0
            return link.odometry.value.position_m[0]

        own, px4.codec = px4.codec, MavlinkCodec(px4.codec.system_id, component_id=154)
        px4.north_m = 77.0
        px4.send("CURRENT_MODE", {"custom_mode": 0x00060000, "intended_custom_mode": 0x00060000})
        for _ in range(40):  # its ODOMETRY at 100 Hz
            assert north_m() == 1.5
            await asyncio.sleep(0.005)
        px4.codec, px4.north_m = own, 2.5
        await until(lambda: north_m() == 2.5)
        assert link.status.value.mode is FlightMode.HOLD


@pytest.mark.parametrize("other_thread", [False, True])
async def test_a_refused_mode_is_told_with_its_reason(other_thread: bool) -> None:
    async with connected() as (link, px4):
        px4.results[176] = [0, 1]
        px4.events_after_ack = [{"id": 27280279, "arguments": "0000060002"}]
        asked = link.request_mode
        assert await asyncio.to_thread(asked, FlightMode.OFFBOARD) if other_thread else asked(FlightMode.OFFBOARD)
        await until(lambda: link.status.value.mode_refusal is not None)
        await until(lambda: "not possible" in getattr(link.status.value.mode_refusal, "reason", ""))
        (command,) = px4.commands(176)
        assert (command["param1"], command["param2"], command["target_system"]) == (129.0, 6.0, 7)
        assert command["param4"] != command["param4"]


async def test_a_mode_that_current_mode_shows_is_the_mode() -> None:
    async with connected() as (link, px4):
        px4.send("CURRENT_MODE", {"custom_mode": 0x00060000, "intended_custom_mode": 0x00060000})
        await until(lambda: link.status.value.mode is FlightMode.OFFBOARD)
        px4.custom_mode = 0x00060000
        px4.send("EVENT", {"id": 31382480, "arguments": "0000060006"})
        await until(lambda: link.status.value.mode is FlightMode.RETURN)
        assert link.status.value.intended_mode is FlightMode.OFFBOARD


async def test_commands_and_parameters_are_answered() -> None:
    async with connected() as (link, px4):
        await link.command(Command(CommandKind.TAKEOFF, 494.5), PATIENCE_S)
        assert px4.commands(22)[0]["param7"] == 494.5
        assert await link.read_parameter("MPC_THR_HOVER", PATIENCE_S) == 0.5
        assert await link.read_parameter("COM_RC_OVERRIDE", PATIENCE_S) == 3
        assert await link.read_parameter("NO_SUCH_PARAM", PATIENCE_S) is None


async def test_a_refused_command_is_told_with_the_reason_that_comes_right_after(tmp_path: Path) -> None:
    async def refused(_folder: Path) -> None:
        async with connected() as (link, px4):
            px4.results[400] = [1]
            px4.events_after_ack = [{"id": 16910493, "arguments": ""}]
            with pytest.raises(CommandRefusedError) as told:
                await link.command(Command(CommandKind.ARM), PATIENCE_S)
            assert "temporarily rejected; arming denied" in str(told.value)

    await where_it_runs(refused, tmp_path)


async def test_a_rebooted_autopilot_is_asked_again_even_from_another_port() -> None:
    async with connected() as (link, px4):
        await until(lambda: len(px4.commands(511)) >= len(STREAMS))
        await px4.stop()
        await until(lambda: not link.status.value.connected)
        again = UdpPx4(px4.port)
        again.boot_us = 300_000  # no longer up than it was silent
        await again.start()
        try:
            await until(lambda: link.status.value.connected and link.status.value.boot_count == 1)
            await until(lambda: {int(f["param1"]) for f in again.commands(511)} >= {s.message_id for s in STREAMS})
            assert link.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
            await until(lambda: len(again.of("SET_ATTITUDE_TARGET")) == 1)
        finally:
            await again.stop()


async def test_mavsdks_log_goes_into_ours_and_not_to_stdout(capfd: pytest.CaptureFixture[str]) -> None:
    with structlog.testing.capture_logs() as lines:
        async with connected() as (_link, _px4):
            await until(lambda: any(line["event"] == "link_up" for line in lines))
    assert any("New system" in line.get("text", "") for line in lines)
    assert "New system" not in capfd.readouterr().out


async def test_nothing_can_be_sent_after_the_end() -> None:
    async with connected() as (link, _px4):
        assert link.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
        wire = link._wire
    assert not link.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
    assert wire is not None
    wire.direct = Mock()  # the dead-man's thread may hold the wire still
    assert not wire.send_setpoint(Setpoint((0.0, 0.0, 0.0), 0.5))
    assert wire.direct.mock_calls == []
    assert not link.request_mode(FlightMode.HOLD)


async def test_a_mode_can_be_asked_for_when_the_run_has_failed_until_the_link_is_closed() -> None:
    def fail(_now_s: float) -> None:
        raise ZeroDivisionError

    port = free_udp_port()
    link, px4 = MavsdkLink(f"udpin://127.0.0.1:{port}"), UdpPx4(port)
    run = asyncio.ensure_future(link.run())
    await px4.start()
    try:
        await until(lambda: link.status.value.connected)
        link.session.poll = fail  # type: ignore[method-assign]
        with pytest.raises(ZeroDivisionError):
            await run
        assert link.request_mode(FlightMode.HOLD)
        await until(lambda: len(px4.commands(176)) == 1)
    finally:
        await link.close()
        await px4.stop()
    assert not link.request_mode(FlightMode.HOLD)


@pytest.mark.parametrize("url", ["serial:///dev/does-not-exist:921600", "nonsense://"])
async def test_a_connection_that_cannot_be_opened_is_tried_again_told_at_each_tenth_time_and_ends_cleanly(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mavsdk_link, "_RETRY_S", 0.02)

    def told() -> list[int]:
        return [line["tries"] for line in lines if line["event"] == "connection_failed"]

    with structlog.testing.capture_logs() as lines:
        link = MavsdkLink(url)
        async with running(link) as task:
            await until(lambda: len(told()) >= 2)
            assert not task.done()
    assert told()[:2] == [1, 11]


def test_a_line_that_mavsdk_repeats_is_logged_once(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(mavsdk_link.time, "monotonic", lambda: now_s)
    log = mavsdk_link._MavsdkLog()
    with structlog.testing.capture_logs() as lines:
        for _ in range(50):
            assert log(LogLevel.ERROR, "Sending message failed", None, 0)
        log(LogLevel.WARN, "another", None, 0)
        now_s += 11.0
        log(LogLevel.ERROR, "Sending message failed", None, 0)
    assert [(line["text"], line["log_level"], line.get("repeats")) for line in lines] == [
        ("Sending message failed", "error", None),
        ("another", "warning", None),
        ("Sending message failed", "error", 49),
    ]
