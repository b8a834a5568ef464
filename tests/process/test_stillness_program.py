"""The program that notes when a core stood still: stopping it is to it as if the core did."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.bench import stillness
from daemon.bench.c_program import compile_c
from daemon.bench.stillness import spans_of

CORE = max(os.sched_getaffinity(0))
PERIOD_S = 0.002
PARENT = "import subprocess, sys; print(subprocess.Popen(sys.argv[1:]).pid, flush=True); sys.stdin.read()"

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> str:
    made = tmp_path_factory.mktemp("program") / "stillness"
    compile_c(Path(stillness.__file__).with_suffix(".c"), made)
    return str(made)


def until(holds: Callable[[], bool]) -> float:
    """Wait with patience; the time at which it was seen to hold."""
    for _ in range(2000):
        if holds():
            return time.monotonic()
        time.sleep(0.005)
    raise AssertionError("it never came")


def state_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "gone"


def watches(pid: int) -> bool:
    return os.sched_getscheduler(pid) == os.SCHED_FIFO


def test_it_notes_from_when_until_when_it_was_stopped(program: str) -> None:
    with subprocess.Popen([program, str(CORE)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as witness:
        until(lambda: witness.poll() is not None or watches(witness.pid))
        if witness.poll() is not None:
            assert witness.stderr is not None
            assert "Operation not permitted" in witness.stderr.read()
            pytest.skip("SCHED_FIFO is not permitted here")
        assert os.sched_getaffinity(witness.pid) == {CORE}
        time.sleep(10.0 * PERIOD_S)
        witness.send_signal(signal.SIGSTOP)
        begun_s = until(lambda: state_of(witness.pid) == "T")
        time.sleep(10.0 * PERIOD_S)
        ended_s = time.monotonic()
        witness.send_signal(signal.SIGCONT)
        time.sleep(10.0 * PERIOD_S)
        witness.terminate()
        notes, _ = witness.communicate()
    assert witness.returncode == 0
    assert any(span[0] <= begun_s + PERIOD_S and ended_s <= span[1] for span in spans_of([notes]))


def test_it_ends_with_the_process_that_started_it(program: str) -> None:
    """Else it would stay, above everything else that runs."""
    command = [sys.executable, "-c", PARENT, program, str(CORE)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        until(lambda: state_of(pid) in ("gone", "Z") or watches(pid))
        if state_of(pid) in ("gone", "Z"):
            parent.kill()
            pytest.skip("SCHED_FIFO is not permitted here")
        parent.kill()
    until(lambda: state_of(pid) in ("gone", "Z"))
