"""What waited in the sockets while the daemon stood still: nothing of it arms, takes off, engages or flies a goal."""

import asyncio
import json
import socket

import pytest
from fake_flight import serving

from daemon.goals.errors import ErrorCode

GOAL = ("goal.submit", {"waypoint": {"position": [1, 0, -5]}})
TAKING = [("vehicle.arm", {}), ("vehicle.takeoff", {"altitude_m": 5}), ("vehicle.engage", {}), GOAL]
HARMLESS = [(name, {}) for name in ("vehicle.hold", "vehicle.land", "vehicle.return", "vehicle.disarm", "status.get")]
POSE = {"position": [0, 0, -1], "orientation": [1, 0, 0, 0]}


def line(method, params, number=1):
    return json.dumps({"jsonrpc": "2.0", "id": number, "method": method, "params": params}).encode() + b"\n"


def stand_still(flight):
    flight.standstills += 1
    flight.server.stood_still()


class Client:
    """Sends without the loop's help, as a process of its own does."""

    def __init__(self, path):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.connect(str(path))

    def send(self, *lines):
        self.sock.sendall(b"".join(lines))

    async def answer(self):
        self.sock.setblocking(False)
        data = b""
        while not data.endswith(b"\n"):
            data += await asyncio.wait_for(asyncio.get_running_loop().sock_recv(self.sock, 65536), 10.0)
        return json.loads(data.splitlines()[0])

    async def ask_over_a_standstill(self, flight, request, connected):
        """Send what is read after a standstill only, as the first line of the connection or as a later one."""
        if connected:
            self.send(line("status.get", {}))
            await self.answer()
        self.send(request)
        stand_still(flight)


async def settled():
    for _ in range(20):
        await asyncio.sleep(0.005)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "goals.sock"


@pytest.mark.parametrize("connected", [True, False])
@pytest.mark.parametrize(("method", "params"), TAKING)
async def test_what_takes_the_vehicle_is_refused(path, method, params, connected):
    async with serving(path) as flight:
        client = Client(path)
        await client.ask_over_a_standstill(flight, line(method, params), connected)
        error = (await client.answer())["error"]
        assert error["code"] == ErrorCode.WRONG_STATE
        assert "the daemon stood still" in error["message"]
        assert flight.calls == [] and flight.active is None
        client.send(line(method, params))
        assert "result" in await client.answer(), "asked again it is done"


@pytest.mark.parametrize("connected", [True, False])
@pytest.mark.parametrize(("method", "params"), HARMLESS)
async def test_what_gives_it_away_or_only_reads_is_done(path, method, params, connected):
    async with serving(path) as flight:
        client = Client(path)
        await client.ask_over_a_standstill(flight, line(method, params), connected)
        assert "result" in await client.answer()


@pytest.mark.parametrize("connected", [True, False])
async def test_of_a_client_that_has_left_nothing_takes_the_vehicle(path, connected):
    async with serving(path) as flight:
        client = Client(path)
        if connected:
            client.send(line("status.get", {}))
            await client.answer()
        client.send(*(line(*request) for request in TAKING), line("vehicle.land", {}))
        client.sock.close()
        if connected:
            await asyncio.sleep(0)
        stand_still(flight)
        await settled()
        assert [name for name, _ in flight.calls] == ["land"]
        assert flight.active is None


async def test_what_was_read_already_and_the_rest_of_a_line_count_as_of_before(path):
    async with serving(path) as flight:
        client = Client(path)
        client.send(line("status.get", {}))
        await client.answer()
        whole = line("vehicle.arm", {})
        client.send(line("vehicle.takeoff", {"altitude_m": 5}) * 40 + whole[:20])
        await asyncio.sleep(0.003)
        begun = len(flight.calls)
        stand_still(flight)
        client.send(whole[20:], line("vehicle.engage", {}))
        await settled()
        await settled()
        assert [name for name, _ in flight.calls[begun:]].count("arm") == 0
        assert len(flight.calls) <= begun + 33, "those that were begun, and the engage"
        assert [name for name, _ in flight.calls][-1] == "engage"


async def test_a_connection_that_comes_after_it_is_served(path):
    async with serving(path) as flight:
        stand_still(flight)
        client = Client(path)
        client.send(line("vehicle.arm", {}))
        assert "result" in await client.answer()
        waiting = Client(path)
        waiting.send(line("vehicle.arm", {}))
        stand_still(flight)
        assert "error" in await waiting.answer()
        await settled()
        later = Client(path)
        later.send(line("vehicle.arm", {}))
        assert "result" in await later.answer()


async def test_a_batch_that_was_begun_goes_no_further_than_to_give_the_vehicle_away(path):
    async with serving(path) as flight:
        client = Client(path)
        requests = [("vehicle.takeoff", {"altitude_m": 99.0}), ("vehicle.engage", {}), ("vehicle.land", {}), GOAL]
        batch = [{"jsonrpc": "2.0", "id": i, "method": m, "params": p} for i, (m, p) in enumerate(requests)]
        client.send(json.dumps(batch).encode() + b"\n")
        await settled()
        stand_still(flight)
        flight.release.set()
        answers = await client.answer()
        assert ["result" in answer for answer in answers] == [True, False, True, False]
        assert [name for name, _ in flight.calls] == ["takeoff", "land"]


async def test_references_and_poses_that_waited_do_not_count_as_of_now(path):
    async with serving(path) as flight:
        client = Client(path)
        pose = {"jsonrpc": "2.0", "method": "estimator.pose", "params": POSE}
        client.send(json.dumps(pose).encode() + b"\n")
        stand_still(flight)
        assert "the daemon stood still" in (await client.answer())["params"]["text"]
        assert flight.calls == [] and flight.references == []


async def test_a_line_that_was_about_to_be_done_is_of_before_too(path):
    """What comes first after a standstill may be the server's turn."""
    async with serving(path) as flight:
        client = Client(path)
        client.send(line("status.get", {}))
        await client.answer()

        def look():
            if client.sent and not flight.standstills:
                stand_still(flight)

        client.sent = False
        flight.look = look
        client.send(line("vehicle.arm", {}))
        client.sent = True
        assert "the daemon stood still" in (await client.answer())["error"]["message"]
        client.send(line("vehicle.arm", {}))
        assert "result" in await client.answer()
