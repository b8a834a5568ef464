"""Turns are fair to users and processes, and one that comes to a flood does not wait for it."""

from collections import Counter, defaultdict

from hypothesis import given
from hypothesis import strategies as st

from daemon.goals.turns import Turns

UID = 1000
FLOOD = range(100)
PUTS_AND_TAKES = st.lists(st.none() | st.tuples(st.integers(0, 2), st.integers(0, 4)), max_size=200)


def flood(turns: Turns[int]) -> None:
    """A hundred processes of one user with more to do than will be done, long under way."""
    for pid in FLOOD:
        for _ in range(50):
            turns.put(UID, pid, pid)
    for _ in range(500):
        turns.take()


def flooded() -> Turns[int]:
    turns: Turns[int] = Turns()
    flood(turns)
    return turns


def test_who_comes_to_a_flood_by_the_same_user_is_next_but_one_at_the_latest() -> None:
    turns = flooded()
    turns.put(UID, 7777, 7777)
    assert 7777 in [turns.take() for _ in range(2)]


def test_who_asks_again_after_each_answer_has_one_turn_a_round() -> None:
    turns = flooded()
    taken: Counter[int] = Counter()
    turns.put(UID, 7777, 7777)
    for _ in range(1010):
        taken[pid := turns.take()] += 1
        if pid == 7777:
            turns.put(UID, 7777, 7777)
    assert taken[7777] in (10, 11)
    assert {taken[pid] for pid in FLOOD} <= {9, 10, 11}


def test_newcomers_without_end_leave_half_of_the_turns_to_the_others() -> None:
    turns: Turns[int] = Turns()
    for _ in range(100):
        turns.put(UID, 1, 1)
    taken = []
    for newcomer in range(1000, 1100):
        turns.put(UID, newcomer, newcomer)
        taken.append(turns.take())
    assert taken.count(1) in (50, 51)


def test_who_was_in_a_flood_that_is_over_comes_anew_to_the_next() -> None:
    turns = flooded()
    turns.put(UID, 7777, 7777)
    while turns:
        turns.take()
    flood(turns)
    turns.put(UID, 7777, 7777)
    assert 7777 in [turns.take() for _ in range(2)]


def test_users_take_turns_however_many_processes_each_of_them_has() -> None:
    turns = flooded()
    for _ in range(10):
        turns.put(UID + 1, 1, -1)
    assert [turns.take() for _ in range(20)].count(-1) == 10


@given(PUTS_AND_TAKES)
def test_everything_comes_out_once_and_in_the_order_of_its_process(events: list[tuple[int, int] | None]) -> None:
    turns: Turns[tuple[int, int, int]] = Turns()
    put: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    taken: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for number, event in enumerate(events):
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
