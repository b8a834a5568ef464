"""What one part sets of the flow's parameters, the others keep."""

import pytest

from daemon.config import load, with_value
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.loops.flown_parameters import FlownParameters
from daemon.messages import FrameShift
from daemon.parameters import geofence

CONFIG = load([])
PLACED = geofence(CONFIG, (30.0, -20.0, 1.0))
SHIFT = FrameShift(position_ned_m=(30.0, -20.0, 1.0), count=3)


def flown() -> FlownParameters:
    parameters = FlownParameters(CONFIG)
    parameters.take_hover(0.6)
    parameters.place_fence(PLACED, SHIFT)
    return parameters


def kept(parameters: FlownParameters) -> None:
    now = parameters.cell.value
    assert (now.control.hover_thrust, now.bounds.fence, now.fence_shift) == (0.6, PLACED, SHIFT)


def test_another_configuration_keeps_the_hover_thrust_of_the_autopilot_and_the_place_of_the_fence() -> None:
    parameters = flown()
    config = with_value(with_value(CONFIG, "control.feedback_max_m_s2", 4.0), "guidance.profile", "reference_filter")
    parameters.set_config(config, 0.6)
    kept(parameters)
    assert parameters.config is config
    assert parameters.cell.value.control.feedback_max_m_s2 == 4.0
    assert parameters.guidance.profile is Profile.REFERENCE_FILTER


def test_a_hover_thrust_that_is_taken_keeps_configuration_and_fence() -> None:
    parameters = flown()
    parameters.set_config(with_value(CONFIG, "control.feedback_max_m_s2", 4.0), 0.6)
    parameters.take_hover(0.55)
    assert parameters.hover_thrust == 0.55
    assert parameters.cell.value.control.feedback_max_m_s2 == 4.0
    parameters.take_hover(0.6)
    kept(parameters)


def test_a_fence_that_stays_where_it_is_writes_nothing() -> None:
    parameters = flown()
    version = parameters.cell.version
    parameters.place_fence(PLACED, SHIFT)
    assert parameters.cell.version == version
    parameters.place_fence(PLACED, FrameShift(count=4))
    assert parameters.cell.value.fence_shift.count == 4 and parameters.cell.value.bounds.fence is PLACED
    kept_hover = parameters.cell.value.control.hover_thrust
    assert kept_hover == 0.6


def test_a_configuration_that_takes_the_thrust_away_changes_nothing() -> None:
    parameters = flown()
    before = parameters.cell.value
    with pytest.raises(ValueError, match=r"thrust_max 0\.7 leaves less than a tenth about the 0\.65"):
        parameters.set_config(with_value(CONFIG, "control.thrust_max", 0.7), 0.65)
    assert parameters.config is CONFIG and parameters.cell.value is before


def test_too_little_thrust_is_told_by_what_hovers_and_by_what_flies() -> None:
    parameters = flown()
    assert parameters.cannot_hover() == parameters.cannot_fly() == []
    parameters.take_hover(0.8)
    assert parameters.cannot_hover() == []
    assert [text.split()[0] for text in parameters.cannot_fly()] == ["guidance.limits.vertical_acceleration_m_s2"]
    parameters.take_hover(0.88)
    assert len(parameters.cannot_hover()) == 1 and len(parameters.cannot_fly()) == 2


def test_guidance_has_the_defaults_of_the_configuration() -> None:
    """What is made without a configuration flies as the daemon does."""
    parameters = FlownParameters(load([]))
    assert parameters.guidance == GuidanceParameters()
    assert parameters.cell.value.limits == MotionLimits()
