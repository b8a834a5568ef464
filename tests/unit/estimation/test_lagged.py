from dataclasses import replace

import numpy as np
import pytest

from daemon.estimation import ekf
from daemon.estimation.filter_base import FilterParameters, Measurement, initial
from daemon.estimation.filter_control import AccelerationControl, ControlParameters
from daemon.estimation.lagged import LaggedState, take

PARAMETERS = FilterParameters(predictor=ekf.predict, control=ControlParameters())


def position(k, stamp_s=None, rng=None):
    values = np.array((0.1 * k, 0.0, -1.0)) + (0.0 if rng is None else 0.05 * rng.normal(size=3))
    return Measurement(0.02 * k if stamp_s is None else stamp_s, (0, 1, 2), values, 0.01 * np.eye(3), 8.0, f"m{k}")


def with_control(lagged, k):
    control = AccelerationControl(0.02 * k, (0.3 * np.sin(k), 0.1, -0.2))
    return replace(lagged, state=replace(lagged.state, control=control))


def run(order, messages, history_s=1.0, control_of=None):
    """Messages by index in the order of arrival; the control term steps with each one below 1000."""
    lagged = LaggedState(initial(PARAMETERS))
    records = []
    for k in order:
        known = (control_of or {}).get(k, k)
        if known < 1000:
            lagged = with_control(lagged, known)
        lagged, more = take(lagged, messages[k], PARAMETERS, history_s)
        records.append(more)
    return lagged, records


@pytest.mark.parametrize("arrival", [6, 10, 19])
def test_a_late_measurement_ends_in_the_state_that_it_had_made_in_time(arrival):
    rng = np.random.default_rng(2)
    messages = {k: position(k, rng=rng) for k in range(20)}
    messages[1005] = replace(position(5, stamp_s=0.105, rng=rng), source="late")
    # what was flown between the messages 5 and 6 is the control that came with message 6
    in_time, _ = run([*range(6), 1005, *range(6, 20)], messages, control_of={1005: 6 if arrival > 6 else 5})
    late, records = run([*range(arrival), 1005, *range(arrival, 20)], messages)
    np.testing.assert_allclose(late.state.x, in_time.state.x, atol=1e-12)
    np.testing.assert_allclose(late.state.P, in_time.state.P, atol=1e-12)
    assert late.state.stamp_s == in_time.state.stamp_s
    assert [r.source for r in records[arrival]] == ["late", *(f"m{k}" for k in range(6, arrival))]


def test_replay_uses_the_controls_of_the_time():
    rng = np.random.default_rng(3)
    messages = {k: position(k, rng=rng) for k in range(12)}
    harmless = replace(messages[4], stamp_s=0.081, covariance=1e12 * np.eye(3), source="late")
    without, _ = run(range(12), messages)
    withit, _ = take(with_control(without, 12), harmless, PARAMETERS, 1.0)
    np.testing.assert_allclose(withit.state.x, without.state.x, atol=1e-4)  # one step became two
    assert withit.state.control == with_control(without, 12).state.control


def test_older_than_the_history_is_refused_by_name():
    messages = {k: position(k) for k in range(20)}
    messages[1000] = position(3, stamp_s=0.05)
    lagged, records = run([*range(20), 1000], messages, history_s=0.1)
    assert [r.refused for r in records[-1]] == ["too_old"]
    assert len(lagged.history) == 6  # 0.1 s back at 0.02 s, the newest included


@pytest.mark.parametrize("stamp_s", [float("nan"), float("-inf")])
def test_a_stamp_that_is_none_is_refused(stamp_s):
    messages = {k: position(k) for k in range(3)}
    messages[1000] = position(3, stamp_s=stamp_s)
    lagged, records = run([0, 1, 2, 1000], messages)
    assert records[-1][0].refused == "stamp"
    assert len(lagged.history) == 3


def test_a_refused_measurement_gets_its_second_chance_when_an_earlier_one_arrives():
    """A jump is refused by the gate; the late message from before it shows that the vehicle did move."""
    first = replace(position(0), mahalanobis_threshold=np.inf)
    far = Measurement(0.04, (0, 1, 2), np.array((3.0, 0.0, -1.0)), 0.01 * np.eye(3), 8.0, "far")
    between = Measurement(0.02, (0, 1, 2), np.array((3.0, 0.0, -1.0)), 1e-6 * np.eye(3), np.inf, "between")
    lagged, records = run([0, 1000, 1001], {0: first, 1000: far, 1001: between})
    assert records[1][0].refused == "mahalanobis"
    assert [(r.source, r.refused) for r in records[2]] == [("between", None), ("far", None)]
    assert lagged.state.x[0] > 1.0
