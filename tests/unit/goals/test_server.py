import asyncio
import json
import resource
import select
import socket
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import count

import pytest
from fake_flight import PATIENCE_S, serving

from daemon.goals import server as server_module
from daemon.goals import session as session_module
from daemon.goals.server import BUFFER_BYTES, KEPT_FOR_OPERATORS, most_clients
from daemon.goals.sockets import Peer


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


class Raw:
    """A client that sends bytes and reads lines."""

    def __init__(self, reader, writer):
        self.reader, self.writer = reader, writer

    def send(self, *messages):
        for message in messages:
            self.writer.write((message if isinstance(message, bytes) else json.dumps(message).encode()) + b"\n")

    async def line(self):
        return json.loads(await asyncio.wait_for(self.reader.readline(), PATIENCE_S))

    async def ask(self, method, params=None, request_id=1):
        self.send(request(method, params, request_id))
        while (message := await self.line()).get("id") != request_id:
            pass
        return message


def request(method, params=None, request_id=1):
    return {"jsonrpc": "2.0", "id": request_id, "method": method, "params": params or {}}


def goal(north=1.0, request_id=1):
    return request("goal.submit", {"waypoint": {"position": [north, 0, -5]}}, request_id)


@asynccontextmanager
async def raw(path):
    reader, writer = await asyncio.open_unix_connection(str(path), limit=1 << 22)
    try:
        yield Raw(reader, writer)
    finally:
        writer.close()


async def settle(client):
    """Everything that was sent before is done."""
    await client.ask("system.info", request_id="settled")


async def test_reply_precedes_the_goals_notifications_even_when_it_ends_at_once(path):
    async with serving(path, auto="instant"), raw(path) as client:
        client.send(goal())
        reply, result = await client.line(), await client.line()
        assert reply["result"] == {"goal_id": "g-1", "preempted": None}
        assert (result["method"], result["params"]["goal_id"]) == ("goal.result", "g-1")


async def test_batch_is_answered_in_one_line_before_its_goals_notifications(path):
    async with serving(path, auto="instant"), raw(path) as client:
        client.send([goal(request_id="a"), 7, request("status.got", request_id="b"), goal(2, request_id="c")])
        replies = await client.line()
        assert [reply.get("id") for reply in replies] == ["a", None, "b", "c"]
        assert [reply.get("error", {}).get("code") for reply in replies] == [None, -32600, -32601, None]
        assert [(await client.line())["params"]["goal_id"] for _ in range(2)] == ["g-1", "g-2"]


async def test_each_of_many_goals_gets_exactly_one_result(path):
    count = 300
    async with serving(path) as daemon, raw(path) as client:
        client.send(*(goal(n, n) for n in range(count)))
        replies, results = {}, {}
        while len(results) < count - 1 or len(replies) < count:
            message = await client.line()
            if "id" in message:
                replies[message["result"]["goal_id"]] = message
            else:
                record = message["params"]
                assert record["goal_id"] in replies and record["goal_id"] not in results
                results[record["goal_id"]] = record
        daemon.end(daemon.active)
        last = await client.line()
        assert last["params"]["goal_id"] not in results and last["params"]["outcome"] == "succeeded"
        await settle(client)
        assert all(record["outcome"] == "preempted" for record in results.values())


async def test_submitter_who_also_subscribes_hears_each_result_once(path):
    async with serving(path) as daemon, raw(path) as client, raw(path) as other:
        for subscriber in (client, other):
            await subscriber.ask("telemetry.subscribe", {"topics": ["goal"]})
        submitted = await client.ask("goal.submit", {"waypoint": {"position": [1, 0, -5]}})
        daemon.end(submitted["result"]["goal_id"])
        for subscriber in (client, other):
            subscriber.send(request("system.info", request_id="end"))
            heard = []
            while (message := await subscriber.line()).get("id") != "end":
                heard.append(message["method"])
            heard += [(await asyncio.wait_for(subscriber.line(), PATIENCE_S))["method"]] if not heard else []
            assert heard == ["goal.result"]


async def test_goal_goes_on_when_its_client_leaves(path):
    async with serving(path) as daemon:
        async with raw(path) as client:
            await client.ask("goal.submit", {"waypoint": {"position": [1, 0, -5]}})
        async with raw(path) as other:
            found = await other.ask("goal.get", {"goal_id": "g-1"})
            assert found["result"]["state"] == "active"
            assert not daemon.hub._goals
            daemon.end("g-1")
            assert (await other.ask("goal.get", {"goal_id": "g-1"}))["result"]["outcome"] == "succeeded"


async def test_pending_request_does_not_hold_up_the_next(path):
    async with serving(path) as daemon, raw(path) as client:
        client.send(request("vehicle.takeoff", {"altitude_m": 99.0}, "slow"))
        assert "result" in await client.ask("vehicle.hold", request_id="quick")
        daemon.release.set()
        assert (await client.line())["id"] == "slow"


