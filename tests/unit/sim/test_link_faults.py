"""A bad link, one direction."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.sim.link_faults import PERFECT, LinkFaults, LinkQuality
from daemon.sim.noise import normals

STEP_US = 4000


def carry(quality, count=2000, seed=1):
    """Numbers sent every 4 ms: [(number, waited in us)] in order of arrival, and the link."""
    link, arrived = LinkFaults(normals(seed)), []
    link.quality = quality
    for index in range(count + 200):
        now_us = index * STEP_US
        if index < count:
            link.send(("M", {"n": index}, (1, 1)), now_us)
        arrived += [(f["n"], now_us - f["n"] * STEP_US) for _, f, _ in link.arrived(now_us)]
    return arrived, link


def test_a_silent_link_carries_nothing_and_a_perfect_one_says_so():
    arrived, link = carry(LinkQuality(silent=True))
    assert (arrived, link.lost) == ([], 2000)
    link.quality = PERFECT
    assert link.is_perfect


def test_loss_takes_its_share():
    arrived, link = carry(LinkQuality(loss=0.3))
    assert link.lost == 2000 - len(arrived)
    assert len(arrived) / 2000 == pytest.approx(0.7, abs=0.04)


def test_delay_waits_and_keeps_the_order():
    arrived, _ = carry(LinkQuality(delay_s=0.1))
    assert [n for n, _ in arrived] == list(range(2000))
    assert {waited for _, waited in arrived} == {100_000}


def test_jitter_spreads_the_delay_without_overtaking():
    arrived, _ = carry(LinkQuality(delay_s=0.02, jitter_s=0.05))
    assert [n for n, _ in arrived] == list(range(2000))
    waited = [w for _, w in arrived]
    assert min(waited) >= 20_000
    assert 60_000 < max(waited) <= 76_000


def test_reordering_lets_messages_overtake_and_loses_none():
    arrived, _ = carry(LinkQuality(reordering=0.1))
    numbers = [n for n, _ in arrived]
    assert sorted(numbers) == list(range(2000))
    overtaken = sum(a > b for a, b in itertools.pairwise(numbers))
    assert overtaken > 50


def test_what_waits_on_a_mended_link_still_arrives_in_order():
    link = LinkFaults(normals(1))
    link.quality = LinkQuality(delay_s=0.1)
    link.send(("M", {"n": 0}, (1, 1)), 0)
    link.quality = PERFECT
    assert not link.is_perfect
    link.send(("M", {"n": 1}, (1, 1)), 50_000)
    assert link.arrived(99_000) == []
    assert [f["n"] for _, f, _ in link.arrived(100_000)] == [0, 1]
    assert link.is_perfect


@settings(deadline=None, max_examples=30)
@given(
    st.builds(
        LinkQuality,
        loss=st.floats(0.0, 1.0),
        delay_s=st.floats(0.0, 0.3),
        jitter_s=st.floats(0.0, 0.3),
        reordering=st.floats(0.0, 1.0),
    )
)
def test_every_message_is_lost_or_arrives_once_and_never_before_the_delay(quality):
    arrived, link = carry(quality, count=100)
    assert len({n for n, _ in arrived}) == len(arrived) == 100 - link.lost
    assert all(waited >= quality.delay_s * 1e6 - 1.0 for _, waited in arrived)
