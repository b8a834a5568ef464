import pytest
from fake_flight import serving_in_thread

from daemon.goals.blocking import BlockingFlightClient
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import NoDaemonError, RefusedError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s"


def test_goal_gives_feedback_and_then_its_result(path):
    with serving_in_thread(path, auto="succeeded"), BlockingFlightClient(path) as flight:
        goal = flight.goto(10, 0, -5, yaw_deg=90)
        assert [feedback.goal_id for feedback in goal]
        assert goal.wait().succeeded and goal.done


def test_waiting_too_long_leaves_the_goal_running(path):
    with serving_in_thread(path), BlockingFlightClient(path) as flight:
        goal = flight.path([[1, 0, -5], {"position": [2, 0, -5], "yaw_deg": 3}], through="fly_by")
        with pytest.raises(TimeoutError):
            goal.wait(0.01)
        assert not goal.done
        goal.cancel()
        assert goal.wait().outcome == "canceled"


def test_vehicle_settings_and_telemetry(path):
    with serving_in_thread(path) as daemon, BlockingFlightClient(path) as flight:
        assert flight.takeoff(5)["mode"] == "hold"
        assert flight.set_config("guidance.limits.speed_m_s", 3)["value"] == 3
        assert flight.status()["state"] == "ready"
        stream = flight.telemetry("events")
        daemon.loop.call_soon_threadsafe(publish_when_heard, daemon)
        assert next(stream).data["code"] == "reset"


def publish_when_heard(daemon):
    if daemon.hub._gates["events"]:
        daemon.hub.event("reset", "the heading was reset")
    else:
        daemon.loop.call_soon(publish_when_heard, daemon)


def test_a_stream_is_fed_and_a_goal_is_submitted_and_moved(path):
    with serving_in_thread(path) as daemon, BlockingFlightClient(path) as flight:
        goal = flight.submit({"waypoint": {"position": [1, 0, -5]}}, limits={"speed_m_s": 1})
        flight.update(goal.goal_id, 2, 0, -5)
        assert daemon.calls[-1][1].waypoint.position == (2.0, 0.0, -5.0)
        stream = flight.stream(stream_timeout_s=1.0)
        assert goal.wait().by == stream.goal_id
        flight.send_reference(stream.goal_id, [1, 2, -3], [0, 0, 0])
        flight.send_pose([0, 0, 0], [1, 0, 0, 0])
        flight.status()
        assert [reference.position for reference in daemon.references] == [(1.0, 2.0, -3.0)]


def test_it_has_the_calls_of_the_client_for_asyncio():
    def calls(client):
        return {name for name in vars(client) if not name.startswith("_")}

    assert calls(FlightClient) - calls(BlockingFlightClient) == {"close"}


def test_outside_of_its_with_block_it_says_that_it_is_not_connected(path):
    with serving_in_thread(path):
        client = BlockingFlightClient(path)
        with pytest.raises(NoDaemonError, match="not connected: use it in a `with` block"):
            client.status()
        with client:
            goal = client.goto(1, 0, -5)
        for ask in (client.status, goal.wait, lambda: next(client.telemetry("state"))):
            with pytest.raises(NoDaemonError, match="not connected: use it in a `with` block"):
                ask()


def test_errors_come_through(path):
    with pytest.raises(NoDaemonError), BlockingFlightClient(path):
        pass
    with serving_in_thread(path), BlockingFlightClient(path) as flight, pytest.raises(RefusedError, match="ceiling"):
        flight.goto(0, 0, -250)