async def test_mistake_inside_the_daemon_is_an_internal_error_and_nothing_more(path):
    async with serving(path), raw(path) as client:
        found = await client.ask("goal.submit", {"waypoint": {"position": [0, 0, -13]}})
        assert found["error"]["code"] == -32603
        assert "result" in await client.ask("status.get")


@pytest.mark.parametrize(
    ("params", "goal_id", "error"),
    [
        ({"goal_id": "g-7", "position": [0, 0, 0], "velocity": [0, 0, 0]}, "g-7", -32006),
        ({"goal_id": "g-7", "position": [0, 0]}, "g-7", -32602),
        ({"goal_id": 7}, None, -32602),
        ([], None, -32602),
    ],
)
async def test_event_of_a_refused_notification_has_the_code_of_the_error_and_the_goal(path, params, goal_id, error):
    async with serving(path), raw(path) as client:
        client.send({"jsonrpc": "2.0", "method": "reference.set", "params": params})
        event = await client.line()
        assert (event["params"]["goal_id"], event["params"]["error"]) == (goal_id, error)


async def test_refused_notification_comes_back_as_an_event(path):
    async with serving(path), raw(path) as client:
        client.send({"jsonrpc": "2.0", "method": "reference.set", "params": {"goal_id": "x"}})
        event = await client.line()
        assert event["method"] == "telemetry.events"
        assert (event["params"]["code"], event["params"]["field"]) == ("refused", "position")
        pose = {"position": [0, 0, 0], "orientation": [1, 0, 0, 0]}
        client.send({"jsonrpc": "2.0", "method": "estimator.pose", "params": pose})
        assert "not configured" in (await client.line())["params"]["text"]


async def test_not_json_is_answered_and_the_connection_goes_on(path):
    async with serving(path), raw(path) as client:
        client.send(b"{", b"", b"  ", b'{"x":NaN}', b"\xff")
        assert [(await client.line())["error"]["code"] for _ in range(3)] == [-32700] * 3
        assert "result" in await client.ask("system.info")


async def test_line_that_is_too_long_is_answered_and_ends_the_connection(path):
    async with serving(path), raw(path) as client:
        client.writer.write(b"x" * 70000)
        assert (await client.line())["error"]["code"] == -32600
        assert await client.reader.read() == b""


@pytest.mark.parametrize("notices", ["before it replies", "as the reply fails"])
@pytest.mark.parametrize("many", [1, 300])
async def test_all_that_a_client_sent_before_it_closed_is_done(path, monkeypatch, many, notices):
    """More than one reading of the buffer, too; and when the client closes just as the daemon writes to it."""
    monkeypatch.setattr(session_module, "LEFT_S", 60.0)
    if notices == "as the reply fails":
        monkeypatch.setattr(session_module.Session, "_peer_closed", lambda session: session._hung_up)
    lines = [request("system.info")] * many + [request("vehicle.hold"), request("vehicle.land")]
    async with serving(path) as daemon:
        client = socket.socket(socket.AF_UNIX)
        client.connect(str(path))
        client.sendall(b"".join(json.dumps(line).encode() + b"\n" for line in lines))
        client.close()
        async with raw(path) as other, asyncio.timeout(PATIENCE_S):
            while [name for name, _ in daemon.calls] != ["hold", "land"] or len(daemon.server._sessions) > 1:
                await settle(other)


async def test_what_a_subscriber_that_does_not_read_sent_before_it_closed_is_done(path, monkeypatch):
    monkeypatch.setattr(session_module, "LEFT_S", 60.0)
    async with serving(path) as daemon, raw(path) as other:
        client = socket.socket(socket.AF_UNIX)
        client.connect(str(path))
        client.sendall(json.dumps(request("telemetry.subscribe", {"topics": ["goal"]})).encode() + b"\n")
        await other.ask("goal.submit", {"waypoint": {"position": [1, 0, -5]}})
        for _ in range(3000):
            daemon.feedback("g-1")
        client.sendall(b"".join(json.dumps(request(f"vehicle.{name}")).encode() + b"\n" for name in ("hold", "land")))
        client.close()
        async with asyncio.timeout(PATIENCE_S):
            while [name for name, _ in daemon.calls] != ["submit", "hold", "land"]:
                await settle(other)


