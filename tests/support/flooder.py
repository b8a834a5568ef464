"""A client that asks as fast as it can, and reads: ``python flooder.py SOCKET``; until it is killed."""

import select
import socket
import sys

LINE = b'{"jsonrpc": "2.0", "id": 1, "method": "status.get"}\n' * 50

with socket.socket(socket.AF_UNIX) as client:
    client.connect(sys.argv[1])
    client.setblocking(False)
    rest = b""
    while True:
        readable, writable, _ = select.select([client], [client], [])
        if readable and not client.recv(1 << 16):
            break
        if writable:
            rest = rest or LINE
            rest = rest[client.send(rest) :]
