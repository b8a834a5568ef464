"""One daemon a vehicle: whoever holds the vehicle's endpoint holds a name in the kernel, and is known by its pid.

The name is an abstract Unix socket: no file to clean up, free again the moment its process ends, the same for all users
of one network namespace.
"""

import errno
import hashlib
import socket
from pathlib import Path

from daemon.goals.sockets import peer_of

_LISTENS_HERE = ("udp", "udpin", "tcpin")


class EndpointInUseError(Exception):
    """Another process holds the vehicle; the message says which."""


def canonical(url: str) -> str:
    """What makes two of MAVSDK's URLs the same endpoint: the device, the port listened on, or the far address."""
    scheme, _, rest = url.partition("://")
    place, _, last = rest.rpartition(":")
    if scheme.startswith("serial"):
        return f"serial:{Path(place or last).resolve()}"
    if scheme in _LISTENS_HERE:
        return f"{'tcp' if scheme == 'tcpin' else 'udp'}:{last}"
    return f"{scheme}:{rest}"


def claim(url: str) -> socket.socket:
    """Hold the endpoint until the socket is closed. Raises ``EndpointInUseError`` with the pid of who has it."""
    digest = hashlib.sha256(canonical(url).encode()).hexdigest()[:32]
    name = f"\0flightd/vehicle/{digest}"
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        held.bind(name)
        held.listen(1)
    except OSError as error:
        held.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise EndpointInUseError(f"{_holder(name)} already flies the vehicle at {url}: stop it first") from None
    return held


def _holder(name: str) -> str:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        if probe.connect_ex(name) != 0:
            return "a process"
        return f"process {peer_of(probe).pid}"
