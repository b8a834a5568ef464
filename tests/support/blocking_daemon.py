"""``flightd run`` that stands still on request, for tests: ``python blocking_daemon.py CONNECTION SOCKET [CONFIG]``.

SIGUSR1 blocks the event loop for $BLOCK_S seconds, SIGUSR2 holds the interpreter lock for as long.
"""

import asyncio
import ctypes
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from daemon import app

BLOCK_S = float(os.environ.get("BLOCK_S", "0"))
_run = app._main


async def _main(*arguments: Any) -> int:
    loop = asyncio.get_running_loop()
    holding = ctypes.PyDLL(None)  # unlike CDLL it keeps the interpreter lock during the call
    loop.add_signal_handler(signal.SIGUSR1, time.sleep, BLOCK_S)
    loop.add_signal_handler(signal.SIGUSR2, holding.usleep, int(BLOCK_S * 1e6))
    return await _run(*arguments)


app._main = _main

if __name__ == "__main__":
    connection, path, *files = sys.argv[1:]
    sys.exit(app.run([Path(file) for file in files], connection, Path(path)))
