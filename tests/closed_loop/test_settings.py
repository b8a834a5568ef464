"""Settings that are changed in flight: what may be, how it is refused, and that the vehicle stays on its path."""

from typing import Any

import pytest
from pydantic import BaseModel
from support.flight import CALLER, Flight, fly

from daemon.config import describe, load, value_at
from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import ConfigGet, ConfigSet

MODES = {"control.attitude_law": ["jerk", "geometric"], "guidance.profile": ["jerk_limited", "reference_filter"]}


def paths(section: BaseModel, above: str = "") -> list[str]:
    found: list[str] = []
    for key in type(section).model_fields:
        value = getattr(section, key)
        found += paths(value, f"{above}{key}.") if isinstance(value, BaseModel) else [f"{above}{key}"]
    return found


def test_gains_and_limits_may_be_set_in_flight_and_of_the_modes_those_that_are_flown_here() -> None:
    config = load([])
    for path in paths(config):
        setting, value = describe(path), value_at(config, path)
        has_range = setting["min"] is not None and setting["max"] is not None
        if setting["settable"]:
            assert path in MODES or (has_range and isinstance(value, float | list)), path


@pytest.mark.parametrize(
    ("path", "value", "code", "field", "reason"),
    [
        ("guidance.damping", "high", -32602, "value", "must be a number, not a string"),
        ("guidance.damping", True, -32602, "value", "must be a number, not true"),
        ("guidance.damping", [1.0], -32602, "value", "must be a number, not a list"),
        ("control.drag_1_s", 1.0, -32602, "value", "must be a list, not a number"),
        ("control.drag_1_s", [1.0, 1.0], -32602, "value[2]", "is missing"),
        ("control.drag_1_s", [1.0] * 4, -32602, "value", "must have at most 3 items, not 4"),
        ("control.attitude_law", "best", -32602, "value", 'must be "quaternion", "geometric" or "jerk"'),
        ("guidance.limits.speed_m_s", 50.0, -32001, "value", "50 is not within 0.1 to 25 m/s"),
        ("control.thrust_min", 0.9, -32001, "value", "0.9 is not within 0 to 0.5"),
        ("control.drag_1_s", [0.0, 0.0, 9.0], -32001, "value", "9 is not within 0 to 5 1/s"),
        ("control.velocity_yaw", True, -32001, "path", None),
        ("log.level", "debug", -32001, "path", None),
        ("control.drag", 1.0, -32001, "path", "there is no setting 'control.drag'; did you mean control.drag_1_s?"),
        ("guidance.limits.x", 1.0, -32001, "path", "there is no setting 'guidance.limits.x'"),
        (
            "guidance",
            1.0,
            -32001,
            "path",
            "guidance is a section; its keys are profile, natural_frequency_rad_s, damping, max_distance_m, "
            "deviation_max_m, limits",
        ),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_code_field_and_reason(
    path: str, value: Any, code: int, field: str, reason: str | None
) -> None:
    async def scenario(flight: Flight) -> None:
        before = flight.vehicle.config
        with pytest.raises(ProtocolError) as error:
            await flight.service.config_set(ConfigSet(path=path, value=value), CALLER)
        assert (error.value.code, error.value.field) == (code, field), error.value
        assert reason is None or error.value.reason == reason
        assert flight.vehicle.config is before

    fly(scenario)


def test_gains_that_swing_are_refused_as_a_value() -> None:
    async def scenario(flight: Flight) -> None:
        swinging = ConfigSet(path="control.position_gain_1_s2", value=[50.0, 50.0, 50.0])
        with pytest.raises(ProtocolError, match=r"^value: position_gain_1_s2 50 .* swing") as error:
            await flight.service.config_set(swinging, CALLER)
        assert error.value.code is ErrorCode.REFUSED

    fly(scenario)


def test_what_has_no_unit_says_null() -> None:
    async def scenario(flight: Flight) -> None:
        setting = await flight.service.config_get(ConfigGet(path="guidance.damping"), CALLER)
        assert setting["unit"] is None

    fly(scenario)


@pytest.mark.parametrize("path", list(MODES))
def test_a_mode_that_is_switched_in_flight_does_not_disturb_it(path: str) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        circle = {"kind": "circle", "center": [0, 0, -6], "radius_m": 3, "speed_m_s": 2, "turns": 3}
        goal_id = await flight.submit(trajectory=circle)
        await flight.until(lambda: flight.vehicle.trajectory.progress is not None)
        for mode in MODES[path]:
            since_s = flight.now_s
            await flight.until(lambda since_s=since_s: flight.now_s - since_s > 6.0)  # type: ignore[misc]
            setting = await flight.service.config_set(ConfigSet(path=path, value=mode), CALLER)
            assert setting["value"] == mode
        entry = await flight.result(goal_id)
        assert entry.outcome == "succeeded"
        errors = [r.control.position_error_ned_m for r in flight.records if r.control and r.reference]
        assert max(max(map(abs, error)) for error in errors) < 0.3

    fly(scenario)
