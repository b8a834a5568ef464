import base64
import json
import os
import socket
import struct
import time
from collections.abc import Callable
from typing import Any

from daemon.recording.live import HOST, Live
from daemon.recording.topics import Step

PATIENCE_S = 60.0


class Viewer:
    """As much of a WebSocket client (RFC 6455) and of Foxglove's protocol as a test needs."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection((HOST, port), PATIENCE_S)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self._stream = self._socket.makefile("rb")
        assert b"101" in self._stream.readline()
        while self._stream.readline().strip():
            pass

    def receive(self) -> tuple[int, bytes]:
        """Opcode (1 text, 2 binary) and payload of the next frame."""
        head, size = self._stream.read(2)
        if size == 126:
            (size,) = struct.unpack(">H", self._stream.read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._stream.read(8))
        return head & 15, self._stream.read(size)

    def until(self, wanted: Callable[[int, bytes], Any]) -> Any:
        while True:
            found = wanted(*self.receive())
            if found:
                return found

    def send(self, message: dict[str, Any]) -> None:
        raw = json.dumps(message).encode()
        assert len(raw) < 126
        self._socket.sendall(bytes((0x81, 0x80 | len(raw), 0, 0, 0, 0)) + raw)

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


def test_a_viewer_sees_the_topics_and_gets_the_ticks(fly: Callable[..., None]) -> None:
    live = Live(0, 1.8e9, 200, 0.01)
    assert live.port is not None
    viewer = Viewer(live.port)
    try:
        channels: dict[str, Any] = {}

        def advertised(opcode: int, data: bytes) -> bool:
            message = json.loads(data) if opcode == 1 else {}
            channels.update({c["topic"]: c for c in message.get("channels", [])})
            return "/flightd/tick" in channels and "/pose" in channels

        viewer.until(advertised)
        assert channels["/flightd/tick"]["encoding"] == "cdr"
        assert channels["/pose"]["schemaName"] == "foxglove.PoseInFrame"
        viewer.send({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channels["/flightd/tick"]["id"]}]})
        steps: list[Step] = []
        fly(10, lambda *step: steps.append(Step(*step)))

        def tick(opcode: int, data: bytes) -> Any:
            return (opcode, data) if opcode == 2 and data[0] == 1 else None

        until_s = time.monotonic() + PATIENCE_S
        while not live._topics._tick.has_sinks():  # until the subscription has arrived
            assert time.monotonic() < until_s
            live.tick(steps[0])
        live.tick(steps[5])
        _, data = viewer.until(tick)
        assert len(data) > 900
    finally:
        viewer.close()
        live.close()


def test_a_port_that_is_taken_costs_the_live_view_only(fly: Callable[..., None]) -> None:
    first = Live(0, 0.0, 200, 0.01)
    second = Live(first.port or 0, 0.0, 200, 0.01)
    try:
        assert second.port is None
        fly(3, lambda *step: second.tick(Step(*step)))
    finally:
        first.close()
        second.close()


def test_only_this_machine_can_look() -> None:
    live = Live(0, 0.0, 200, 0.01)
    try:
        assert HOST == "127.0.0.1"
        with socket.create_connection((HOST, live.port or 0), PATIENCE_S) as connection:
            assert connection.getpeername()[0] == HOST
    finally:
        live.close()
