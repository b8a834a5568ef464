"""A serial connection, by a pseudo-terminal: the adapter is pulled, and plugged in again as another device."""

import asyncio
import contextlib
import os
import socket
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.air import air
from support.processes import daemon_on, until

from daemon.goals.client import FlightClient
from daemon.messages import FlightMode


@contextmanager
def plugged(path: Path, port: int) -> Iterator[None]:
    """The vehicle that sends to a UDP port, behind a serial device at a path."""
    loop = asyncio.get_running_loop()
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    path.symlink_to(os.ttyname(slave))
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    vehicle.bind(("127.0.0.1", port))
    peer: list[tuple[str, int]] = []

    def down() -> None:
        data, peer[:] = (lambda data, address: (data, [address]))(*vehicle.recvfrom(65536))
        with contextlib.suppress(BlockingIOError):  # as a full line drops it
            os.write(master, data)

    def up() -> None:
        data = os.read(master, 4096)
        for address in peer:
            vehicle.sendto(data, address)

    loop.add_reader(vehicle, down)
    loop.add_reader(master, up)
    try:
        yield
    finally:
        loop.remove_reader(vehicle)
        loop.remove_reader(master)
        path.unlink()
        vehicle.close()
        os.close(slave)
        os.close(master)


async def test_a_serial_device_that_is_plugged_in_again_is_opened_again(tmp_path: Path) -> None:
    device = tmp_path / "tty"
    async with air() as seen, daemon_on(tmp_path, f"serial://{device}:921600") as child:
        port = int(seen.connection.rpartition(":")[2])
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            for _ in range(2):
                with plugged(device, port):
                    await until(flight, lambda status: status["state"] in ("pilot", "ready"))
                    await until(flight, lambda status: status["vehicle"] is not None)
                    await flight.hold()
                    assert seen.px4.mode is FlightMode.HOLD
                await until(flight, lambda status: status["state"] == "disconnected")
