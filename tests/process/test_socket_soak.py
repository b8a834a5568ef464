"""Hostile clients against the real socket: short here, long with FLIGHTD_SOAK=100 (`make soak`).

The figures are printed (`pytest -s`); what depends on the machine's speed is not asserted.
"""

import asyncio
import gc
import json
import os
import random
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "unit" / "goals"))

from fake_flight import serving

SOAK = int(os.environ.get("FLIGHTD_SOAK", "1"))
MESSAGES = 2000 * SOAK
GOALS = 100 * SOAK
CLIENTS = 500
CROWDS = 1 if SOAK < 10 else 20
SUPPORT = Path(__file__).parents[1] / "support"
METHODS = ["status.get", "goal.submit", "goal.update", "telemetry.subscribe", "config.set", "vehicle.arm", "goal.fly"]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


def a_value(rng, depth=0):
    kind = rng.randrange(12)
    if kind == 0 and depth < 4:
        return [a_value(rng, depth + 1) for _ in range(rng.randrange(5))]
    if kind == 1 and depth < 4:
        return {a_word(rng): a_value(rng, depth + 1) for _ in range(rng.randrange(5))}
    simple = [None, True, -1, 10**30, 10**400, 1e308, "\ud800", "\x00", "", "\N{SNOWMAN}" * 20, 0.5, [0, 0, -5]]
    return simple[kind]


def a_word(rng):
    return rng.choice(["waypoint", "position", "frame", "goal_id", "topics", "path", "value", "x", "\N{SNOWMAN}", "id"])


def a_message(rng):
    method = rng.choice(METHODS) if rng.random() < 0.9 else a_value(rng)
    message = {"jsonrpc": "2.0", "id": rng.choice([1, "a", a_value(rng)]), "method": method}
    message["params"] = {a_word(rng): a_value(rng) for _ in range(rng.randrange(4))}
    if rng.random() < 0.2:
        message["params"] = a_value(rng)
    if rng.random() < 0.2:
        del message[rng.choice(list(message))]
    return message


def a_line(rng):
    text = json.dumps(a_message(rng)).encode()
    match rng.randrange(10):
        case 0:
            return rng.randbytes(rng.randrange(200)).replace(b"\n", b"")
        case 1:
            return text[: rng.randrange(len(text))]
        case 2:
            return b"[" * rng.randrange(3000) + text
        case 3:
            return json.dumps([a_message(rng) for _ in range(rng.randrange(6))]).encode()
        case 4:
            return text.replace(b"1", b"1e999").replace(b"null", b"NaN")
        case 5 if rng.random() < 0.05:
            return b"x" * 70000
    return text


def descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def resident_kb():
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


async def answers(reader):
    """How many lines come until the end, or until the one that was sent last is answered."""
    count = 0
    while line := await reader.readline():
        message = json.loads(line)
        if isinstance(message, dict) and message.get("id") == "end":
            break
        count += 1
    return count


async def hostile(path, rng, messages):
    """Connections that each send some lines; half of them wait for the answers, the others are gone at once."""
    sent = answered = 0
    while sent < messages:
        reader, writer = await asyncio.open_unix_connection(str(path), limit=1 << 22)
        reading = asyncio.ensure_future(answers(reader))
        try:
            for _ in range(rng.randrange(1, 200)):
                writer.write(a_line(rng) + b"\n")
                sent += 1
                await writer.drain()
            if rng.random() < 0.5:
                writer.write(b'{"jsonrpc":"2.0","id":"end","method":"system.info"}\n')
                writer.write_eof()
                answered += await asyncio.wait_for(reading, 120.0)
        except ConnectionError:  # cut off for a line that was too long
            pass
        reading.cancel()
        await asyncio.wait({reading})
        writer.transport.abort()
    return sent, answered