@pytest.mark.parametrize("after_s", [-1.0, 60.0])
async def test_what_a_client_that_is_gone_has_left_grows_stale(path, monkeypatch, after_s):
    monkeypatch.setattr(session_module, "LEFT_S", after_s)
    async with serving(path) as daemon, raw(path) as other:
        client = socket.socket(socket.AF_UNIX)
        client.connect(str(path))
        await settle(other)
        (gone,) = (session for session in daemon.server._sessions if session.caller.connection == 2)
        monkeypatch.setattr(gone, "in_flight", session_module.MAX_IN_FLIGHT)
        client.sendall(json.dumps(request("vehicle.hold")).encode() + b"\n")
        client.close()
        await settle(other)
        gone.check()
        gone.in_flight = 0
        daemon.server.ready(gone)
        async with asyncio.timeout(PATIENCE_S):
            while len(daemon.server._sessions) > 1:
                await settle(other)
        assert [name for name, _ in daemon.calls] == (["hold"] if after_s > 0.0 else [])


async def test_half_closed_client_gets_its_replies_and_then_the_end(path):
    async with serving(path), raw(path) as client:
        client.writer.write(json.dumps(request("status.get")).encode())
        client.writer.write_eof()
        assert (await client.line())["result"]["state"] == "ready"
        assert await asyncio.wait_for(client.reader.read(), PATIENCE_S) == b""


async def test_subscriber_gets_topics_at_its_rate(path):
    async with serving(path) as daemon, raw(path) as client:
        found = await client.ask("telemetry.subscribe", {"topics": ["loops", "events"], "rate_hz": 1.0})
        assert found["result"] == {"topics": ["loops", "events"], "rate_hz": 1.0}
        for number in range(5):
            daemon.hub.publish("loops", {"number": number})
            daemon.hub.event("tick", str(number))
        client.send(request("telemetry.unsubscribe", {"topics": ["loops"]}, "end"))
        heard = [await client.line() for _ in range(7)]
        assert [m["params"]["number"] for m in heard if m.get("method") == "telemetry.loops"] == [0]
        assert [m["params"]["text"] for m in heard if m.get("method") == "telemetry.events"] == list("01234")
        assert [m["result"]["topics"] for m in heard if m.get("id") == "end"] == [["events"]]
        assert not daemon.hub.wants("loops")


async def test_client_that_does_not_read_loses_feedback_first_and_is_then_cut_off(path, monkeypatch):
    monkeypatch.setattr(session_module, "PATIENCE_S", -1.0)
    async with serving(path) as daemon, raw(path) as client:
        deaf = socket.socket(socket.AF_UNIX)
        deaf.setblocking(False)
        deaf.connect(str(path))
        deaf.send(json.dumps(goal()).encode() + b"\n")
        while daemon.active is None:
            await settle(client)
        session = next(s for s in daemon.server._sessions if daemon.hub.owns_goal(s))
        while session.lost < 100:
            daemon.feedback("g-1")
        assert session._transport.get_write_buffer_size() < 2 * session_module.SOFT_LIMIT_BYTES
        assert session in daemon.server._sessions
        await settle(client)
        session.check()
        await settle(client)
        assert session not in daemon.server._sessions
        assert daemon.active == "g-1"
        deaf.close()


async def test_client_that_floods_and_does_not_read_is_not_read_either(path):
    async with serving(path) as daemon, raw(path) as client:
        deaf = socket.socket(socket.AF_UNIX)
        deaf.setblocking(False)
        deaf.connect(str(path))
        line = json.dumps(request("status.get")).encode() + b"\n"
        sent = 0
        while sent < 20000:
            try:
                deaf.send(line)
                sent += 1
            except BlockingIOError:
                await settle(client)
                if any(s._stuck_since_s is not None for s in daemon.server._sessions):
                    break
        assert sent < 20000
        stuck = next(s for s in daemon.server._sessions if s._stuck_since_s is not None)
        for _ in range(100):
            await settle(client)
        assert stuck._transport.get_write_buffer_size() < 1.5 * session_module.SOFT_LIMIT_BYTES
        assert len(stuck._lines._buffer) <= 2 * BUFFER_BYTES
        deaf.close()


async def test_flood_leaves_the_loop_its_turns(path):
    """No pass of the loop does more than a line, or two when it was late."""
    async with serving(path) as daemon, raw(path) as client:
        passes, seen = [], 0

        def count():
            nonlocal seen
            done = len(daemon.calls)
            passes.append(done - seen)
            seen = done
            if done < 500:
                asyncio.get_running_loop().call_soon(count)

        count()
        client.send(*(request("vehicle.arm", None, n) for n in range(500)))
        for _ in range(500):
            await client.line()
        assert max(passes) <= 2


async def test_batches_of_many_clients_do_no_more_a_pass_than_one(path):
    async with serving(path) as daemon, raw(path) as first, raw(path) as second, raw(path) as third:
        most, seen = 0, 0

        def look():
            nonlocal most, seen
            most, seen = max(most, len(daemon.calls) - seen), len(daemon.calls)
            if seen < 300:
                asyncio.get_running_loop().call_soon(look)

        look()
        for client in (first, second, third):
            client.send([request("vehicle.arm", None, n) for n in range(100)])
        for client in (first, second, third):
            assert len(await client.line()) == 100
        assert most <= 2


