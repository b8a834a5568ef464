"""systemd's notification protocol (sd_notify): one datagram to the socket that $NOTIFY_SOCKET names."""

import os
import socket

SEND_S = 0.02  # two ticks: a systemd that does not read must not stand still with us


def notify(message: str) -> bool:
    """Send ``READY=1``, ``WATCHDOG=1``, ``STATUS=...`` or ``STOPPING=1``; False when nobody listens, or not in time."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as channel:
            channel.settimeout(SEND_S)
            channel.connect(address)
            channel.sendall(message.encode())
    except OSError:
        return False
    return True


def watchdog_period_s() -> float | None:
    """How often systemd wants to hear from this process, or None when it does not watch."""
    microseconds = os.environ.get("WATCHDOG_USEC")
    pid = os.environ.get("WATCHDOG_PID")
    if not microseconds or (pid and pid != str(os.getpid())):
        return None
    return int(microseconds) / 1e6
