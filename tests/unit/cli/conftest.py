import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE_S = 120.0
sys.path.append(str(Path(__file__).parents[1] / "goals"))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


@pytest.fixture
def flightd(path):
    """Run the command against the socket of the test; `start` gives the process instead."""
    environment = os.environ | {"FLIGHTD_SOCKET": str(path), "PYTHONPATH": str(ROOT), "COLUMNS": "100"}

    class Command:
        def start(self, *arguments, **more):
            command = [sys.executable, "-m", "daemon.cli.main", *map(str, arguments)]
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
            return subprocess.Popen(command, env=environment, **(pipes | more))

        def __call__(self, *arguments, **more):
            process = self.start(*arguments, **more)
            try:
                process.out, process.err = process.communicate(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                raise
            return process

    return Command()
