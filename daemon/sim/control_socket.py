"""Requests to a running simulator: a Unix socket, one JSON object a line, each answered with one."""

import asyncio
import contextlib
import errno
import json
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from daemon import logs

Handler = Callable[[dict[str, Any]], dict[str, Any]]

_log = logs.get("sim")


@contextlib.asynccontextmanager
async def control_socket(path: Path, handler: Handler) -> AsyncIterator[None]:
    """Serve ``handler`` at ``path``, mode 0600, while the context lasts; a dead simulator's file is replaced.

    What the handler refuses with KeyError, TypeError or ValueError is answered as ``{"error": text}``.
    """

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError, ValueError):  # gone, or a line longer than the reader's limit
            while line := await reader.readline():
                writer.write(json.dumps(_answer(line, handler)).encode() + b"\n")
                await writer.drain()
        writer.close()

    _refuse_second(path)
    _remove(path)
    server = await asyncio.start_unix_server(serve, path)
    _restrict(path)
    _log.info("control_socket", path=str(path))
    try:
        yield
    finally:
        server.close()
        _remove(path)


def _refuse_second(path: Path) -> None:
    """Raise ``OSError`` when another simulator answers there."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        if path.is_socket() and probe.connect_ex(str(path)) == 0:
            raise OSError(errno.EADDRINUSE, f"another simulator runs already, see {path}")


def _remove(path: Path) -> None:
    if path.is_socket():
        path.unlink()


def _restrict(path: Path) -> None:
    path.chmod(0o600)


def _answer(line: bytes, handler: Handler) -> dict[str, Any]:
    try:
        request = json.loads(line)
        if not isinstance(request, dict):
            return {"error": "a request is a JSON object"}
        return handler(request)
    except (ValueError, TypeError, KeyError) as error:
        return {"error": str(error)}
