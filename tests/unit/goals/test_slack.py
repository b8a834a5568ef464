import asyncio
from itertools import pairwise
from math import floor

import pytest

from daemon.goals.slack import LEAST_GUARD_S, MOST_WAIT_S, PAUSE_S, Slack
from daemon.sim.virtual_time import run_virtual

PERIOD_S = 0.01


def next_tick_s():
    """A control task that is always on time, on a grid of 10 ms."""
    return (floor(asyncio.get_running_loop().time() / PERIOD_S + 1e-9) + 1) * PERIOD_S


def always_busy(slack, begun_s):
    def worker():
        begun_s.append(asyncio.get_running_loop().time())
        slack.want(worker)
        return True

    return worker


def test_pieces_keep_clear_of_the_next_tick_and_lie_apart():
    async def scenario():
        slack, begun_s = Slack(next_tick_s), []
        slack.want(always_busy(slack, begun_s))
        await asyncio.sleep(1.0)
        return begun_s

    begun_s = run_virtual(scenario())
    before_tick_s = [PERIOD_S - (begin_s + 1e-9) % PERIOD_S for begin_s in begun_s]
    assert min(before_tick_s) >= LEAST_GUARD_S - 1e-6
    assert min(b - a for a, b in pairwise(begun_s)) >= PAUSE_S - 1e-9
    assert len(begun_s) > 700


def test_dear_pieces_get_a_quarter_of_the_time_and_a_wider_guard():
    async def scenario():
        loop = asyncio.get_running_loop()
        slack = Slack(lambda: 1.0)
        real, begun_s = loop.time, []
        loop.time = lambda: real() + 0.0015 * len(begun_s)  # each piece takes 1.5 ms
        slack.want(always_busy(slack, begun_s))
        await asyncio.sleep(0.2)
        found = slack.start_s(0.998), slack.start_s(0.9986)
        slack._most_guard_s = 0.001
        return begun_s, *found, slack.start_s(0.9986)

    begun_s, clear_s, guarded_s, unguarded_s = run_virtual(scenario())
    assert min(b - a for a, b in pairwise(begun_s)) >= 4 * 0.0015 - 1e-9
    assert (clear_s, guarded_s, unguarded_s) == (0.998, 1.0, 0.9986)


@pytest.mark.parametrize("next_tick", [lambda: 0.0, lambda: asyncio.get_running_loop().time() + 1e-4])
def test_control_task_that_stands_still_or_is_always_due_stops_nobody(next_tick):
    async def scenario():
        slack, begun_s = Slack(next_tick), []
        slack.want(always_busy(slack, begun_s))
        await asyncio.sleep(1.0)
        return begun_s

    begun_s = run_virtual(scenario())
    assert max(b - a for a, b in pairwise(begun_s)) <= MOST_WAIT_S + 2 * PAUSE_S
    assert len(begun_s) > 40


def test_workers_take_turns_and_idle_ones_cost_none():
    async def scenario():
        slack, done = Slack(), []

        def worker(name, idle):
            def work():
                done.append(name)
                slack.want(work)
                return not idle

            return work

        for name, idle in (("a", False), ("idle", True), ("b", False)):
            slack.want(worker(name, idle))
        await asyncio.sleep(0.1)
        return done

    done = run_virtual(scenario())
    assert done[:6] == ["a", "idle", "b"] * 2
    assert abs(done.count("a") - done.count("b")) <= 1


def test_worker_that_fails_does_not_end_the_others():
    async def scenario():
        slack, done = Slack(), []
        asyncio.get_running_loop().set_exception_handler(lambda *_: done.append("told"))
        slack.want(lambda: 1 / 0)
        slack.want(lambda: bool(done.append("next")) or True)
        await asyncio.sleep(0.1)
        slack.want(lambda: bool(done.append("later")) or True)
        await asyncio.sleep(0.1)
        return done

    assert run_virtual(scenario()) == ["told", "next", "later"]
