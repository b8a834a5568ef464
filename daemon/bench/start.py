"""How long `flightd run` takes from exec until it says READY=1 to systemd, with recording, in front of no autopilot."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from daemon.bench.loop import free_port

_PATIENCE_S = 60.0


def seconds_to_ready() -> float:
    """Start the daemon once, as systemd would, and stop it; ``TimeoutError`` when it never gets ready."""
    with tempfile.TemporaryDirectory() as name, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        folder = Path(name)
        systemd.bind(str(folder / "notify"))
        systemd.settimeout(_PATIENCE_S)
        connection = ["--connection", f"udpin://127.0.0.1:{free_port()}", "--socket", str(folder / "flightd.sock")]
        environment = {**os.environ, "NOTIFY_SOCKET": str(folder / "notify"), "STATE_DIRECTORY": name}
        begun_s = time.monotonic()
        daemon = subprocess.Popen(
            [sys.executable, "-m", "daemon.cli.main", "run", *connection],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            while b"READY=1" not in systemd.recv(4096).splitlines():
                pass
            return time.monotonic() - begun_s
        finally:
            daemon.terminate()
            daemon.wait()
