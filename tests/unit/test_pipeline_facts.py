"""What the estimator thinks of its estimate reaches the supervisor, and hands the vehicle back."""

from dataclasses import replace
from typing import Any

import pytest
from support.pipeline_rig import ENGAGE, Flow

from daemon import pipeline
from daemon.estimation import estimator
from daemon.estimation.quality import Quality
from daemon.messages import Reset
from daemon.safety.supervisor import State


def estimates_say(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """From now on the estimator says so in every tick."""
    step = estimator.step

    def changed(*args: Any, **parameters: Any) -> Any:
        state, estimate = step(*args, **parameters)
        return state, replace(estimate, **changes)

    monkeypatch.setattr(pipeline.estimator, "step", changed)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"quality": Quality(innovation=5.0)}, "estimate_poor"),
        ({"disagreement_rad": 0.5}, "attitude_disagreement"),
        ({"reset": Reset(0.0, frozenset({"position_ne"}), truth_returned=True)}, "position_reset"),
    ],
)
def test_an_estimate_that_is_not_to_be_flown_gives_the_vehicle_back(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], reason: str
) -> None:
    flow = Flow().flying()
    estimates_say(monkeypatch, **changes)
    for _ in range(250):
        _, record = flow.tick()
    assert record.supervision.left == reason


def test_a_vehicle_is_not_taken_while_its_position_becomes_uncertain(monkeypatch: pytest.MonkeyPatch) -> None:
    flow = Flow()
    for _ in range(20):
        flow.tick()
    estimates_say(monkeypatch, quality=Quality(variance_grows=True))
    flow.request = ENGAGE
    for _ in range(30):
        _, record = flow.tick()
    assert record.conditions.estimate_worsens
    assert record.supervision.state is State.PILOT
