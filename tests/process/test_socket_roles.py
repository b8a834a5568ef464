"""Who is at the other end is read from the socket: a process of another user observes and gets nothing done."""

import json
import os
import socket
import sys
import tempfile
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "unit" / "goals"))

from fake_flight import serving_in_thread

NOBODY = 65534
REQUESTS = {
    "vehicle.arm": {},
    "vehicle.takeoff": {"altitude_m": 5},
    "vehicle.land": {},
    "goal.submit": {"waypoint": {"position": [1, 0, -5]}},
    "goal.cancel": {},
    "config.set": {"path": "guidance.limits.speed_m_s", "value": 1.0},
    "status.get": {},
}


def ask_all(path):
    """Codes of the replies to each request; None where it was done."""
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(60.0)
        client.connect(str(path))
        lines = client.makefile("rwb")
        codes = {}
        for method, params in REQUESTS.items():
            request = {"jsonrpc": "2.0", "id": method, "method": method, "params": params}
            lines.write(json.dumps(request).encode() + b"\n")
            lines.flush()
            while (reply := json.loads(lines.readline())).get("id") != method:
                pass
            codes[method] = reply.get("error", {}).get("code")
        return codes


def as_user(uid, path, groups=()):
    """What `ask_all` gets in a process of another user, who is in these groups besides its own."""
    receiver, sender = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            os.setgroups(groups)
            os.setgid(uid)
            os.setuid(uid)
            os.write(sender, json.dumps(ask_all(path)).encode())
        finally:
            os._exit(0)
    os.close(sender)
    with os.fdopen(receiver, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(pid, 0)
    return json.loads(answer)


@pytest.fixture
def path():
    """In a folder that every user may enter."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder) / "s"


def test_own_user_is_an_operator(path):
    with serving_in_thread(path) as daemon:
        assert set(ask_all(path).values()) == {None}
        assert [name for name, _ in daemon.calls] == ["arm", "takeoff", "land", "submit"]


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
def test_other_user_reads_and_gets_nothing_done(path):
    with serving_in_thread(path) as daemon:
        path.chmod(0o666)
        codes = as_user(NOBODY, path)
        assert codes.pop("status.get") is None
        assert set(codes.values()) == {-32003}
        assert daemon.calls == [] and daemon.setting["value"] == 5.0


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
def test_other_user_is_not_let_in_by_the_sockets_mode(path):
    with serving_in_thread(path), pytest.raises(json.JSONDecodeError):
        as_user(NOBODY, path)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can be somebody else")
@pytest.mark.parametrize("others", [0, 1, 200])
def test_member_of_the_daemons_group_is_an_operator(path, others):
    groups = [*range(5000, 5000 + others), os.getegid()]
    with serving_in_thread(path):
        assert set(as_user(NOBODY, path, groups).values()) == {None}
