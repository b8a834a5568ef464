"""A client's connection: requests and their replies, notifications, and coming back after the daemon went away."""

import asyncio
import json
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from itertools import count
from numbers import Real
from pathlib import Path
from typing import Any

from daemon.goals.client_errors import (
    ConnectionLostError,
    InvalidRequestError,
    NoDaemonError,
    SocketNotPermittedError,
    error_from,
)
from daemon.goals.errors import MAX_LINE_BYTES, ErrorCode

MAX_REPLY_BYTES = 4 * 1024 * 1024
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 1.0
NOT_CONNECTED = "not connected: use it in a `with` block"

OnNotification = Callable[[str, dict[str, Any]], None]
OnReturn = Callable[[], Coroutine[Any, Any, None]]
OnGone = Callable[[NoDaemonError], None]


class Connection:
    """JSON-RPC over the daemon's socket; with ``reconnect_s`` > 0 it comes back by itself, within that time.

    The time counts from when the daemon was last heard: one that only refuses connections is not there.
    """

    def __init__(
        self, path: Path, reconnect_s: float, on_notification: OnNotification, on_return: OnReturn, on_gone: OnGone
    ) -> None:
        self._path = path
        self._reconnect_s = reconnect_s
        self._on_notification = on_notification
        self._on_return = on_return
        self._on_gone = on_gone
        self._ids = count(1)
        self._pending: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._up = asyncio.Event()
        self._up.set()
        self._gone: NoDaemonError | None = NoDaemonError(NOT_CONNECTED)
        self._complaint: str | None = None
        self._heard = False
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Connect. Raises `NoDaemonError`."""
        reader = await self._connect()
        self._gone = None
        self._task = asyncio.create_task(self._run(reader))

    async def close(self) -> None:
        """Disconnect; what still waits for a reply gets `ConnectionLostError`."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
        self._drop("the connection was closed")
        self._gone = NoDaemonError(NOT_CONNECTED)
        self._up.set()

    async def call(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Result of a request. Raises `RequestError`, `ConnectionLostError` or `NoDaemonError`."""
        await self._up.wait()
        if self._gone is not None:
            raise self._gone
        request_id = next(self._ids)
        future: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._pending[request_id] = future
        try:
            self._write({"jsonrpc": "2.0", "id": request_id, "method": method, "params": params})
            return await future
        finally:
            self._pending.pop(request_id, None)

    async def notify(self, method: str, params: dict[str, Any]) -> None:
        """Send a notification; waits while the daemon does not take what was sent before."""
        await self._up.wait()
        if self._gone is not None:
            raise self._gone
        writer = self._write({"jsonrpc": "2.0", "method": method, "params": params})
        try:
            await writer.drain()
        except ConnectionError:
            raise ConnectionLostError("the daemon went away") from None

    def _write(self, message: dict[str, Any]) -> asyncio.StreamWriter:
        line = _line(message)
        if self._writer is None or self._writer.is_closing():
            raise ConnectionLostError("the daemon went away")
        self._writer.write(line)
        return self._writer

    async def _connect(self) -> asyncio.StreamReader:
        try:
            reader, self._writer = await asyncio.open_unix_connection(str(self._path), limit=MAX_REPLY_BYTES)
        except PermissionError:
            hint = "ask for membership in its group (and log in again), or use sudo"
            raise SocketNotPermittedError(f"the socket {self._path} does not let this user in: {hint}") from None
        except OSError as error:
            why = error.strerror.lower() if error.strerror else str(error)
            hint = "start one with `flightd run` (the service: `sudo systemctl start flightd`), "
            hint += "or name its socket with --socket or $FLIGHTD_SOCKET"
            raise NoDaemonError(f"no daemon listens at {self._path} ({why}): {hint}") from None
        self._up.set()
        return reader

    async def _run(self, reader: asyncio.StreamReader) -> None:
        returning: asyncio.Task[None] | None = None
        error = NoDaemonError("the connection was closed")
        pauses = self._pauses()
        try:
            while True:
                await self._read(reader)
                self._drop("the daemon went away before it answered; the request may still take effect")
                if returning is not None:
                    returning.cancel()
                pauses = self._pauses() if self._heard else pauses
                reader = await self._come_back(pauses)
                returning = asyncio.create_task(self._on_return())
        except NoDaemonError as gone:
            error = gone
        finally:
            if returning is not None:
                returning.cancel()
            self._gone = error
            self._drop(str(error))
            self._up.set()
            self._on_gone(error)

    def _pauses(self) -> Iterator[float]:
        """Pauses before each try to come back, as long as there is time left."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._reconnect_s
        pause_s = FIRST_RETRY_S
        while loop.time() + pause_s < deadline_s:
            yield pause_s
            pause_s = min(2.0 * pause_s, LAST_RETRY_S)

    async def _come_back(self, pauses: Iterator[float]) -> asyncio.StreamReader:
        self._heard = False
        for pause_s in pauses:
            await asyncio.sleep(pause_s)
            with suppress(NoDaemonError):
                return await self._connect()
        raise NoDaemonError(self._complaint or f"the daemon at {self._path} went away and did not come back")

    async def _read(self, reader: asyncio.StreamReader) -> None:
        with suppress(OSError, ValueError, asyncio.IncompleteReadError):
            while line := await reader.readline():
                self._take(json.loads(line))

    def _take(self, message: dict[str, Any]) -> None:
        request_id = message.get("id")
        if request_id is None and "error" in message:  # of the connection, not of a request
            self._complaint = message["error"]["message"]
            return
        self._heard, self._complaint = True, None
        if "method" in message:
            self._on_notification(message["method"], message["params"])
            return
        future = self._pending.get(request_id) if request_id is not None else None
        if future is None or future.done():
            return
        if "error" in message:
            future.set_exception(error_from(message["error"]))
        else:
            future.set_result(message["result"])

    def _drop(self, reason: str) -> None:
        self._up.clear()
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        for future in self._pending.values():
            if not future.done():
                future.set_exception(ConnectionLostError(self._complaint or reason))


def _line(message: dict[str, Any]) -> bytes:
    """Raises `InvalidRequestError` when the daemon could not even say which request it refuses."""
    try:
        line = json.dumps(message, separators=(",", ":"), allow_nan=False, default=_number).encode("ascii") + b"\n"
    except (TypeError, ValueError) as error:
        reason = str(error) if isinstance(error, TypeError) else "a number is not finite"
        raise InvalidRequestError(ErrorCode.INVALID_PARAMS, reason, "params", reason) from None
    if len(line) > MAX_LINE_BYTES:
        reason = f"is longer than {MAX_LINE_BYTES} bytes"
        raise InvalidRequestError(ErrorCode.INVALID_REQUEST, f"the request {reason}", None, f"the request {reason}")
    return line


def _number(value: object) -> float:
    """Numbers that are not Python's own, numpy's for one."""
    if not isinstance(value, Real):
        raise TypeError(f"a {type(value).__name__} is not JSON")
    return float(value)
