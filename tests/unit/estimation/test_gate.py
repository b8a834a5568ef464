from math import exp, inf, nan, pi, sqrt

import pytest

from daemon.estimation import gate
from daemon.estimation.gate import Counts, GateParameters, Refusal, Sample
from daemon.messages import MavFrame

PARAMETERS = GateParameters()


def test_a_good_message_passes_as_it_is(message):
    sample = gate.read(message(position_m=(1.0, 2.0, -3.0), velocity_m_s=(0.1, 0.2, 0.3)), parameters=PARAMETERS)
    assert isinstance(sample, Sample)
    assert sample.position_ned_m == (1.0, 2.0, -3.0)
    assert sample.velocity_ned_m_s == (0.1, 0.2, 0.3)
    assert sample.position_variance_m2 == 0.08
    assert sample.reset_counter == 11


@pytest.mark.parametrize("field", ["position_m", "velocity_m_s", "rates_frd_rad_s"])
@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_numbers_that_are_not_finite_are_refused(message, field, bad):
    assert gate.read(message(**{field: (0.0, bad, 0.0)}), parameters=PARAMETERS) is Refusal.NOT_FINITE


def test_opposite_infinities_do_not_cancel(message):
    mad = message(position_m=(inf, 0.0, 0.0), velocity_m_s=(-inf, 0.0, 0.0))
    assert gate.read(mad, parameters=PARAMETERS) is Refusal.NOT_FINITE


def test_an_arrival_that_is_not_finite_is_refused(message):
    assert gate.read(message(arrival_s=nan), parameters=PARAMETERS) is Refusal.NOT_FINITE


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.0, 0.0), (0.9, 0.0, 0.0, 0.0), (1.0, 0.5, 0.0, 0.0)])
def test_an_attitude_that_is_no_rotation_is_refused(message, attitude):
    assert gate.read(message(attitude_wb=attitude), parameters=PARAMETERS) is Refusal.QUATERNION_NORM


def test_rounding_of_the_attitude_is_taken_out(message):
    sample = gate.read(message(attitude_wb=(0.999349, 0.0280279, 0.014491, 0.0175034)), parameters=PARAMETERS)
    assert isinstance(sample, Sample)
    assert sum(v * v for v in sample.attitude_wb) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(("frame", "child"), [(0, 1), (8, 1), (20, 1), (1, 0), (1, 8), (1, 20), (1, 99)])
def test_an_unknown_frame_is_refused(message, frame, child):
    refused = gate.read(message(frame_id=frame, child_frame_id=child), parameters=PARAMETERS)
    assert refused is Refusal.UNKNOWN_FRAME


def test_a_velocity_in_the_body_is_turned_into_the_world(message):
    east = (sqrt(0.5), 0.0, 0.0, sqrt(0.5))  # heading 90 degrees: forward is east, right is south
    sample = gate.read(
        message(child_frame_id=MavFrame.BODY_FRD, attitude_wb=east, velocity_m_s=(3.0, 1.0, 0.5)),
        parameters=PARAMETERS,
    )
    assert isinstance(sample, Sample)
    assert sample.velocity_ned_m_s == pytest.approx((-1.0, 3.0, 0.5))


@pytest.mark.parametrize(
    "change",
    [
        {"position_m": (1e300, 1e300, 1e300)},
        {"position_m": (0.0, 0.0, 2e5)},
        {"velocity_m_s": (50.0, 50.0, 0.0)},
        {"rates_frd_rad_s": (0.0, 20 * pi, 0.0)},
    ],
)
def test_numbers_out_of_physical_range_are_refused(message, change):
    assert gate.read(message(**change), parameters=PARAMETERS) is Refusal.OUT_OF_RANGE


@pytest.mark.parametrize("variance", [(nan, nan, nan), (0.1, nan, 0.1), (-1.0, 0.1, 0.1), (0.1, 0.1, nan)])
def test_an_unknown_variance_counts_as_infinite(variance):
    assert gate.largest_variance_m2(variance) == inf


def test_refusals_are_counted_by_reason_and_fade():
    counts = gate.counted(Counts(), Refusal.NOT_FINITE, 100.0, parameters=PARAMETERS)
    counts = gate.counted(counts, Refusal.NOT_FINITE, 110.0, parameters=PARAMETERS)
    counts = gate.counted(counts, Refusal.OUT_OF_RANGE, 110.0, parameters=PARAMETERS)
    values = gate.decayed(counts, 120.0, parameters=PARAMETERS)
    assert values[Refusal.NOT_FINITE] == pytest.approx(exp(-2.0) + exp(-1.0))
    assert values[Refusal.OUT_OF_RANGE] == pytest.approx(exp(-1.0))
    assert sum(values) == pytest.approx(exp(-2.0) + 2.0 * exp(-1.0))
