"""A goal that is replaced, updated, put off until the engage, or moved by a jump of the estimate."""

import asyncio
from dataclasses import replace
from math import dist

from support.trajectory_rig import FAR, NEAR, Rig, assert_smooth, run, to

from daemon.frames import add
from daemon.guidance.goals import HoldGoal, WaypointGoal
from daemon.messages import AutopilotStatus, FrameShift
from daemon.safety.supervisor import State


def test_the_newest_goal_wins_and_tells_whom_it_ended() -> None:
    async def scenario(rig: Rig) -> None:
        first = rig.submit(to(FAR))
        await rig.wait(1.03)
        second = rig.submit(to(NEAR))
        assert [(e.goal_id, e.outcome, e.by) for e in rig.ended] == [(first, "preempted", second)]
        third = rig.submit(HoldGoal(duration_s=0.5))
        assert (await rig.end_of(second)).by == third
        assert (await rig.end_of(third)).outcome == "succeeded"
        assert len(rig.ended) == 3
        assert_smooth(rig.history)

    run(scenario)


def test_a_new_window_begins_in_the_reference_that_is_being_flown() -> None:
    async def scenario(rig: Rig) -> None:
        rig.submit(to(FAR))
        for n in range(20):
            await rig.wait(0.17)
            rig.submit(to((3.0 * n % 7.0, -2.0 * n % 5.0, -10.0)))
            await asyncio.sleep(0)
            first = rig.window.samples[0]
            assert rig.window.goal_id == f"g{n + 2}"
            assert dist(first.position_ned_m, rig.flown.position_ned_m) < 1e-9
            assert dist(first.velocity_ned_m_s, rig.flown.velocity_ned_m_s) < 1e-9
            assert dist(first.acceleration_ned_m_s2, rig.flown.acceleration_ned_m_s2) < 1e-9
        assert_smooth(rig.history)

    run(scenario)


def test_an_updated_goal_goes_on_under_its_id() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        order = rig.task.order
        assert order is not None
        rig.task.update(replace(order, goal=to(NEAR)))
        entry = await rig.end_of(goal_id)
        assert entry.outcome == "succeeded"
        assert dist(rig.flown.position_ned_m, NEAR) < 0.3
        assert len(rig.ended) == 1
        rig.task.update(order)
        await rig.wait(0.2)
        assert rig.task.goal_id is None
        assert_smooth(rig.history)

    run(scenario)


def test_an_update_while_a_goal_is_held_begins_anew() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(NEAR, hold_s=1.0))
        await rig.until(lambda: dist(rig.flown.position_ned_m, NEAR) < 1e-3)
        await rig.wait(0.8)
        order = rig.task.order
        assert order is not None
        rig.task.update(replace(order, goal=to(FAR, hold_s=1.0)))
        assert (await rig.end_of(goal_id)).outcome == "succeeded"
        assert dist(rig.flown.position_ned_m, FAR) < 0.3

    run(scenario)


def test_a_goal_that_waits_to_be_engaged_is_flown_from_where_the_vehicle_is_then() -> None:
    async def scenario(rig: Rig) -> None:
        rig.state = State.READY
        await rig.wait(0.5)
        goal_id = rig.submit(to(NEAR))
        rig.state = State.ENGAGING
        await rig.wait(0.5)
        assert not rig.ended and rig.task.window.value is None
        rig.state = State.HOLDING
        assert (await rig.end_of(goal_id)).outcome == "succeeded"

    run(scenario)


def test_a_goal_keeps_its_physical_place_when_the_estimate_jumps() -> None:
    async def scenario(rig: Rig) -> None:
        goal_id = rig.submit(to(FAR))
        await rig.wait(1.0)
        jump = (0.5, -0.25, 0.1)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=jump)
        await rig.end_of(goal_id)
        await rig.wait(1.0)
        assert dist(rig.flown.position_ned_m, add(FAR, jump)) < 1e-6

    run(scenario)


def test_a_place_on_the_globe_is_made_anew_when_the_estimate_jumps() -> None:
    async def scenario(rig: Rig) -> None:
        places = [(6.0, 0.0, -10.0), (6.5, 0.0, -10.0)]

        def resolve(_status: AutopilotStatus) -> WaypointGoal:
            return to(places[rig.shift.count])

        goal_id = rig.submit(to(places[0]), resolve=resolve)
        await rig.wait(1.0)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=(9.0, 9.0, 9.0))
        await rig.end_of(goal_id)
        assert dist(rig.flown.position_ned_m, places[1]) < 0.3

    run(scenario)
