"""How a command ends does not depend on whether its output can be written."""

import io
import os
import signal
import subprocess
import sys

import pytest
from fake_flight import serving_in_thread

from daemon.cli import output

SHELL = f"exec {sys.executable} -m daemon.cli.main"


@pytest.fixture
def shell(path):
    def run(command, redirections, **more):
        line = f"{SHELL} {command} {redirections}"
        environment = os.environ | {"FLIGHTD_SOCKET": str(path)} | more
        return subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=120, env=environment)

    return run


@pytest.mark.parametrize("redirection", [">&-", ">/dev/full", "2>&-", "2>/dev/full", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_goal_ends_with_its_own_exit_code_when_its_output_cannot_be_written(shell, path, redirection):
    with serving_in_thread(path, auto="succeeded"):
        done = shell("goto 1 0 -5", redirection)
        refused = shell("goto 2 0 -5000", redirection)
    assert (done.returncode, refused.returncode) == (0, 2)
    assert "Traceback" not in done.stderr + refused.stderr
    told = "the output cannot be written (No space left on device)"
    assert done.stderr.count(told) == (1 if redirection == ">/dev/full" else 0)


def test_a_goal_whose_reader_went_away_ends_with_its_own_exit_code(path):
    reading, writing = os.pipe()
    os.close(reading)
    with serving_in_thread(path, auto="succeeded"):
        command = [sys.executable, "-m", "daemon.cli.main", "goto", "1", "0", "-5", "--socket", str(path)]
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=120)
    os.close(writing)
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1 and "the output cannot be written (Broken pipe)" in done.stderr


def test_watch_ends_when_nobody_can_read_it(shell, path):
    with serving_in_thread(path) as daemon:
        daemon.loop.call_soon_threadsafe(_say_often, daemon)
        for redirection in (">&-", ">/dev/full"):
            done = shell("watch", redirection)
            assert done.returncode == 130
            assert "Traceback" not in done.stderr and done.stderr.count("\n") == 1


def _say_often(daemon):
    daemon.hub.event("reset", "the heading was reset")
    daemon.loop.call_later(0.05, _say_often, daemon)


def test_a_table_is_shown_on_a_terminal_that_lacks_its_letters(monkeypatch):
    code = """
from daemon.cli import demo, demo_flight, output
output.prepare()
demo._show([demo_flight.Row("goal", "preempted", "preempted", 1.0, None, None, 0.1, 10.0)])
"""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "preempted" in done.stdout


@pytest.mark.parametrize("when", ["typer", "daemon.cli.vehicle", "asyncio"])
def test_an_interrupt_while_it_starts_is_quiet(when):
    """The interrupt comes as a module is imported."""
    code = f"""
import os, signal, sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == {when!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), {signal.SIGINT.value})
sys.meta_path.insert(0, Interrupting())
sys.argv = ["flightd", "status", "--socket", "/nowhere"]
from daemon.cli.main import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_colours_are_for_terminals_of_people_who_want_them(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert output.colours(Terminal()) and not output.colours(io.StringIO())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not output.colours(Terminal())
