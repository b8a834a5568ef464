"""Where the socket is, who may sit on it, and who is at its other end."""

import asyncio
import errno
import fcntl
import os
import socket
import stat
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from daemon.goals.client_errors import NoDaemonError

SOCKET_NAME = "flightd.sock"
SERVICE_FOLDER = Path("/run/flightd")
MODE = 0o660
BACKLOG = 1024
SD_LISTEN_FDS_START = 3
SO_PEERGROUPS = 59
GROUPS_BYTES = 1024  # Python's getsockopt takes no more
LOCK_TRIES = 20
LOCK_PAUSE_S = 0.05


class SocketInUseError(Exception):
    """The socket cannot be taken; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Peer:
    """Credentials of a process at the other end, when it connected."""

    pid: int
    uid: int
    groups: frozenset[int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Operators:
    """Who may act: root, the daemon's own user and group, and those listed."""

    uids: frozenset[int] = field(default_factory=frozenset)
    gids: frozenset[int] = field(default_factory=frozenset)

    def include(self, peer: Peer) -> bool:
        """Tell whether the peer is an operator."""
        users = self.uids | {0, os.geteuid()}
        groups = self.gids | {os.getegid()}
        return peer.uid in users or bool(groups & peer.groups)


@dataclass(frozen=True, slots=True)
class Listener:
    """A listening socket; ``inode`` is None when systemd owns the path."""

    sock: socket.socket
    path: Path
    inode: int | None

    def close(self) -> None:
        """Close, and remove the path if it still is this socket's."""
        self.sock.close()
        try:
            if self.inode is not None and self.path.lstat().st_ino == self.inode:
                self.path.unlink()
        except FileNotFoundError:
            return


def server_path(argument: Path | None, environ: Mapping[str, str]) -> Path:
    """Path for a daemon: the argument, $FLIGHTD_SOCKET, the service's folder, the user's folder, a folder in /tmp."""
    if argument is not None:
        return argument
    if named := environ.get("FLIGHTD_SOCKET"):
        return Path(named)
    if folder := environ.get("RUNTIME_DIRECTORY"):
        return Path(folder.split(":")[0]) / SOCKET_NAME
    return user_path(environ)


def user_path(environ: Mapping[str, str]) -> Path:
    """Path of a daemon that a user started."""
    if folder := environ.get("XDG_RUNTIME_DIR"):
        return Path(folder) / SOCKET_NAME
    return private_folder() / SOCKET_NAME


def private_folder() -> Path:
    """Folder of this user in /tmp."""
    return Path(f"/tmp/flightd-{os.getuid()}")


def client_path(argument: Path | None, environ: Mapping[str, str]) -> Path:
    """Path for a client: as named, else the place where a socket is, else where a user's daemon would be.

    Raises `NoDaemonError` when there is more than one: a simulator's daemon must not be taken for the vehicle's.
    """
    if argument is not None:
        return argument
    if named := environ.get("FLIGHTD_SOCKET"):
        return Path(named)
    places = [SERVICE_FOLDER / SOCKET_NAME, user_path(environ), private_folder() / SOCKET_NAME]
    found = [place for place in dict.fromkeys(places) if place.exists()]
    if len(found) > 1:
        listed = " and ".join(map(str, found))
        raise NoDaemonError(f"there are sockets at {listed}: say which by --socket or FLIGHTD_SOCKET")
    return found[0] if found else places[1]


def activated(environ: Mapping[str, str]) -> Listener | None:
    """Listener that systemd passed (sd_listen_fds(3)), or None.

    Raises `SocketInUseError` when what it passed is not a Unix stream socket.
    """
    if environ.get("LISTEN_PID") != str(os.getpid()) or not environ.get("LISTEN_FDS", "0").isdecimal():
        return None
    if int(environ["LISTEN_FDS"]) < 1:
        return None
    os.set_inheritable(SD_LISTEN_FDS_START, False)
    sock = socket.socket(fileno=SD_LISTEN_FDS_START)
    if sock.family != socket.AF_UNIX or sock.type != socket.SOCK_STREAM:
        raise SocketInUseError("the socket unit passed something else than a Unix stream socket")
    sock.setblocking(False)
    return Listener(sock, Path(sock.getsockname()), None)


async def listen(path: Path) -> Listener:
    """Listen at ``path``, mode 0660; a dead daemon's socket is removed, a live one's never.

    Raises `SocketInUseError` with the way out in words.
    """
    try:
        _make_folder(path.parent)
        for _ in range(LOCK_TRIES):
            with _locked(path.parent) as locked:
                if locked:
                    return _bind(path)
            await asyncio.sleep(LOCK_PAUSE_S)
    except OSError as error:
        raise SocketInUseError(f"cannot listen at {path}: {error.strerror or error}; choose --socket PATH") from None
    raise SocketInUseError(f"cannot listen at {path}: somebody holds a lock on its folder; choose --socket PATH")


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Between looking for a live daemon and listening nobody else may do the same."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
    finally:
        os.close(descriptor)


def _make_folder(folder: Path) -> None:
    if folder != private_folder():
        return
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise SocketInUseError(f"{folder} is not a private folder of yours: remove it, or choose --socket PATH")


def _bind(path: Path) -> Listener:
    _remove_dead(path)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        sock.bind(str(path))
        path.chmod(MODE)
        sock.listen(BACKLOG)
    except OSError:
        sock.close()
        raise
    return Listener(sock, path, path.lstat().st_ino)


def _remove_dead(path: Path) -> None:
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise SocketInUseError(f"{path} is not a socket: remove it, or choose --socket PATH")
    except FileNotFoundError:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        result = probe.connect_ex(str(path))
        if result == errno.ECONNREFUSED:
            path.unlink()
            return
        owner = f"a daemon (process {peer_of(probe).pid})" if result == 0 else "a daemon"
        if result == 0 and _is_systemd(peer_of(probe).pid):
            owner = "systemd, for the service,"
    if result in (0, errno.EAGAIN):
        raise SocketInUseError(f"{owner} already listens at {path}: stop it, or choose --socket PATH")
    if result != errno.ENOENT:
        raise OSError(result, os.strerror(result))


def _is_systemd(pid: int) -> bool:
    """Tell whether that process is the manager, which made the socket of an activated service."""
    try:
        return Path(f"/proc/{pid}/comm").read_text() == "systemd\n"
    except OSError:
        return False


def peer_of(sock: socket.socket) -> Peer:
    """Credentials of the process at the other end (SO_PEERCRED and SO_PEERGROUPS, unix(7))."""
    pid, uid, gid = struct.unpack("3i", sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    groups = {gid}
    try:
        raw = sock.getsockopt(socket.SOL_SOCKET, SO_PEERGROUPS, GROUPS_BYTES)
        groups.update(group for (group,) in struct.iter_unpack("I", raw[: len(raw) // 4 * 4]))
    except OSError:
        groups = {gid}  # a kernel before 4.13, or more than 256 groups: the first group alone counts
    return Peer(pid, uid, frozenset(groups))
