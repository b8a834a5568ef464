"""When a goal counts as ended: at rest, out of time since it was accepted, in silence since it is flown."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from support.trajectory_rig import LIMITS

from daemon.guidance.goals import Goal, HoldGoal, StreamGoal
from daemon.guidance.plan import HoldPlan
from daemon.loops import trajectory_task
from daemon.loops.active_goal import ActiveGoal, Verdict
from daemon.loops.goal_book import GoalBook
from daemon.loops.goal_order import GoalOrder
from daemon.messages import IDENTITY, EstimatedState, Reference, Vec3
from daemon.pipeline import Record

PLACE: Vec3 = (1.0, 2.0, -5.0)
ACCEPTED_S = 100.0


def accepted(goal: Goal, **order: Any) -> ActiveGoal:
    made = GoalOrder(goal_id="g1", kind="trajectory", goal=goal, limits=LIMITS)
    plan = HoldPlan(Reference(ACCEPTED_S, PLACE), 0.0)
    return ActiveGoal(replace(made, **order), GoalBook().open("g1", "trajectory", ACCEPTED_S), plan)


def verdict(goal: ActiveGoal, now_s: float, speed_m_s: float = 0.0) -> Verdict | None:
    assert goal.plan is not None
    state = EstimatedState(now_s, PLACE, (0.0, 0.0, 0.0), IDENTITY, (0.0, 0.0, 0.0))
    return goal.judge(goal.plan, state, speed_m_s, now_s)[1]


def test_a_canceled_goal_ends_when_the_vehicle_rests_and_not_with_its_brake() -> None:
    goal = accepted(HoldGoal(duration_s=60.0))
    goal.canceled = True
    assert verdict(goal, ACCEPTED_S + 1.0, speed_m_s=0.31) is None
    ended = verdict(goal, ACCEPTED_S + 1.1, speed_m_s=0.29)
    assert ended is not None and ended.outcome == "canceled"


def test_a_time_out_counts_from_the_acceptance_and_a_silence_from_the_take_over() -> None:
    timed = accepted(StreamGoal(timeout_s=2.0), timeout_s=6.0)
    silent = accepted(StreamGoal(timeout_s=2.0))
    for goal in (timed, silent):
        assert verdict(goal, ACCEPTED_S + 5.0) is None  # engaged only now
    assert verdict(timed, ACCEPTED_S + 5.9) is None
    out_of_time, unheard = verdict(timed, ACCEPTED_S + 6.1), verdict(silent, ACCEPTED_S + 7.1)
    assert out_of_time is not None and out_of_time.reason == "timeout"
    assert unheard is not None and unheard.reason == "stream_timeout"


def test_the_speed_that_rests_is_without_the_drift_of_the_measured_velocity() -> None:
    newest = SimpleNamespace(velocity_ned_m_s=(0.4, -0.1, 0.0))
    control = SimpleNamespace(velocity_bias_ned_m_s=(0.35, -0.1, 0.0))
    record = SimpleNamespace(estimate=SimpleNamespace(newest=newest), control=control)
    assert trajectory_task._speed_m_s(cast(Record, record)) == pytest.approx(0.05)
