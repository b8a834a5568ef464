import json
from dataclasses import replace
from math import degrees
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tuning import MadeUp, made_up

from daemon.config import load
from daemon.control.identification import margins
from daemon.parameters import control_parameters
from daemon.tuning import result
from daemon.tuning.measurement import Measured, Quantity, measure
from daemon.tuning.picture import picture
from daemon.tuning.proposal import PHASE_MIN_RAD, as_yaml, propose, thrust_curve


@pytest.fixture(scope="module")
def measured() -> Measured:
    return measure(made_up(MadeUp()))


def test_the_file_loads_and_flies_what_was_proposed(measured: Measured, tmp_path: Path) -> None:
    proposal = propose(measured, load([]))
    file = tmp_path / "mine.yaml"
    file.write_text(as_yaml(proposal, "mine"))
    flown = control_parameters(load([file]), None)
    assert flown.hover_thrust == pytest.approx(measured.thrust.hover_thrust.value, abs=1e-4)
    assert flown.rate_lag_s == pytest.approx((0.055, 0.06, 0.3), rel=0.06)
    assert flown.position_gain_1_s2 == pytest.approx(proposal.parameters.position_gain_1_s2, abs=1e-4)
    assert flown.attitude_time_constant_s == pytest.approx(proposal.parameters.attitude_time_constant_s, abs=1e-4)
    assert flown.tilt_max_rad == control_parameters(load([]), None).tilt_max_rad


def test_what_is_not_measured_stays_as_configured(measured: Measured) -> None:
    config = load([], {"control": {"drag_1_s": [0.3, 0.3, 0.1], "tilt_max_deg": 25.0, "thrust_lag_s": 0.1}})
    unsharp = replace(measured, thrust=replace(measured.thrust, total_s=Quantity(0.07, 0.05)))
    parameters = propose(unsharp, config).parameters
    assert parameters.drag_1_s == (0.3, 0.3, 0.1)
    assert degrees(parameters.tilt_max_rad) == pytest.approx(25.0)
    assert parameters.thrust_lag_s == 0.1


def late(measured: Measured, dead_time_s: float) -> Measured:
    dead = Quantity(dead_time_s, 0.001)
    return replace(
        measured, roll=replace(measured.roll, dead_time_s=dead), pitch=replace(measured.pitch, dead_time_s=dead)
    )


def test_a_long_dead_time_slows_the_gains_until_the_margin_is_there(measured: Measured) -> None:
    quick, slow = propose(late(measured, 0.02), load([])), propose(late(measured, 0.1), load([]))
    assert quick.slowed == 1.0 < slow.slowed
    assert slow.parameters.position_gain_1_s2[0] < quick.parameters.position_gain_1_s2[0]
    assert slow.parameters.rate_lag_s == quick.parameters.rate_lag_s
    flown = margins(slow.parameters, rate_lag_s=0.0575, unpredicted_delay_s=0.08)
    assert flown.phase_rad >= 0.9 * PHASE_MIN_RAD


def test_a_dead_time_without_any_gains_is_refused(measured: Measured) -> None:
    with pytest.raises(ValueError, match="too long"):
        propose(late(measured, 0.9), load([]))


@settings(deadline=None)
@given(st.floats(0.3, 1.0), st.floats(0.15, 0.9))
def test_the_thrust_curve_comes_back_from_its_slope(share: float, hover: float) -> None:
    def force(u: float) -> float:
        return share * u * u + (1.0 - share) * u

    slope = hover * (force(hover + 1e-6) - force(hover - 1e-6)) / 2e-6 / force(hover)
    assert thrust_curve(slope, hover) == pytest.approx(share, abs=1e-3)


@pytest.mark.parametrize("slope", [0.6, 0.9, 1.0, 1.05])
def test_a_slope_near_that_of_a_linear_rotor_counts_as_linear(slope: float) -> None:
    assert thrust_curve(slope, 0.5) == 0.0


def test_result_as_table_and_as_json(measured: Measured) -> None:
    proposal = propose(measured, load([]))
    told = json.loads(json.dumps(result.as_dict(measured, proposal), allow_nan=False))
    assert told["roll"]["sum_s"]["value"] == pytest.approx(0.085, abs=0.006)
    assert told["config"]["control"]["hover_thrust"] == pytest.approx(0.55, abs=0.002)
    assert told["margins"]["gain"] is None
    shown = "\n".join(result.lines(measured, proposal))
    assert "hovers at 0.5" in shown and "phase" in shown


def test_the_picture_is_a_png(measured: Measured) -> None:
    drawn = picture(measured, propose(measured, load([])), "mine")
    assert drawn.startswith(b"\x89PNG") and len(drawn) > 20_000