async def test_clients_take_turns(path):
    """One that asks once is answered long before the thousand requests of one that came first."""
    async with serving(path) as daemon, raw(path) as flooder, raw(path) as modest:
        flooder.send(*(request("vehicle.arm", None, n) for n in range(1000)))
        await flooder.writer.drain()
        await modest.ask("status.get")
        assert len(daemon.calls) < 500


async def test_other_process_is_not_kept_waiting_by_one_that_floods_over_many_connections(path):
    async with serving(path) as daemon, raw(path) as modest:
        await settle(modest)
        session = next(iter(daemon.server._sessions))
        session.caller = replace(session.caller, pid=1)  # as if it were another process
        flooders = [await asyncio.open_unix_connection(str(path)) for _ in range(50)]
        for _, writer in flooders:
            writer.writelines(json.dumps(request("vehicle.arm")).encode() + b"\n" for _ in range(20))
        for _ in range(10):
            before = len(daemon.calls)
            await modest.ask("status.get")
            assert len(daemon.calls) - before <= 10, "a turn in two is the other process's"
        assert 0 < len(daemon.calls) < 1000
        for _, writer in flooders:
            writer.transport.abort()


async def test_who_comes_to_a_flood_by_many_processes_is_answered_at_once(path, monkeypatch):
    pids = count(1)
    monkeypatch.setattr(server_module, "peer_of", lambda _sock: Peer(next(pids), 0, frozenset()))
    async with serving(path) as daemon:
        flooders = [await asyncio.open_unix_connection(str(path)) for _ in range(50)]
        for _, writer in flooders:
            writer.writelines(json.dumps(request("vehicle.arm")).encode() + b"\n" for _ in range(50))
        for _ in range(3):  # the flood is long under way
            await flooders[-1][0].readline()
        before = len(daemon.calls)
        async with raw(path) as modest:
            await modest.ask("status.get")
        assert len(daemon.calls) - before < 25, "not each of the fifty had a turn"
        assert len(daemon.calls) < 2500
        for _, writer in flooders:
            writer.transport.abort()


async def test_bytes_that_make_no_line_wait_in_the_clients_socket(path):
    async with serving(path) as daemon, raw(path) as trickler, raw(path) as modest:
        await settle(trickler)
        reads = []
        session = min(daemon.server._sessions, key=lambda session: session.caller.connection)
        session._lines.feed = lambda data: reads.append(len(data))
        for _ in range(200):
            trickler.writer.write(b" ")
            await asyncio.sleep(0)
        for _ in range(5):
            await settle(modest)
        assert 0 < len(reads) < 100, "one read a turn"


async def test_client_beyond_the_limit_is_told_so(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.server.MAX_CLIENTS", 1)
    async with serving(path), raw(path) as first:
        await settle(first)
        async with raw(path) as second:
            told = (await second.line())["error"]
            assert told["code"] == -32002
            assert told["message"] == "too many connections: 1 are open already; close some and try again"
            assert await second.reader.read() == b""
        await settle(first)


async def test_who_is_turned_away_may_still_write_and_read_why_and_takes_no_place(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.server.MAX_CLIENTS", 2)
    loop = asyncio.get_running_loop()
    async with serving(path) as daemon, raw(path) as first:
        async with raw(path) as second:
            await settle(second)
            with socket.socket(socket.AF_UNIX) as client:
                client.connect(str(path))
                await loop.run_in_executor(None, select.select, [client], [], [], 10.0)
                await settle(first)
                client.sendall(json.dumps(request("status.get")).encode() + b"\n")
                assert b"too many connections" in client.recv(1 << 16)
                assert client.recv(1 << 16) == b""
                assert len(daemon.server._sessions) == 2
        while len(daemon.server._sessions) > 1:
            await settle(first)
        async with raw(path) as third:
            await settle(third)


async def test_last_connections_are_kept_for_operators(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.server.MAX_CLIENTS", KEPT_FOR_OPERATORS + 1)
    async with serving(path, observers=True), raw(path) as first, raw(path) as second:
        await settle(first)
        assert "too many connections" in (await second.line())["error"]["message"]


def test_daemon_keeps_descriptors_for_itself():
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    found = []
    for soft in (256, 1024, min(4096, limits[1])):
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, limits[1]))
        found.append(most_clients())
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert found == [128, 896, 1000]


async def test_stop_ends_what_waits_and_removes_the_socket(path):
    async with serving(path), raw(path) as client:
        client.send(request("vehicle.takeoff", {"altitude_m": 99.0}))
        await settle(client)
    assert not path.exists()
    assert await client.reader.read() == b""
