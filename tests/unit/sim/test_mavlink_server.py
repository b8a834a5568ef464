"""The server in virtual time, over real loopback sockets."""

import asyncio
import contextlib
import json
import socket
import stat
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from daemon.sim.control_socket import control_socket
from daemon.sim.mavlink_codec import MavlinkCodec
from daemon.sim.mavlink_server import MavlinkServer
from daemon.sim.virtual_time import VirtualTimeLoop, run_virtual

STEP_S = 0.004


class Chatter:
    """Says a HEARTBEAT and thirty texts each second; remembers what it is told."""

    def __init__(self) -> None:
        self.steps = 0
        self.told: list[tuple[str, dict[str, Any]]] = []
        self.extra: list[tuple[str, dict[str, Any]]] = []

    def step(self) -> None:
        self.steps += 1

    def receive(
        self, name: str, fields: dict[str, Any], *, sender_system: int = 1, sender_component: int = 195
    ) -> None:
        self.told.append((name, fields | {"from": (sender_system, sender_component)}))

    def take_outgoing(self) -> list[tuple[str, dict[str, Any]]]:
        out, self.extra = self.extra, []
        if self.steps % 250 == 1:
            out.append(("HEARTBEAT", {"type": 2, "autopilot": 12, "custom_mode": 7, "mavlink_version": 3}))
            out += [("STATUSTEXT", {"severity": 4, "text": f"text {number} " + "x" * 40}) for number in range(30)]
        return out


@contextlib.contextmanager
def listening(count: int) -> Any:
    """Sockets on neighbouring ports."""
    for first in range(42000, 60000, 17):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            socks = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
            for index, sock in enumerate(socks):
                sock.bind(("127.0.0.1", first + index))
                sock.settimeout(60.0)
            yield first, socks
            return


@contextlib.asynccontextmanager
async def running(server: MavlinkServer) -> AsyncIterator[None]:
    task = asyncio.ensure_future(server.run())
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@pytest.mark.parametrize(("speed", "steps"), [(1.0, 2500), (4.0, 10000), (0.5, 1250)])
def test_steps_keep_to_the_clock_without_drift(speed: float, steps: int) -> None:
    async def fly() -> int:
        px4 = Chatter()
        with listening(1) as (port, _):
            async with running(MavlinkServer([px4], port=port, speed=speed)):
                await asyncio.sleep(10.0)
        return px4.steps

    assert run_virtual(fly()) == pytest.approx(steps, abs=1)


def test_a_stall_is_skipped_and_counted_not_replayed() -> None:
    async def fly() -> tuple[int, int]:
        px4 = Chatter()
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        with listening(1) as (port, _):
            server = MavlinkServer([px4], port=port)
            async with running(server):
                await asyncio.sleep(1.0)
                loop._clock.now_ns += 5_000_000_000
                await asyncio.sleep(1.0)
        return px4.steps, server.lost_steps

    steps, lost = run_virtual(fly())
    assert steps == pytest.approx(500, abs=3)
    assert lost == pytest.approx(1250, abs=3)


def test_vehicles_speak_on_ports_and_system_ids_that_count_up_in_datagrams_of_modest_size() -> None:
    async def fly(port: int) -> None:
        async with running(MavlinkServer([Chatter(), Chatter()], port=port, first_system_id=4)):
            await asyncio.sleep(0.5)

    with listening(2) as (port, socks):
        run_virtual(fly(port))
        for index, sock in enumerate(socks):
            codec, messages, sizes = MavlinkCodec(255), [], []
            while len(messages) < 31:
                data = sock.recv(65536)
                sizes.append(len(data))
                messages += codec.decode(data)
            assert [name for name, *_ in messages] == ["HEARTBEAT"] + ["STATUSTEXT"] * 30
            assert {system_id for _, _, system_id, _ in messages} == {4 + index}
            assert max(sizes) <= 1400
            assert len(sizes) == 2


def test_answers_come_back_to_the_vehicle_that_was_spoken_to() -> None:
    async def fly(port: int, sock: socket.socket) -> Chatter:
        px4 = Chatter()
        async with running(MavlinkServer([px4], port=port)):
            await asyncio.sleep(0.1)
            _, vehicle = sock.recvfrom(65536)
            sock.sendto(MavlinkCodec(1, 195).encode("SET_ATTITUDE_TARGET", {"thrust": 0.5}), vehicle)
            sock.sendto(b"noise", vehicle)
            await asyncio.sleep(0.1)
        return px4

    with listening(1) as (port, (sock,)):
        ((name, fields),) = run_virtual(fly(port, sock)).told
    assert fields["from"] == (1, 195)
    assert (name, fields["thrust"]) == ("SET_ATTITUDE_TARGET", 0.5)


def test_what_mavlink_cannot_carry_is_counted_and_the_rest_goes_on() -> None:
    async def fly(port: int) -> dict[str, int]:
        px4 = Chatter()
        px4.extra = [("NO_SUCH_MESSAGE", {}), ("HEARTBEAT", {"custom_mode": -1}), ("ATTITUDE", {"roll": 1.0})]
        server = MavlinkServer([px4], port=port)
        async with running(server):
            await asyncio.sleep(0.1)
        return server.endpoints[0].unsendable

    with listening(1) as (port, (sock,)):
        assert run_virtual(fly(port)) == {"NO_SUCH_MESSAGE": 1, "HEARTBEAT": 1}
        assert MavlinkCodec(1).decode(sock.recv(65536))[0][0] == "ATTITUDE"


async def test_the_control_socket_answers_each_line_and_goes_with_the_server(tmp_path: Path) -> None:
    def handler(request: dict[str, Any]) -> dict[str, Any]:
        return {"did": request["fault"]}

    path = tmp_path / "control.sock"
    with listening(1) as (port, _):
        async with running(MavlinkServer([Chatter()], port=port, control_path=path, on_request=handler)):
            async with asyncio.timeout(60.0):
                while not path.exists():  # noqa: ASYNC110  # the file system tells nobody
                    await asyncio.sleep(0.01)
                reader, writer = await asyncio.open_unix_connection(path)
                writer.write(b'{"fault": "gps_loss"}\n{"x": 1}\nnonsense\n[]\n')
                answers = [json.loads(await reader.readline()) for _ in range(4)]
                writer.close()
            assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert answers[0] == {"did": "gps_loss"}
    assert [set(answer) for answer in answers[1:]] == [{"error"}] * 3
    assert not path.exists()


async def test_a_second_simulator_is_refused_and_leaves_the_first_ones_control_socket(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with control_socket(path, lambda request: request):
        with pytest.raises(OSError, match="another simulator runs already"):
            async with control_socket(path, lambda request: request):
                pass
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b'{"fault": "x"}\n')
        assert json.loads(await reader.readline()) == {"fault": "x"}
        writer.close()
