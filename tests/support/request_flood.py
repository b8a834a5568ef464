"""Offers RATE requests a second over ten connections for a time: ``python request_flood.py SOCKET RATE SECONDS``.

Prints how many it offered, how many the socket took, how many were answered.
"""

import json
import select
import socket
import sys
import time

CONNECTIONS = 10
STEP_S = 0.01
REQUESTS = (
    {"id": 1, "method": "status.get"},
    {"id": 2, "method": "goal.get", "params": {"goal_id": "nobody"}},
    {"id": 3, "method": "goal.submit", "params": {"waypoint": {"position": [0, 0, -5000]}}},
    {"id": 4, "method": "goal.fly"},
)
LINES = [json.dumps({"jsonrpc": "2.0"} | request).encode() + b"\n" for request in REQUESTS]


class Client:
    """Sends what it is given as the socket takes it; what does not fit is dropped line by line."""

    def __init__(self, path: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(path)
        self.socket.setblocking(False)
        self.left = b""
        self.taken = self.answered = 0

    def offer(self, lines: list[bytes]) -> None:
        """Send as many of the lines as fit."""
        for line in lines:
            self.left = self.left or line
            try:
                self.left = self.left[self.socket.send(self.left) :]
            except BlockingIOError:
                return
            self.taken += not self.left

    def read(self) -> None:
        """Count what was answered."""
        try:
            self.answered += self.socket.recv(1 << 16).count(b"\n")
        except BlockingIOError:
            return


def main() -> None:
    path, rate, seconds = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    clients = [Client(path) for _ in range(CONNECTIONS)]
    each = round(rate * STEP_S / CONNECTIONS)
    begin_s = time.monotonic()
    steps = int(seconds / STEP_S)
    for step in range(1, steps + 1):
        for client in clients:
            client.offer([LINES[(step + number) % len(LINES)] for number in range(each)])
        while (left_s := begin_s + step * STEP_S - time.monotonic()) > 0.0:
            readable, _, _ = select.select([client.socket for client in clients], [], [], left_s)
            for client in clients:
                if client.socket in readable:
                    client.read()
    offered = steps * each * CONNECTIONS
    print(json.dumps([offered, sum(c.taken for c in clients), sum(c.answered for c in clients)]))


if __name__ == "__main__":
    main()
