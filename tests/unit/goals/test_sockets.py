import os
import socket
import stat
import subprocess
import sys

import pytest

from daemon.goals.client_errors import NoDaemonError
from daemon.goals.sockets import (
    Operators,
    Peer,
    SocketInUseError,
    activated,
    client_path,
    listen,
    peer_of,
    server_path,
)


def test_order_of_the_places_of_a_daemon(tmp_path):
    named = {"FLIGHTD_SOCKET": "/n/s", "RUNTIME_DIRECTORY": "/run/flightd", "XDG_RUNTIME_DIR": "/run/user/7"}
    found = [str(server_path(tmp_path / "x", named)), str(server_path(None, named))]
    for key in ("FLIGHTD_SOCKET", "RUNTIME_DIRECTORY", "XDG_RUNTIME_DIR"):
        del named[key]
        found.append(str(server_path(None, named)))
    assert found == [
        f"{tmp_path}/x",
        "/n/s",
        "/run/flightd/flightd.sock",
        "/run/user/7/flightd.sock",
        f"/tmp/flightd-{os.getuid()}/flightd.sock",
    ]


def test_client_looks_where_a_socket_is(tmp_path, monkeypatch):
    monkeypatch.setattr("daemon.goals.sockets.SERVICE_FOLDER", tmp_path / "service")
    monkeypatch.setattr("daemon.goals.sockets.private_folder", lambda: tmp_path / "private")
    environ = {"XDG_RUNTIME_DIR": str(tmp_path / "user")}
    assert client_path(None, environ) == tmp_path / "user" / "flightd.sock"
    for folder in ("private", "user", "service"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "flightd.sock").touch()
        assert client_path(None, environ) == tmp_path / folder / "flightd.sock"
        (tmp_path / folder / "flightd.sock").unlink()
    assert str(client_path(None, environ | {"FLIGHTD_SOCKET": "/n/s"})) == "/n/s"


def test_client_does_not_choose_between_a_service_and_a_users_daemon(tmp_path, monkeypatch):
    monkeypatch.setattr("daemon.goals.sockets.SERVICE_FOLDER", tmp_path / "service")
    environ = {"XDG_RUNTIME_DIR": str(tmp_path / "user")}
    for folder in ("user", "service"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "flightd.sock").touch()
    with pytest.raises(NoDaemonError, match="say which by --socket or FLIGHTD_SOCKET"):
        client_path(None, environ)
    assert client_path(tmp_path / "named", environ) == tmp_path / "named"


async def test_socket_is_for_owner_and_group(tmp_path):
    listener = await listen(tmp_path / "s")
    assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o660
    listener.close()
    assert not (tmp_path / "s").exists()


async def test_live_socket_is_refused_with_the_pid_of_its_owner(tmp_path):
    listener = await listen(tmp_path / "s")
    with pytest.raises(SocketInUseError, match=rf"process {os.getpid()}\)"):
        await listen(tmp_path / "s")
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(tmp_path / "s"))
    listener.close()


async def test_a_socket_that_systemd_made_is_refused_by_the_services_name(tmp_path, monkeypatch):
    path = tmp_path / "s"
    first = await listen(path)
    monkeypatch.setattr("daemon.goals.sockets._is_systemd", lambda pid: pid == os.getpid())
    with pytest.raises(SocketInUseError, match=r"\Asystemd, for the service, already listens"):
        await listen(path)
    first.close()


async def test_socket_of_a_dead_daemon_is_replaced(tmp_path):
    dead = socket.socket(socket.AF_UNIX)
    dead.bind(str(tmp_path / "s"))
    dead.listen()
    dead.close()
    (await listen(tmp_path / "s")).close()


async def test_file_that_is_no_socket_is_left_alone(tmp_path):
    (tmp_path / "s").write_text("mine")
    with pytest.raises(SocketInUseError, match="not a socket"):
        await listen(tmp_path / "s")
    assert (tmp_path / "s").read_text() == "mine"


async def test_closing_leaves_a_newer_socket_alone(tmp_path):
    old = await listen(tmp_path / "s")
    (tmp_path / "s").unlink()
    new = await listen(tmp_path / "s")
    old.close()
    assert (tmp_path / "s").exists()
    new.close()


@pytest.mark.parametrize("folder", ["missing", "x" * 120])
async def test_place_that_cannot_be_is_told_in_words(tmp_path, folder):
    if folder != "missing":
        (tmp_path / folder).mkdir()
    with pytest.raises(SocketInUseError, match="choose --socket PATH"):
        await listen(tmp_path / folder / "s")


async def test_private_folder_is_private(tmp_path, monkeypatch):
    folder = tmp_path / "private"
    monkeypatch.setattr("daemon.goals.sockets.private_folder", lambda: folder)
    (await listen(folder / "s")).close()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)
    with pytest.raises(SocketInUseError, match="not a private folder"):
        await listen(folder / "s")
    folder.rmdir()
    folder.symlink_to(tmp_path)
    with pytest.raises(SocketInUseError, match="not a private folder"):
        await listen(folder / "s")


def test_peer_is_who_connected():
    ours, theirs = socket.socketpair(socket.AF_UNIX)
    with ours, theirs:
        peer = peer_of(ours)
    assert (peer.pid, peer.uid) == (os.getpid(), os.getuid())
    assert os.getegid() in peer.groups and set(os.getgroups()) <= peer.groups


def test_operators_are_root_the_daemons_own_and_those_listed(monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 500)
    monkeypatch.setattr("os.getegid", lambda: 600)
    operators = Operators(uids=frozenset({7}), gids=frozenset({8}))

    def acts(uid, *groups):
        return operators.include(Peer(1, uid, frozenset(groups)))

    assert acts(0, 0) and acts(500, 1) and acts(7, 1)
    assert acts(9, 1, 600) and acts(9, 1, 8)
    assert not acts(9, 1) and not acts(8, 7)


def test_socket_of_systemd_is_taken(tmp_path):
    script = """
import os, socket, sys
from daemon.goals.sockets import activated
passed = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
passed.bind(sys.argv[1]); passed.listen()
os.dup2(passed.fileno(), 3)
listener = activated({"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": "1"})
assert listener is not None and str(listener.path) == sys.argv[1]
listener.close()
assert os.path.exists(sys.argv[1]), "systemd keeps its path"
"""
    subprocess.run([sys.executable, "-c", script, str(tmp_path / "s")], check=True, timeout=120)


@pytest.mark.parametrize("environ", [{}, {"LISTEN_PID": "1", "LISTEN_FDS": "1"}, {"LISTEN_PID": "x"}])
def test_without_activation_nothing_is_taken(environ):
    assert activated(environ) is None
