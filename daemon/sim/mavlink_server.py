"""Simulated PX4s as they appear on the wire: MAVLink 2 over UDP to loopback ports, in real time or at a factor of it.

Vehicle number n sends to port P + n from a port of its own, as PX4's SITL instances do; answers come back there.
A Unix socket takes requests while it runs, one JSON object a line, and answers each with one.
"""

import asyncio
import contextlib
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daemon.sim.control_socket import Handler, control_socket
from daemon.sim.in_process import STEP_S, SteppedPx4
from daemon.sim.mavlink_codec import MavlinkCodec

DEFAULT_PORT = 14540
_HOST = "127.0.0.1"
_DATAGRAM_BYTES = 1400  # PX4 gathers messages into datagrams of about this size
_ROUNDING = 1e-3  # of a step: a timer that fired on its nanosecond is not early
_LARGEST_CATCH_UP = 250  # steps; a machine that stalled for longer than a second of simulated time loses it


class MavlinkEndpoint(asyncio.DatagramProtocol):
    """One vehicle's UDP socket. ``unsendable`` counts, by name, messages that MAVLink has no packet for."""

    def __init__(self, px4: SteppedPx4, system_id: int, port: int) -> None:
        self.px4 = px4
        self.port = port
        self.unsendable: dict[str, int] = {}
        self._codec = MavlinkCodec(system_id)
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Bind to a free port of loopback."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(_HOST, 0))

    def close(self) -> None:
        """Give the socket back."""
        if self._transport is not None:
            self._transport.close()

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Whatever MAVLink messages it holds go to the vehicle."""
        for name, fields, system_id, component_id in self._codec.decode(data):
            self.px4.receive(name, fields, sender_system=system_id, sender_component=component_id)

    def send_outgoing(self) -> None:
        """Send what the vehicle has to say, several messages to a datagram."""
        datagram = b""
        for name, fields in self.px4.take_outgoing():
            packet = self._encode(name, fields)
            if len(datagram) + len(packet) > _DATAGRAM_BYTES:
                self._send(datagram)
                datagram = b""
            datagram += packet
        self._send(datagram)

    def _encode(self, name: str, fields: dict[str, Any]) -> bytes:
        try:
            return self._codec.encode(name, fields)
        except (KeyError, ValueError, OverflowError, struct.error):
            self.unsendable[name] = self.unsendable.get(name, 0) + 1
            return b""

    def _send(self, datagram: bytes) -> None:
        if datagram and self._transport is not None:
            self._transport.sendto(datagram, (_HOST, self.port))


class MavlinkServer:
    """Steps vehicles on one 4 ms grid of the loop's clock and carries their messages.

    ``speed`` 2.0 makes a second of theirs half a second of ours. ``steps`` counts those that were made, ``late_steps``
    those of them that began when the next was due already and were made up for, ``lost_steps`` those that were skipped
    because the machine stalled; ``latest_s`` is how long after its time a step began at worst. System ids are the
    vehicles' own, counting up as the ports do.
    """

    def __init__(
        self,
        vehicles: Sequence[SteppedPx4],
        *,
        port: int = DEFAULT_PORT,
        first_system_id: int = 1,
        speed: float = 1.0,
        control_path: Path | None = None,
        on_request: Handler | None = None,
    ) -> None:
        self.endpoints = [
            MavlinkEndpoint(px4, first_system_id + index, port + index) for index, px4 in enumerate(vehicles)
        ]
        self.speed = speed
        self.steps = self.late_steps = self.lost_steps = 0
        self.latest_s = 0.0
        self._control_path = control_path
        self._on_request = on_request

    async def run(self) -> None:
        """Fly until cancelled."""
        async with contextlib.AsyncExitStack() as stack:
            for endpoint in self.endpoints:
                await endpoint.open()
                stack.callback(endpoint.close)
            if self._control_path is not None and self._on_request is not None:
                await stack.enter_async_context(control_socket(self._control_path, self._on_request))
            await self._fly()

    async def _fly(self) -> None:
        loop = asyncio.get_running_loop()
        period_s = STEP_S / self.speed
        start_s, step = loop.time(), 0
        while True:
            now_s = loop.time()
            due = int((now_s - start_s) / period_s + _ROUNDING) - step
            if due > 0:
                self.latest_s = max(self.latest_s, now_s - start_s - (step + 1) * period_s)
            if due > _LARGEST_CATCH_UP:
                self.lost_steps += due - 1
                step += due - 1
                due = 1
            for _ in range(due):
                self._step()
            step += due
            self.steps += due
            self.late_steps += max(0, due - 1)
            await asyncio.sleep(max(0.0, start_s + (step + 1) * period_s - loop.time()))

    def _step(self) -> None:
        for endpoint in self.endpoints:
            endpoint.px4.step()
            endpoint.send_outgoing()
