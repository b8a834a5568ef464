"""Turns are fair to users and processes, and one that seldom asks does not wait for a flood."""

import asyncio
from collections import Counter, defaultdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.goals.turns import ANEW_S, Turns, Turnstile

UID = 1000
FLOOD = range(100)
MODEST = 7777
TURN_S = 0.004
PUTS_AND_TAKES = st.lists(st.none() | st.tuples(st.integers(0, 2), st.integers(0, 4)), max_size=200)


class Clock:
    def __init__(self) -> None:
        self.now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


class Crowd:
    """A hundred processes of one user that are served one after another; each asks again ``pause`` turns later."""

    def __init__(self, pause: int) -> None:
        self.clock = Clock()
        self.turns: Turns[int] = Turns(newcomers_first=True, clock=self.clock)
        self._pause = pause
        self._again: defaultdict[int, list[int]] = defaultdict(list)
        self._count = 0
        for pid in FLOOD:
            self.turns.put(UID, pid, pid)
        for _ in range(500):
            self.turn()

    def turn(self) -> int | None:
        """Who has this turn; nobody when nobody waits."""
        self.clock.now_s += TURN_S
        self._count += 1
        for pid in self._again.pop(self._count, ()):
            self.turns.put(UID, pid, pid)
        if not self.turns:
            return None
        taken = self.turns.take()
        if taken in FLOOD:
            self._again[self._count + self._pause].append(taken)
        return taken

    def wait_of(self, pid: int) -> int:
        """After how many turns of others a process that asks now has its own."""
        self.turns.put(UID, pid, pid)
        return next(n for n in range(1000) if self.turn() == pid)


@pytest.mark.parametrize("pause", [1, 5, 50, 99, 120])
def test_who_seldom_asks_is_next_but_one_at_the_latest_however_the_others_flood(pause: int) -> None:
    crowd = Crowd(pause)
    assert crowd.wait_of(MODEST) <= 1
    for _ in range(round(ANEW_S / TURN_S) + 1):
        crowd.turn()
    assert crowd.wait_of(MODEST) <= 1


def test_who_asks_again_after_each_answer_has_one_turn_a_round() -> None:
    crowd = Crowd(1)
    taken: Counter[int | None] = Counter()
    crowd.turns.put(UID, MODEST, MODEST)
    for _ in range(1010):
        taken[pid := crowd.turn()] += 1
        if pid == MODEST:
            crowd.turns.put(UID, MODEST, MODEST)
    assert taken[MODEST] in (10, 11)
    assert {taken[pid] for pid in FLOOD} <= {9, 10, 11}


def test_newcomers_without_end_leave_half_of_the_turns_to_the_others() -> None:
    turns: Turns[int] = Turns(newcomers_first=True, clock=Clock())
    for _ in range(100):
        turns.put(UID, 1, 1)
    taken = []
    for newcomer in range(1000, 1100):
        turns.put(UID, newcomer, newcomer)
        taken.append(turns.take())
    assert taken.count(1) in (50, 51)


def test_users_take_turns_however_many_processes_each_of_them_has() -> None:
    crowd = Crowd(1)
    for _ in range(10):
        crowd.turns.put(UID + 1, 1, -1)
    assert [crowd.turn() for _ in range(20)].count(-1) == 10


def test_processes_that_are_gone_are_forgotten() -> None:
    clock = Clock()
    turns: Turns[int] = Turns(newcomers_first=True, clock=clock)
    for pid in range(10_000):
        turns.put(UID, pid, pid)
        turns.take()
        clock.now_s += 0.01
    assert len(turns._turn_s) <= 101


async def test_goals_go_through_the_turnstile_as_they_came_whoever_comes_anew() -> None:
    """The last to come is the last to be flown: a newcomer must not be preempted by who came before it."""
    turnstile, order = Turnstile(), []

    async def pass_through(pid: int) -> None:
        await turnstile.enter(UID, pid)
        order.append(pid)

    await pass_through(2)
    waiting = []
    for pid in (1, 1, 7777):  # the first of them has its turn, and holds it, when the others come
        waiting.append(asyncio.ensure_future(pass_through(pid)))
        await asyncio.sleep(0)
        if len(waiting) == 1:
            turnstile.leave()
            await waiting[0]
    for _ in range(2):
        turnstile.leave()
        await asyncio.sleep(0)
    await asyncio.gather(*waiting)
    assert order == [2, 1, 1, 7777]


@given(PUTS_AND_TAKES)
def test_everything_comes_out_once_and_in_the_order_of_its_process(events: list[tuple[int, int] | None]) -> None:
    clock = Clock()
    turns: Turns[tuple[int, int, int]] = Turns(newcomers_first=True, clock=clock)
    put: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    taken: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for number, event in enumerate(events):
        clock.now_s += 0.3
        if event is not None:
            turns.put(*event, (*event, number))
            put[event].append(number)
        elif turns:
            uid, pid, of = turns.take()
            taken[uid, pid].append(of)
    for uid, pid in put:
        assert turns.count(uid, pid) == len(put[uid, pid]) - len(taken[uid, pid])
    while turns:
        uid, pid, of = turns.take()
        taken[uid, pid].append(of)
    assert taken == put
