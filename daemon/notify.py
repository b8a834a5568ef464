"""systemd's notification protocol (sd_notify): one datagram to the socket that $NOTIFY_SOCKET names."""

import os
import socket
from functools import cache

SEND_S = 0.02  # two ticks: a systemd that does not read must not stand still with us


def notify(message: str) -> bool:
    """Send ``READY=1``, ``WATCHDOG=1``, ``STATUS=...`` or ``STOPPING=1``; False when nobody listens, or not in time."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]
    try:
        _channel().sendto(message.encode(), address)
    except OSError:
        return False
    return True


@cache
def _channel() -> socket.socket:
    """One from the start on: a process that may open nothing more in flight still feeds its watchdog."""
    channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    channel.settimeout(SEND_S)
    return channel