async def test_hostile_lines_leave_the_daemon_as_it_was(path):
    rng = random.Random(7)
    async with serving(path, auto="instant") as daemon:
        await hostile(path, rng, 500)
        before = (descriptors(), resident_kb())
        sent, answered = await hostile(path, rng, MESSAGES)
        reader, writer = await asyncio.open_unix_connection(str(path))
        while len(daemon.server._sessions) > 1:
            writer.write(b'{"jsonrpc":"2.0","id":1,"method":"status.get"}\n')
            assert json.loads(await reader.readline())["result"]["state"] == "ready"
        daemon.calls.clear()
        daemon.records.clear()
        after = (descriptors() - 2, resident_kb())
        assert daemon.hub._goals == {} and not any(daemon.hub._gates.values())
        writer.close()
    print(f"\n{sent} hostile lines, at least {answered} answers; descriptors {before[0]} -> {after[0]}, ", end="")
    print(f"resident {before[1]} -> {after[1]} kB")
    assert after[0] <= before[0]


async def telemetry(hub):
    """What the daemon publishes, a hundred times a second if it is wanted."""
    payload = {"position_ned_m": [1.0, 2.0, -3.0], "velocity_ned_m_s": [0.0, 0.0, 0.0]}
    while True:
        for topic in ("state", "reference", "setpoint", "health", "loops"):
            if hub.wants(topic):
                hub.publish(topic, payload)
        await asyncio.sleep(0.01)


async def crowd(path, daemon):
    """500 clients of one process come, most of them bad ones, and it is killed; another process is served meanwhile."""
    pipes = {"stdin": asyncio.subprocess.PIPE, "stdout": asyncio.subprocess.PIPE}
    command = [str(SUPPORT / "crowd.py"), str(path), str(CLIENTS)]
    process = await asyncio.create_subprocess_exec(sys.executable, *command, **pipes)
    assert int(await process.stdout.readline()) == len(daemon.server._sessions) == CLIENTS
    process.stdin.write(b"\n")
    assert json.loads(await process.stdout.readline()) == [CLIENTS // 5, CLIENTS // 5]
    reader, writer = await asyncio.open_unix_connection(str(path))
    process.kill()
    await process.wait()
    while len(daemon.server._sessions) > 1:
        writer.write(b'{"jsonrpc":"2.0","id":1,"method":"status.get"}\n')
        assert json.loads(await reader.readline())["result"]["state"] == "ready"
    writer.close()


async def test_500_clients_that_do_not_read_close_halfway_and_are_killed_leave_nothing_behind(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.session.PATIENCE_S", 0.5)
    async with serving(path) as daemon:
        publishing = asyncio.ensure_future(telemetry(daemon.hub))
        await crowd(path, daemon)
        before = (descriptors(), resident_kb())
        begin_s = asyncio.get_running_loop().time()
        for _ in range(CROWDS):
            await crowd(path, daemon)
        elapsed_s = asyncio.get_running_loop().time() - begin_s
        publishing.cancel()
        await asyncio.wait({publishing})
        after = (descriptors(), resident_kb())
        assert not any(daemon.hub._gates.values())
    print(f"\n{CROWDS} times {CLIENTS} clients in {elapsed_s:.1f} s; ", end="")
    print(f"descriptors {before[0]} -> {after[0]}, resident {before[1]} -> {after[1]} kB")
    assert after[0] <= before[0]
    assert after[1] < before[1] + 8192


async def test_goals_as_fast_as_the_socket_takes_them_each_get_one_result(path):
    async with serving(path) as daemon:
        reader, writer = await asyncio.open_unix_connection(str(path))
        begin_s = asyncio.get_running_loop().time()
        results: dict[str, int] = {}

        async def read():
            while len(results) < GOALS - 1:
                message = json.loads(await reader.readline())
                if message.get("method") == "goal.result":
                    goal_id = message["params"]["goal_id"]
                    results[goal_id] = results.get(goal_id, 0) + 1

        reading = asyncio.ensure_future(read())
        for number in range(GOALS):
            goal = {"waypoint": {"position": [number % 50, 0, -5]}}
            request = {"jsonrpc": "2.0", "id": number, "method": "goal.submit", "params": goal}
            writer.write(json.dumps(request).encode() + b"\n")
            await writer.drain()
        await reading
        writer.close()
        assert len(daemon.records) == GOALS and set(results.values()) == {1}
        elapsed_s = asyncio.get_running_loop().time() - begin_s
    print(f"\n{GOALS} goals in {elapsed_s:.2f} s, each with one result")
