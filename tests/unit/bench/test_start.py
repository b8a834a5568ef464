"""The time to READY: of a daemon that says it as systemd wants to hear it."""

import sys
from pathlib import Path

import pytest

from daemon.bench import start


def stand_in(path: Path, says: str) -> str:
    """An interpreter that sends datagrams to $NOTIFY_SOCKET instead of running the daemon."""
    path.write_text(
        f"#!{sys.executable}\n"
        "import os, socket, time\n"
        "to = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\n"
        "to.connect(os.environ['NOTIFY_SOCKET'])\n"
        f"{says}\n"
        "time.sleep(60.0)\n"
    )
    path.chmod(0o755)
    return str(path)


def test_the_time_is_up_to_ready_not_to_what_is_said_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    says = "to.send(b'STATUS=NOT READY=1 yet'); time.sleep(0.3); to.send(b'READY=1\\nSTATUS=waiting')"
    monkeypatch.setattr(sys, "executable", stand_in(tmp_path / "python", says))
    assert start.seconds_to_ready() > 0.3


def test_a_daemon_that_never_gets_ready_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "_PATIENCE_S", 0.2)
    monkeypatch.setattr(sys, "executable", stand_in(tmp_path / "python", "to.send(b'STATUS=starting')"))
    with pytest.raises(TimeoutError):
        start.seconds_to_ready()
