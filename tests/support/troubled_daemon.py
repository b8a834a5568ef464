"""``flightd run`` that gets into trouble on request: ``python troubled_daemon.py CONNECTION SOCKET [CONFIG]``.

SIGUSR1 begins what $TROUBLE names: ``loop_blocked`` and ``interpreter_held`` last $BLOCK_S seconds, ``disk_full`` and
``read_only`` stay, ``reads_file`` reads files in the loop, ``link_dies`` lets the link's task die, and
``dies_while_stopping`` when SIGTERM has come. While setpoints leave, calls that wait on the loop's thread are logged as
``blocking_call``.
"""

import asyncio
import ctypes
import errno
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import blocking_calls

from daemon import app, config, logs
from daemon.autopilot.session import Px4Session
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record

BLOCK_S = float(os.environ.get("BLOCK_S", "0"))
_run = app._main
_open, _mkdir = Path.open, Path.mkdir


def _loop_blocked() -> None:
    time.sleep(BLOCK_S)


def _interpreter_held() -> None:
    ctypes.PyDLL(None).usleep(int(BLOCK_S * 1e6))  # unlike CDLL it keeps the interpreter lock during the call


def _disk_full() -> None:
    """The kernel's own ENOSPC: for the record that is open, and for those that come."""
    _swap_record(os.open("/dev/full", os.O_WRONLY))
    Path.open = lambda self, mode="r", **more: (  # type: ignore[method-assign,assignment]
        _open(Path("/dev/full"), "wb", **more) if mode == "xb" else _open(self, mode, **more)
    )


def _read_only() -> None:
    """A disk that the kernel has made read-only after an error: nothing more is written, nothing is opened."""

    def refuse(self: Path, mode: Any = "r", **more: Any) -> Any:
        if mode == "xb":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))
        return _open(self, mode, **more)

    _swap_record(os.open("/dev/null", os.O_RDONLY))
    Path.open = refuse  # type: ignore[method-assign,assignment]


def _swap_record(by: int) -> None:
    for entry in Path("/proc/self/fd").iterdir():
        if entry.is_symlink() and str(entry.readlink()).endswith(".mcap"):
            os.dup2(by, int(entry.name))


def _reads_file() -> None:
    config.load([])


def _link_dies() -> None:
    def die(_self: Px4Session, _now_s: float) -> None:
        raise RuntimeError("let die")

    Px4Session.poll = die  # type: ignore[method-assign]


def _dies_while_stopping() -> None:
    release = Vehicle.release

    async def die(self: Vehicle) -> None:
        Vehicle.release = release  # type: ignore[method-assign]
        _link_dies()
        await release(self)
        await asyncio.sleep(1.0)

    Vehicle.release = die  # type: ignore[method-assign]


TROUBLES = {
    "": lambda: None,
    "loop_blocked": _loop_blocked,
    "interpreter_held": _interpreter_held,
    "disk_full": _disk_full,
    "read_only": _read_only,
    "reads_file": _reads_file,
    "link_dies": _link_dies,
    "dies_while_stopping": _dies_while_stopping,
}


class _Witness:
    """A listener of the control task that watches its thread while setpoints leave."""

    def __init__(self) -> None:
        self._found: list[str] | None = None

    def __call__(self, _inputs: Inputs, record: Record) -> None:
        while self._found:
            logs.get("test").error("blocking_call", call=self._found.pop())
        if record.setpoint is None:
            self._found = None
            blocking_calls.end()
        elif self._found is None:
            self._found = blocking_calls.begin()


def _watch(vehicle: Vehicle) -> None:
    vehicle.control.listeners.append(_Witness())


async def _main(*arguments: Any) -> int:
    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, TROUBLES[os.environ.get("TROUBLE", "")])
    return await _run(*arguments)


app._main = _main

if __name__ == "__main__":
    connection, path, *files = sys.argv[1:]
    sys.exit(app.run([Path(file) for file in files], connection, Path(path), watch=_watch))
