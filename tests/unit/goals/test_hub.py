import asyncio
import json

import pytest

from daemon.goals.hub import MAX_JOBS, SENDS_PER_PIECE, Hub
from daemon.goals.slack import PAUSE_S
from daemon.sim.virtual_time import run_virtual


class Listener:
    def __init__(self):
        self.heard = []

    def send(self, line, *, essential):
        self.heard.append((json.loads(line), essential))

    def methods(self):
        return [message["method"] for message, _ in self.heard]


async def publish(hub, topic, rate_hz, seconds):
    """As a task of the daemon does: ask whether it is wanted, and only then make it."""
    made = 0
    for number in range(int(rate_hz * seconds)):
        if hub.wants(topic):
            hub.publish(topic, {"number": number})
            made += 1
        await asyncio.sleep(1.0 / rate_hz)
    return made


@pytest.mark.parametrize("rate_hz", [1.0, 7.0, 10.0, 30.0, 50.0])
def test_topic_comes_at_the_rate_that_was_asked_for(rate_hz):
    async def scenario():
        hub, listener = Hub("g"), Listener()
        hub.subscribe(listener, ["state"], rate_hz)
        made = await publish(hub, "state", 100.0, 20.0)
        return len(listener.heard), made

    heard, made = run_virtual(scenario())
    assert abs(heard / 20.0 - rate_hz) <= 0.1 * rate_hz
    assert made == heard, "nothing is made for nobody"


def test_each_subscriber_has_its_own_rate():
    async def scenario():
        hub, slow, fast = Hub("g"), Listener(), Listener()
        hub.subscribe(slow, ["state"], 2.0)
        hub.subscribe(fast, ["state"], 20.0)
        await publish(hub, "state", 100.0, 10.0)
        return len(slow.heard), len(fast.heard)

    slow, fast = run_virtual(scenario())
    assert abs(slow - 20) <= 2 and abs(fast - 200) <= 10


def test_nobody_wants_what_nobody_subscribed_to():
    async def scenario():
        hub, listener = Hub("g"), Listener()
        hub.publish("state", {})
        hub.event("reset", "nobody hears")
        hub.subscribe(listener, ["state"], 10.0)
        hub.forget(listener)
        assert not hub.wants("state") and not hub._jobs
        hub.publish("state", {})
        await asyncio.sleep(0.1)
        assert listener.heard == []

    run_virtual(scenario())


def test_events_come_all_and_in_order():
    async def scenario():
        hub, listener = Hub("g"), Listener()
        hub.subscribe(listener, ["events"], 1.0)
        for number in range(50):
            hub.event("tick", str(number))
        await asyncio.sleep(0.1)
        return [message["params"]["text"] for message, _ in listener.heard]

    assert run_virtual(scenario()) == [str(number) for number in range(50)]


def test_fan_out_takes_few_sends_a_piece():
    async def scenario():
        hub, listeners = Hub("g"), [Listener() for _ in range(5 * SENDS_PER_PIECE)]
        for listener in listeners:
            hub.subscribe(listener, ["events"], 1.0)
        hub.event("tick", "")
        counts = []
        while sum(counts) < len(listeners):
            await asyncio.sleep(PAUSE_S / 2)
            counts.append(sum(len(listener.heard) for listener in listeners) - sum(counts))
        return counts

    assert max(run_virtual(scenario())) <= SENDS_PER_PIECE


def test_more_events_than_can_be_sent_cost_the_oldest_and_no_memory():
    async def scenario():
        hub, listener = Hub("g"), Listener()
        hub.subscribe(listener, ["events", "state"], 50.0)
        hub.publish("state", {})
        for number in range(MAX_JOBS + 10):
            hub.event("tick", str(number))
        assert len(hub._jobs) == MAX_JOBS and hub.lost_jobs == 11
        await asyncio.sleep(1.0)
        assert listener.heard[-1][0]["params"]["text"] == str(MAX_JOBS + 9)
        assert hub.wants("state"), "a topic whose payload was dropped goes on"

    run_virtual(scenario())


def test_feedback_may_be_lost_and_a_result_may_not():
    async def scenario():
        hub, owner, other = Hub("g"), Listener(), Listener()
        hub.subscribe(other, ["goal"], 10.0)
        goal_id = hub.new_goal(owner)
        hub.goal_feedback({"goal_id": goal_id, "progress": 0.0})
        assert owner.heard == [], "nothing of a goal precedes the reply that names it"
        hub.goal_answered(goal_id)
        hub.goal_feedback({"goal_id": goal_id, "progress": 0.5})
        hub.goal_result({"goal_id": goal_id, "outcome": "succeeded"})
        await asyncio.sleep(0.1)
        assert [essential for _, essential in owner.heard] == [False, True]
        assert owner.methods() == ["goal.feedback", "goal.result"]
        assert other.methods()[-1] == "goal.result" and other.heard[-1][1]
        assert not hub.owns_goal(owner)

    run_virtual(scenario())
