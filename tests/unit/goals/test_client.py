import asyncio
from fractions import Fraction

import numpy as np
import pytest
from fake_flight import PATIENCE_S, serving

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import (
    ConnectionLostError,
    InvalidRequestError,
    NoDaemonError,
    NotPermittedError,
    RefusedError,
    RequestError,
    UnknownGoalError,
    WrongStateError,
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


async def test_goal_gives_feedback_and_then_its_result(path):
    async with serving(path, auto="succeeded") as daemon, FlightClient(path) as flight:
        goal = await flight.goto(10, 0, -5, yaw_deg=90)
        distances = [feedback.distance_m async for feedback in goal]
        result = await goal
        assert distances and distances == sorted(distances, reverse=True)
        assert (result.outcome, result.succeeded, result.error_m) == ("succeeded", True, 0.12)
        waypoint = daemon.calls[0][1].waypoint
        assert waypoint.position == (10.0, 0.0, -5.0) and waypoint.yaw_deg == 90.0


async def test_result_that_comes_with_the_reply_is_not_lost(path):
    async with serving(path, auto="instant"), FlightClient(path) as flight:
        goals = [await flight.goto(n, 0, -5) for n in range(50)]
        assert [(await goal).outcome for goal in goals] == ["succeeded"] * 50


async def test_newer_goal_preempts_and_its_client_learns_by_which(path):
    async with serving(path), FlightClient(path) as first, FlightClient(path) as second:
        old = await first.goto(1, 0, -5)
        new = await second.goto(2, 0, -5)
        result = await old
        assert (result.outcome, result.by) == ("preempted", new.goal_id)
        assert new.preempted == old.goal_id
        assert not new.done


async def test_cancel_ends_a_goal(path):
    async with serving(path), FlightClient(path) as flight:
        goal = await flight.goto(1, 0, -5)
        await goal.cancel()
        assert (await goal).outcome == "canceled"


async def test_errors_are_exceptions_with_field_and_reason(path):
    async with serving(path), FlightClient(path) as flight:
        with pytest.raises(RefusedError) as refused:
            await flight.goto(0, 0, -250)
        assert refused.value.field == "waypoint.position[2]"
        assert str(refused.value) == "waypoint.position[2]: a height of 250 m is above the fence's ceiling of 120 m"
        with pytest.raises(InvalidRequestError) as invalid:
            await flight.goto(0, 0, -2, frame="moon")
        assert invalid.value.field == "waypoint.frame"
        with pytest.raises(UnknownGoalError):
            await flight.cancel("nobody")
        with pytest.raises(WrongStateError):
            await flight.cancel()
        with pytest.raises(RequestError) as internal:
            await flight.goto(0, 0, -13)
        assert internal.value.code == -32603


async def test_observer_reads_but_does_not_act(path):
    async with serving(path, observers=True) as daemon, FlightClient(path) as flight:
        assert (await flight.status())["state"] == "ready"
        for act in (
            flight.goto(1, 0, -5),
            flight.land(),
            flight.cancel(),
            flight.set_config("guidance.limits.speed_m_s", 1.0),
        ):
            with pytest.raises(NotPermittedError):
                await act
        assert daemon.calls == [] and daemon.setting["value"] == 5.0


async def test_without_a_daemon_it_says_how_to_start_one(path):
    with pytest.raises(
        NoDaemonError,
        match=r"\(no such file or directory\): start one with `flightd run` \(the service: `sudo systemctl",
    ):
        async with FlightClient(path):
            pass


async def test_comes_back_to_a_daemon_that_was_restarted(path):
    async with serving(path, prefix="a"):
        client = FlightClient(path)
        await client.__aenter__()
        goal = await client.goto(1, 0, -5)
    async with serving(path, prefix="b"):
        assert (await client.status())["state"] == "ready"
        result = await asyncio.wait_for(goal.result(), PATIENCE_S)
        assert result.outcome == "aborted"
        assert result.reason == "the daemon does not know it any more: it was restarted, or newer goals took its place"
    await client.close()


async def test_goal_goes_on_when_only_the_connection_was_lost(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        goal = await flight.goto(1, 0, -5)
        for session in list(daemon.server._sessions):
            session.abort()
        await flight.status()
        assert not goal.done
        while not daemon.hub._gates["goal"]:
            await flight.status()
        daemon.end(goal.goal_id)
        assert (await goal).succeeded


async def test_gives_up_when_the_daemon_does_not_come_back(path):
    async with serving(path):
        client = FlightClient(path, reconnect_s=0.0)
        await client.__aenter__()
        goal = await client.goto(1, 0, -5)
    with pytest.raises(NoDaemonError):
        await goal
    with pytest.raises(NoDaemonError):
        await client.status()
    await client.close()


async def test_telemetry_of_a_topic_is_iterated_over(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        stream = flight.telemetry("events", "loops")
        first = asyncio.ensure_future(anext(stream))
        while not daemon.hub._gates["events"]:
            await flight.status()
        daemon.hub.event("reset", "the heading was reset")
        got = await first
        assert (got.topic, got.data["code"], got.data["text"]) == ("events", "reset", "the heading was reset")
        await stream.aclose()
        assert not daemon.hub._gates["events"]


async def test_event_that_comes_with_the_reply_to_the_subscription_is_not_lost(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        subscribe = daemon.hub.subscribe

        def subscribe_and_publish(*arguments):
            topics = subscribe(*arguments)
            daemon.hub.event("reset", "at once")
            return topics

        daemon.hub.subscribe = subscribe_and_publish
        stream = flight.telemetry("events")
        assert (await asyncio.wait_for(anext(stream), PATIENCE_S)).data["text"] == "at once"
        await stream.aclose()


async def test_stream_sends_references_and_hears_of_refused_ones(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        goal = await flight.stream()
        await flight.send_reference(goal.goal_id, [1, 2, -3], [0, 0, 0], yaw_deg=10)
        await flight.status()
        assert daemon.references[0].position == (1.0, 2.0, -3.0)


async def test_request_that_the_daemon_could_not_answer_by_its_id_is_refused_before_it_is_sent(path):
    async with serving(path), FlightClient(path) as flight:
        for bad in (flight.goto(float("nan"), 0, -5), flight.path([[n, 0, -5] for n in range(9000)])):
            with pytest.raises(InvalidRequestError):
                await asyncio.wait_for(bad, PATIENCE_S)
        assert (await flight.status())["state"] == "ready"


async def test_one_connection_too_many_is_told_as_the_daemon_said_it(path, monkeypatch):
    monkeypatch.setattr("daemon.goals.server.MAX_CLIENTS", 1)
    async with serving(path), FlightClient(path) as first:
        assert (await first.status())["state"] == "ready"
        async with FlightClient(path, reconnect_s=0.2) as second:
            with pytest.raises((ConnectionLostError, NoDaemonError), match="too many connections"):
                await second.call("status.get")
            with pytest.raises(NoDaemonError, match="too many connections"):
                await asyncio.wait_for(second.status(), PATIENCE_S)


async def test_a_client_that_is_not_connected_says_so(path):
    async with serving(path):
        client = FlightClient(path)
        for ask in (client.status(), client.send_pose([0, 0, 0], [1, 0, 0, 0]), anext(client.telemetry("state"))):
            with pytest.raises(NoDaemonError, match="not connected: use it in a `with` block"):
                await asyncio.wait_for(ask, PATIENCE_S)
        async with client:
            assert (await client.status())["state"] == "ready"


async def test_telemetry_of_no_topic_is_refused(path):
    async with serving(path), FlightClient(path) as flight:
        with pytest.raises(InvalidRequestError, match="topics"):
            await asyncio.wait_for(anext(flight.telemetry()), PATIENCE_S)


async def test_numbers_may_be_numpys(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        await flight.goto(np.float32(1.5), np.int64(2), np.float64(-5.0), hold_s=Fraction(1, 2))
        waypoint = daemon.calls[0][1].waypoint
        assert (waypoint.position, waypoint.hold_s) == ((1.5, 2.0, -5.0), 0.5)
        with pytest.raises(InvalidRequestError, match="not finite"):
            await flight.goto(np.float32("nan"), 0, -5)
        with pytest.raises(InvalidRequestError, match="a complex is not JSON"):
            await flight.goto(1j, 0, -5)


async def test_what_a_newer_daemon_tells_besides_is_left_out(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        goal = await flight.goto(1, 0, -5)
        daemon.hub.goal_feedback({"goal_id": goal.goal_id, "distance_m": 1.0, "angle_deg": 0.0, "progress": 0.5,
                                  "eta_s": 1.0, "wind_m_s": 3.0})  # fmt: skip
        record = daemon.records[goal.goal_id] | {"state": "done", "outcome": "succeeded", "wind_m_s": 3.0}
        daemon.hub.goal_result(record)
        assert (await asyncio.wait_for(goal.result(), PATIENCE_S)).succeeded
        assert goal.feedback.distance_m == 1.0


async def test_listeners_of_a_topic_get_it_at_the_highest_of_their_rates(path):
    async with serving(path) as daemon, FlightClient(path) as flight:
        streams = [flight.telemetry("state", rate_hz=50.0), flight.telemetry("state", "loops", rate_hz=2.0)]
        tasks = [asyncio.ensure_future(anext(stream)) for stream in streams]
        while not daemon.hub._gates["loops"]:
            await flight.status()
        periods = {topic: [gate.period_s for gate in daemon.hub._gates[topic].values()] for topic in ("state", "loops")}
        assert periods == {"state": [0.02], "loops": [0.5]}
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


async def test_goals_of_two_clients_cross_and_each_learns_of_its_own(path):
    async with serving(path) as daemon, FlightClient(path) as first, FlightClient(path) as second:

        async def submit(flight):
            return [await flight.goto(n, 0, -5) for n in range(50)]

        ours, theirs = await asyncio.gather(submit(first), submit(second))
        daemon.end(daemon.active)
        results = [await asyncio.wait_for(goal.result(), PATIENCE_S) for goal in ours + theirs]
        assert sorted(r.outcome for r in results) == ["preempted"] * 99 + ["succeeded"]
        assert [r.goal_id for r in results] == [g.goal_id for g in ours + theirs]


async def test_cancel_that_crosses_a_newer_goal_ends_each_once(path):
    async with serving(path), FlightClient(path) as flight:
        old = await flight.goto(1, 0, -5)
        cancel, new = asyncio.ensure_future(old.cancel()), await flight.goto(2, 0, -5)
        await asyncio.wait([cancel])
        assert (await asyncio.wait_for(old.result(), PATIENCE_S)).outcome in ("canceled", "preempted")
        assert not new.done or (await new).outcome == "canceled"
