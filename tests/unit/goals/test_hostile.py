"""Attempts to break the socket with what a client may send."""

import asyncio
import gc
import json
import time
from contextlib import asynccontextmanager

import pytest
from fake_flight import PATIENCE_S, serving

from daemon.goals import sockets
from daemon.goals.errors import ErrorCode
from daemon.goals.protocol import MAX_BATCH, MAX_VALUES, Refusal, interpret, parse
from daemon.goals.turns import Turnstile


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


@asynccontextmanager
async def connected(path):
    reader, writer = await asyncio.open_unix_connection(str(path), limit=1 << 22)

    async def ask(line):
        writer.write(line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n")
        return json.loads(await asyncio.wait_for(reader.readline(), PATIENCE_S))

    try:
        yield reader, writer, ask
    finally:
        writer.transport.abort()


def request(method, params=None, **envelope):
    return {"jsonrpc": "2.0", "id": 1, "method": method, "params": params or {}} | envelope


@pytest.mark.parametrize("request_id", [10**4000, -(10**18), 1e308, "x" * 256, "\ud800", "\x00\n", 0, -0.0, ""])
async def test_odd_ids_come_back_as_they_were(path, request_id):
    async with serving(path), connected(path) as (_, _, ask):
        assert (await ask(request("system.info", id=request_id)))["id"] == request_id


@pytest.mark.parametrize(
    "line",
    [
        b'{"jsonrpc":"2.0","id":1,"method":"\xff\xfe"}\n',
        b'\xef\xbb\xbf{"jsonrpc":"2.0","id":1,"method":"system.info"}\n',
        b'{"jsonrpc":"2.0","id":1,"method":"system.info"}\x00\n',
        b'{"id":' + b"9" * 5000 + b"}\n",
        b"[" * 60000 + b"\n",
    ],
)
async def test_what_cannot_be_read_is_a_parse_error_and_the_connection_goes_on(path, line):
    async with serving(path), connected(path) as (_, _, ask):
        assert (await ask(line))["error"]["code"] == ErrorCode.PARSE
        assert "result" in await ask(request("system.info"))


async def test_batches_in_batches_are_refused_one_by_one(path):
    async with serving(path), connected(path) as (_, _, ask):
        replies = await ask([[], [request("system.info")], {}, None, request("system.info", id="last")])
        assert [reply.get("error", {}).get("code") for reply in replies] == [-32600] * 4 + [None]
        assert (await ask(b"[]\n"))["error"]["code"] == ErrorCode.INVALID_REQUEST
        assert (await ask([1] * (MAX_BATCH + 1)))["error"]["code"] == ErrorCode.INVALID_REQUEST
        assert len(await ask([1] * MAX_BATCH)) == MAX_BATCH


async def test_batch_of_notifications_is_not_answered(path):
    async with serving(path) as daemon, connected(path) as (_, _, ask):
        reference = {"jsonrpc": "2.0", "method": "reference.set"}
        reference["params"] = {"goal_id": "g-1", "position": [0, 0, -5], "velocity": [0, 0, 0]}
        daemon.records["g-1"] = {}
        assert (await ask(json.dumps([reference, reference]).encode() + b"\n" + json.dumps(request("system.info")).encode() + b"\n"))["id"] == 1  # fmt: skip  # noqa: E501
        while len(daemon.references) < 2:
            assert (await ask(request("system.info")))["id"] == 1


@pytest.mark.parametrize(("length", "code"), [(65536, None), (65537, ErrorCode.INVALID_REQUEST)])
async def test_line_of_64_kib_is_taken_and_one_byte_more_is_not(path, length, code):
    text = json.dumps(request("system.info")).encode()
    line = text + b" " * (length - len(text)) + b"\n"
    async with serving(path), connected(path) as (reader, writer, ask), connected(path) as (_, _, other):
        for begin in range(0, len(line), 7000):
            writer.write(line[begin : begin + 7000])
            await other(request("system.info"))  # meanwhile the piece has come
        assert json.loads(await asyncio.wait_for(reader.readline(), PATIENCE_S)).get("error", {}).get("code") == code
        if code is None:
            assert "result" in await ask(request("system.info"))
        else:
            assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""


async def test_lines_that_never_end_keep_nobody_from_asking(path):
    async with serving(path) as daemon, connected(path) as (_, _, ask):
        slow = [await asyncio.open_unix_connection(str(path)) for _ in range(50)]
        for _, writer in slow:
            writer.write(b'{"jsonrpc":"2.0"')
        assert "result" in await ask(request("system.info"))
        for _, writer in slow:
            writer.transport.abort()
        while len(daemon.server._sessions) > 1:
            await ask(request("system.info"))


WAYPOINT = {"position": [0, 0, -5]}
DEAR = {
    "empty waypoints": ("goal.submit", {"path": {"waypoints": [{}] * 20000}}),
    "good waypoints": ("goal.submit", {"path": {"waypoints": [WAYPOINT] * 2500}}),
    "unknown keys": ("telemetry.subscribe", {f"k{n}": 1 for n in range(5000)}),
    "unknown keys inside": ("goal.submit", {"path": {"waypoints": [WAYPOINT | {f"k{n}": 1 for n in range(99)}] * 50}}),
    "long lists": ("goal.submit", {"waypoint": {"position": ["a"] * 15000}}),
    "deep": ("goal.submit", json.loads('{"a":' * 500 + "1" + "}" * 500)),
}


@pytest.mark.parametrize("name", DEAR)
def test_a_line_full_of_mistakes_is_refused_without_looking_at_each(name, monkeypatch):
    looked = []
    method, params = DEAR[name]
    explain = interpret.__globals__["explained"]
    monkeypatch.setitem(interpret.__globals__, "explained", lambda *found: looked.append(1) or explain(*found))
    begin_s = time.process_time()
    found = interpret(parse(json.dumps(request(method, params)).encode())[0][0], operator=True)
    assert isinstance(found, Refusal) and found.error.code == ErrorCode.INVALID_PARAMS
    assert len(looked) <= 20
    print(f"{name}: {1e3 * (time.process_time() - begin_s):.1f} ms")


def test_largest_goal_that_may_be_is_taken():
    waypoint = WAYPOINT | {"frame": "local_ned", "yaw_deg": 1, "mode": "full_pose", "hold_s": 1}
    waypoint["convergence"] = {"position_m": 1, "angle_deg": 1, "speed_m_s": 1, "dwell_s": 1}
    message = request("goal.submit", {"path": {"waypoints": [waypoint] * 50}, "limits": {"speed_m_s": 1}})
    assert not isinstance(interpret(message, operator=True), Refusal)
    message["params"]["path"]["waypoints"].append(waypoint)
    found = interpret(message, operator=True)
    assert (found.error.code, found.error.field) == (ErrorCode.REFUSED, "path.waypoints")
    assert MAX_VALUES >= 50 * 16


async def test_goals_are_taken_in_the_order_in_which_they_came_however_long_they_are_looked_at(path):
    async with serving(path) as daemon, connected(path) as (_, writer, ask):
        submit, gate = daemon.goal_submit, asyncio.Event()

        async def slow(params, caller, goal_id):
            if params.path is not None:
                await gate.wait()
            return await submit(params, caller, goal_id)

        daemon.goal_submit = slow
        writer.write(
            json.dumps(request("goal.submit", {"path": {"waypoints": [WAYPOINT]}}, id="slow")).encode() + b"\n"
        )
        writer.write(json.dumps(request("goal.submit", {"waypoint": WAYPOINT}, id="quick")).encode() + b"\n")
        writer.write(json.dumps(request("goal.cancel", id="cancel")).encode() + b"\n")
        assert (await ask(request("vehicle.engage", id="engage")))["id"] == "engage", "nothing waits but goals"
        gate.set()
        ids = []
        while len(ids) < 3:
            message = await ask(b"")
            ids += [message["id"]] if "id" in message else []
        assert ids == ["slow", "quick", "cancel"]
        assert [record["outcome"] for record in daemon.records.values()] == ["preempted", "canceled"]


async def test_a_goal_that_waits_while_the_vehicle_is_released_is_refused(path):
    async with serving(path) as daemon, connected(path) as (_, writer, ask):
        submit, gate = daemon.goal_submit, asyncio.Event()

        async def slow(params, caller, goal_id):
            await gate.wait()
            return await submit(params, caller, goal_id)

        daemon.goal_submit = slow
        goals = [request("goal.submit", {"waypoint": WAYPOINT}, id=name) for name in ("begun", "waits")]
        writer.write(b"".join(json.dumps(goal).encode() + b"\n" for goal in goals))
        assert (await ask(request("vehicle.hold", id="hold")))["id"] == "hold"
        later = asyncio.ensure_future(ask(request("goal.submit", {"waypoint": WAYPOINT}, id="later")))
        gate.set()
        replies = [await later]
        while len(replies) < 3:
            message = await ask(b"")
            replies += [message] if "id" in message else []
        assert [reply["id"] for reply in replies] == ["begun", "waits", "later"]
        assert replies[1]["error"]["code"] == ErrorCode.WRONG_STATE
        assert "released while the goal waited" in replies[1]["error"]["message"]
        assert "result" in replies[2]


async def test_a_cancel_does_not_wait_for_the_goals_of_others(path):
    async with serving(path) as daemon, connected(path) as (_, writer, _), connected(path) as (_, _, other):
        submit, hangs, gate = daemon.goal_submit, asyncio.Event(), asyncio.Event()

        async def slow(params, caller, goal_id):
            if params.path is not None:
                hangs.set()
                await gate.wait()
            return await submit(params, caller, goal_id)

        await other(request("goal.submit", {"waypoint": WAYPOINT}))
        daemon.goal_submit = slow
        writer.write(
            json.dumps(request("goal.submit", {"path": {"waypoints": [WAYPOINT]}}, id="slow")).encode() + b"\n"
        )
        await asyncio.wait_for(hangs.wait(), PATIENCE_S)
        await other(request("goal.cancel", id="cancel"))
        assert [record["outcome"] for record in daemon.records.values()] == ["canceled"]
        gate.set()


async def test_goal_that_fails_in_the_daemon_lets_the_next_one_in(path):
    async with serving(path), connected(path) as (_, _, ask):
        assert (await ask(request("goal.submit", {"waypoint": {"position": [0, 0, -13]}})))["error"]["code"] == -32603
        assert "result" in await ask(request("goal.submit", {"waypoint": WAYPOINT}))


async def test_goals_that_pile_up_are_refused(path):
    async with serving(path) as daemon, connected(path):
        submit, gate = daemon.goal_submit, asyncio.Event()

        async def slow(params, caller, goal_id):
            await gate.wait()
            return await submit(params, caller, goal_id)

        daemon.goal_submit = slow
        line = json.dumps(request("goal.submit", {"waypoint": WAYPOINT})).encode() + b"\n"
        many = [await asyncio.open_unix_connection(str(path)) for _ in range(3)]
        for _, writer in many:
            writer.write(line * 32)
        first = asyncio.wait(
            [asyncio.ensure_future(reader.readline()) for reader, _ in many], return_when="FIRST_COMPLETED"
        )
        refused = json.loads(next(iter((await first)[0])).result())
        assert refused["error"]["code"] == ErrorCode.WRONG_STATE and "try again" in refused["error"]["message"]
        gate.set()
        for _, writer in many:
            writer.transport.abort()


async def test_batches_that_pile_up_are_refused(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.dispatch.MAX_BATCHES", 2)
    async with serving(path) as daemon, connected(path) as (_, writer, ask):
        for _ in range(2):
            writer.write(json.dumps([request("vehicle.takeoff", {"altitude_m": 99.0})]).encode() + b"\n")
        refused = await ask([request("system.info")])
        assert refused["error"]["code"] == ErrorCode.WRONG_STATE
        daemon.release.set()
        for _ in range(2):
            assert "result" in (await ask(b""))[0]
        assert "result" in (await ask([request("system.info")]))[0]
        assert "5000 values" in (await ask([{"a": [[]] * 6000}]))["error"]["message"]


ASKED = {
    "answered": request("status.get"),
    "refused": request("goal.submit", {"waypoint": {"position": [0, 0, -5000]}}),
    "invalid": request("goal.submit", {"path": {"waypoints": [{}] * 40}}),
    "unknown": request("goal.fly"),
    "not a request": {},
    "not JSON": b"[1, 2\n",
    "batch": [request("goal.get", {"goal_id": "x"}), request("goal.fly")],
}


@pytest.mark.parametrize("name", ASKED)
async def test_a_request_leaves_nothing_to_the_garbage_collector(path, name):
    """Which runs once in a while only: what a flood leaves behind would fill the memory until then."""
    async with serving(path), connected(path) as (_, _, ask):
        for _ in range(5):
            await ask(ASKED[name])
        gc.collect()
        gc.disable()
        try:
            for _ in range(50):
                await ask(ASKED[name])
            left = gc.collect()
        finally:
            gc.enable()
        assert left < 50


async def test_a_peer_that_cannot_be_asked_who_it_is_keeps_nobody_else_out(path, monkeypatch):
    calls = []

    def peer_of(sock):
        calls.append(sock)
        if len(calls) == 1:
            raise OSError("gone")
        return sockets.peer_of(sock)

    monkeypatch.setattr("daemon.goals.server.peer_of", peer_of)
    async with serving(path):
        reader, _ = await asyncio.open_unix_connection(str(path))
        assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""
        async with connected(path) as (_, _, ask):
            assert "result" in await ask(request("system.info"))


async def test_one_who_is_cancelled_as_the_way_is_free_leaves_it_to_the_next():
    turnstile = Turnstile()
    await turnstile.enter(0, 1)
    first, second = (asyncio.ensure_future(turnstile.enter(0, pid)) for pid in (2, 3))
    await asyncio.sleep(0)
    turnstile.leave()
    first.cancel()
    await asyncio.wait_for(second, PATIENCE_S)
