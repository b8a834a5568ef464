"""What the check for calls that wait finds, and that flights have none; each row of the fault matrix is checked too."""

import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from support import blocking_calls
from support.flight import Flight, fly

from daemon import config, notify
from daemon.realtime import preload


def _load_configuration() -> None:
    config.load([])


def _look_up_a_name() -> None:
    socket.getaddrinfo("localhost", 1)


@pytest.mark.parametrize(
    ("call", "words"),
    [(_load_configuration, "open"), (lambda: time.sleep(0.001), "time.sleep"), (_look_up_a_name, "socket.getaddrinfo")],
    ids=["file", "sleep", "name"],
)
def test_a_listener_that_waits_is_found(call: Callable[[], None], words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocking_calls, "ALLOWED", ())

    async def scenario(flight: Flight) -> None:
        await flight.until(lambda: flight.now_s > 1.0)
        flight.vehicle.control.listeners.append(lambda _inputs, _record: call())
        with blocking_calls.watched() as found:
            await flight.until(lambda: flight.now_s > 1.1)
        assert any(words in line for line in found)

    fly(scenario)


def test_nothing_is_found_in_other_threads_or_while_nobody_watches() -> None:
    with blocking_calls.watched() as found:
        thread = threading.Thread(target=_load_configuration)
        thread.start()
        while thread.is_alive():
            pass
    _load_configuration()
    assert found == []


def test_systemd_is_told_without_waiting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(path))
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        sent = 0
        while notify.notify("WATCHDOG=1"):  # nobody reads: the queue of the socket fills
            sent += 1
        assert sent >= 1
        assert systemd.recv(100) == b"WATCHDOG=1"
        assert notify.notify("WATCHDOG=1")


def test_goals_of_every_kind_are_flown_without_a_call_that_waits() -> None:
    preload()

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        with blocking_calls.watched() as found:
            await flight.result(await flight.goto(4.0, 0.0, -6.0, hold_s=0.5))
            points = [{"position": [8.0, 0.0, -5.0]}, {"position": [8.0, 6.0, -6.0]}, {"position": [0.0, 6.0, -5.0]}]
            for through in ("stop", "fly_by"):
                await flight.result(await flight.submit(path={"waypoints": points, "through": through}))
            circle = {"kind": "circle", "center": [0.0, 0.0, -5.0], "radius_m": 3.0, "speed_m_s": 2.0}
            await flight.result(await flight.submit(trajectory=circle))
        assert found == []

    fly(scenario)
