"""The vehicle flies on while a long path is planned, and a plan that was overtaken is dropped."""

from dataclasses import replace
from math import dist

import pytest
from support.trajectory_rig import NEAR, ORIGIN, Rig, assert_smooth, run, slow_planning, to

from daemon.guidance.goals import PathGoal, Through, WaypointGoal
from daemon.messages import AutopilotStatus, FrameShift
from daemon.safety.supervisor import State

CORNERS = tuple(WaypointGoal(position_ned_m=p) for p in ((8.0, 0.0, -10.0), (8.0, 8.0, -12.0), (0.0, 8.0, -10.0)))
FLY_BY = PathGoal(waypoints=CORNERS, through=Through.FLY_BY)


def passes(rig: Rig) -> bool:
    return all(
        min(dist(r.position_ned_m, corner.position_ned_m or NEAR) for r in rig.history) < 0.05 for corner in CORNERS
    )


@pytest.mark.parametrize("takes_s", [[0.3], [0.7, 0.8]])
def test_the_vehicle_goes_on_while_a_long_path_is_planned(
    monkeypatch: pytest.MonkeyPatch, takes_s: list[float]
) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, takes_s)
        first = rig.submit(to((0.0, -15.0, -10.0)))
        await rig.wait(1.5)
        goal_id = rig.submit(FLY_BY)
        assert (await rig.end_of(first)).by == goal_id
        await rig.wait(0.12)
        assert rig.flown.acceleration_ned_m_s2[1] == pytest.approx(-3.0)
        entry = await rig.end_of(goal_id)
        assert entry.outcome == "succeeded"
        assert len(begun) == len(takes_s)
        assert passes(rig)
        assert_smooth(rig.history)

    run(scenario)


def test_a_cancel_brakes_at_once_whatever_is_being_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        slow_planning(monkeypatch, [0.45])
        rig.submit(to((0.0, -15.0, -10.0)))
        await rig.wait(1.5)
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.05)
        rig.task.cancel()
        await rig.wait(0.35)
        assert rig.flown.velocity_ned_m_s[1] < -4.0
        assert rig.flown.acceleration_ned_m_s2[1] > 0.3
        assert (await rig.end_of(goal_id)).outcome == "canceled"
        assert_smooth(rig.history)

    run(scenario)


@pytest.mark.parametrize("then", ["newer", "cancel", "pilot"])
def test_an_unfinished_plan_is_dropped(monkeypatch: pytest.MonkeyPatch, then: str) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, [0.4])
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.1)
        assert len(begun) == 1
        if then == "newer":
            newer = rig.submit(to(NEAR))
            assert (await rig.end_of(newer)).outcome == "succeeded"
        elif then == "cancel":
            rig.task.cancel()
        else:
            rig.state, rig.left = State.PILOT, "pilot_override"
        entry = await rig.end_of(goal_id)
        expected = {"newer": ("preempted", None), "cancel": ("canceled", None), "pilot": ("aborted", "pilot_override")}
        assert (entry.outcome, entry.reason) == expected[then]
        await rig.wait(1.0)
        assert len(begun) == 1
        assert min(dist(r.position_ned_m, (8.0, 0.0, -10.0)) for r in rig.history) > 5.0
        assert_smooth(rig.history)

    run(scenario)


def test_a_path_is_planned_anew_when_the_estimate_jumped_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, [0.3, 0.3])
        goal_id = rig.submit(FLY_BY)
        await rig.wait(0.1)
        rig.shift = FrameShift(1, rig.now_s, position_ned_m=(0.0, 0.0, 0.0), yaw_rad=0.1)
        assert (await rig.end_of(goal_id)).outcome == "succeeded"
        assert len(begun) == 2

    run(scenario)


def test_a_path_on_the_globe_is_planned_anew_when_its_origin_moved_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(rig: Rig) -> None:
        begun = slow_planning(monkeypatch, [0.3, 0.3])
        goal_id = rig.submit(FLY_BY, resolve=lambda _status: FLY_BY)
        await rig.wait(0.1)
        rig.status.set(
            replace(rig.status.value, global_origin=replace(ORIGIN, latitude_deg=ORIGIN.latitude_deg + 1e-4))
        )
        assert (await rig.end_of(goal_id)).outcome == "succeeded"
        assert len(begun) == 2

    run(scenario)


@pytest.mark.parametrize("goal", [to(NEAR), FLY_BY])
def test_a_failure_of_planning_is_a_failure_of_the_task(goal: WaypointGoal | PathGoal) -> None:
    def fails(_status: AutopilotStatus) -> WaypointGoal:
        raise ZeroDivisionError("a mistake")

    async def scenario(rig: Rig) -> None:
        rig.submit(goal, resolve=fails)
        await rig.wait(5.0)
        pytest.fail("the task went on")

    with pytest.raises(ZeroDivisionError, match="a mistake"):
        run(scenario)
