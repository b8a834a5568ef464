"""Paths that are planned beside the loop, one after the other: each told as itself, nothing of the old kept."""

from itertools import pairwise
from math import dist

import pytest
from support.trajectory_rig import Rig, assert_smooth, run, slow_planning, to

from daemon.frames import norm, subtract
from daemon.guidance.goals import PathGoal, Through
from daemon.guidance.plan import Plan
from daemon.loops.flown_plan import PLANNING_S
from daemon.messages import FrameShift

PLANS_OF_A_PATH = 6


def fly_by(n: int = 0) -> PathGoal:
    corners = ((3.0, 0.0, -10.0), (3.0, 3.0, -10.0), (0.0, float(n % 2), -10.0))
    return PathGoal(waypoints=tuple(to(corner) for corner in corners), through=Through.FLY_BY)


def plans_in(plan: Plan) -> int:
    """How many plans a plan is made of, itself included."""
    held = [one for value in vars(plan).values() for one in (value if isinstance(value, tuple) else (value,))]
    return 1 + sum(plans_in(one) for one in held if isinstance(one, Plan))


@pytest.mark.parametrize(("every_s", "count"), [(0.03, 40), (0.35, 20), (12.0, 8)])
@pytest.mark.parametrize("jumps", [False, True], ids=["", "estimate jumps"])
def test_what_is_kept_does_not_grow_with_the_number_of_paths(every_s: float, count: int, jumps: bool) -> None:
    async def scenario(rig: Rig) -> None:
        most = PLANS_OF_A_PATH * (PLANNING_S / every_s + 2.0)
        for n in range(count):
            rig.submit(fly_by(n))
            await rig.wait(every_s)
            if jumps:
                rig.shift = FrameShift(n + 1, rig.now_s, position_ned_m=(0.0, 0.0, 0.01 * n))
            assert rig.task.plan.value is not None
            assert plans_in(rig.task.plan.value) <= most
        if not jumps:
            assert_smooth(rig.history)

    run(scenario)


@pytest.mark.parametrize("held_s", [0.5, 120.0])
def test_progress_is_that_of_the_path_alone_however_long_was_held_before(held_s: float) -> None:
    async def scenario(rig: Rig) -> None:
        await rig.end_of(rig.submit(to((0.0, 2.0, -10.0))))
        await rig.wait(held_s)
        rig.progress.clear()
        entry = await rig.end_of(rig.submit(fly_by()))
        assert entry.duration_s is not None
        shares = [one.progress for one in rig.progress]
        assert shares[0] == 0.0 and shares[8] < 0.1 and shares[-1] == 1.0
        assert shares == sorted(shares)
        assert len(shares) == pytest.approx(10.0 * entry.duration_s, abs=2.0)
        assert rig.progress[0].distance_m == pytest.approx(2.0, abs=0.01)  # to the end of the path, not of the hold
        assert rig.progress[0].eta_s == pytest.approx(entry.duration_s, abs=1.0)
        plan = rig.task.plan.value
        assert plan is not None
        ways = [norm(subtract(b.position_ned_m, a.position_ned_m)) for a, b in pairwise(plan.outline(100))]
        assert sum(way > 0.01 for way in ways) > 80

    run(scenario)


def test_nothing_is_told_of_a_path_before_it_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        await rig.end_of(rig.submit(to((0.0, 2.0, -10.0))))
        rig.progress.clear()
        begun = slow_planning(monkeypatch, [0.45])
        goal_id = rig.submit(fly_by(), timeout_s=0.3)
        entry = await rig.end_of(goal_id)
        assert len(begun) == 1
        assert (entry.outcome, entry.reason, entry.error_m) == ("aborted", "timeout", None)
        assert rig.progress == []

    run(scenario)


@pytest.mark.parametrize(("every_s", "most"), [(5.0, 2), (1.0, 6)])
def test_velocity_jumps_while_a_place_is_held_do_not_pile_up(every_s: float, most: int) -> None:
    async def scenario(rig: Rig) -> None:
        await rig.wait(0.5)
        for n in range(1, 21):
            jumped = (0.1 * n, 0.0, 0.0)
            rig.shift = FrameShift(n, rig.now_s, position_ned_m=jumped, velocity_ned_m_s=(0.5 * n, 0.0, 0.0))
            rig.task.wake()
            await rig.wait(every_s)
            assert rig.task.plan.value is not None
            assert plans_in(rig.task.plan.value) <= most
        await rig.wait(5.0)
        assert dist(rig.flown.position_ned_m, (2.0, 0.0, -10.0)) < 1e-6
        assert norm(rig.flown.velocity_ned_m_s) < 1e-6

    run(scenario)
