"""Many clients of one process, most of them bad ones: ``python crowd.py SOCKET COUNT``.

Prints how many were answered once, goes on when told to, prints what it saw, and waits to be killed. One in five asks
and reads; the others subscribe to everything and never read, close their sending side after a request, leave a line
unfinished, or send requests and never read.
"""

import json
import socket
import sys
import threading

TOPICS = ["state", "reference", "setpoint", "goal", "plan", "health", "loops", "events"]


def request(method: str, **params: object) -> bytes:
    return json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode() + b"\n"


def main() -> None:
    path, count = sys.argv[1], int(sys.argv[2])
    clients = []
    for _ in range(count):
        client = socket.socket(socket.AF_UNIX)
        client.settimeout(60.0)
        client.connect(path)
        clients.append(client)
    for client in clients:
        client.sendall(request("system.info"))
    print(sum("result" in json.loads(client.recv(1 << 16)) for client in clients), flush=True)
    sys.stdin.readline()
    for number, client in enumerate(clients):
        match number % 5:
            case 0 | 2:
                client.sendall(request("status.get"))
            case 1:
                client.sendall(request("telemetry.subscribe", topics=TOPICS, rate_hz=50))
            case 3:
                client.sendall(request("status.get")[:-9])
            case 4:
                client.sendall(request("status.get") * 100)
        if number % 5 == 2:
            client.shutdown(socket.SHUT_WR)
    asked, ended = clients[0::5], clients[2::5]
    answered = sum(json.loads(client.makefile("rb").readline())["result"]["state"] == "ready" for client in asked)
    closed = sum(len(client.makefile("rb").readlines()) == 1 for client in ended)
    print(json.dumps([answered, closed]), flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()
