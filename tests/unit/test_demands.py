"""What a configuration demands of the thrust, in figures worked out by hand."""

from pathlib import Path

import pytest

from daemon import demands
from daemon.config import ConfigError, load, with_value
from daemon.settings import Config

DEFAULT = load([])


def config(**control: float) -> Config:
    return load([], {"control": control})


def rooms(found: tuple[demands.Demand, ...]) -> list[float]:
    return [demand.room for demand in found]


def test_hover_keeps_a_tenth_of_the_weight_below_and_above() -> None:
    found = demands.hover(config(thrust_min=0.3, thrust_max=0.9).control, 0.6)
    assert rooms(found) == pytest.approx([0.9 - 0.3 / 0.6, 0.9 / 0.6 - 1.1])


def test_hover_of_a_curved_thrust_is_judged_by_force() -> None:
    """Square: 0.4 gives 0.16 of the force, 0.5 gives 0.25, 0.6 gives 0.36."""
    found = demands.hover(config(thrust_min=0.4, thrust_max=0.6, thrust_curve=1.0).control, 0.5)
    assert rooms(found) == pytest.approx([0.9 - 0.16 / 0.25, 0.36 / 0.25 - 1.1])


def test_motion_keeps_the_same_tenth_below_and_above_what_the_limits_allow() -> None:
    """Limits of 3 sideways and 2 vertically: 7.8 m/s2 down, and 3 sideways with 11.8 up, spare 0.98 m/s2 each."""
    g = 9.80665
    found = demands.motion(config(thrust_min=0.2).control, DEFAULT.guidance.limits, 0.5)
    assert rooms(found) == pytest.approx(
        [
            (0.9 * g - 2.0 - 3.0) / g,
            (0.9 * g - 2.0 - 0.4 * g) / g,
            (1.9 * g - (3.0**2 + (1.1 * g + 2.0) ** 2) ** 0.5) / g,
        ]
    )


def test_what_is_not_met_is_told_once_and_required() -> None:
    found = (demands.Demand(-0.1, "a"), demands.Demand(0.0, "b"), demands.Demand(-0.2, "a"), demands.Demand(-0.1, "c"))
    assert demands.unmet(found) == ["a", "c"]
    with pytest.raises(ValueError, match=r"^a$"):
        demands.require(found)
    demands.require(found[1:2])


@pytest.mark.parametrize(
    ("path", "value", "taken"),
    [
        ("guidance.limits.speed_m_s", 1.0, True),
        ("control.thrust_max", 1.0, True),
        ("control.thrust_max", 0.94, False),
        ("control.thrust_min", 0.2, True),
        ("guidance.limits.vertical_acceleration_m_s2", 1.0, True),
        ("guidance.limits.vertical_acceleration_m_s2", 2.1, False),
    ],
)
def test_a_vehicle_with_too_little_thrust_is_refused_only_what_makes_it_less(
    path: str, value: float, taken: bool
) -> None:
    after = with_value(DEFAULT, path, value)
    if taken:
        demands.require_no_worse(DEFAULT, after, 0.9)
    else:
        with pytest.raises(ValueError, match=path.rsplit(".", 1)[-1]):
            demands.require_no_worse(DEFAULT, after, 0.9)
    demands.require_no_worse(DEFAULT, after, 0.5)


@pytest.mark.parametrize(
    ("limits", "control", "reason"),
    [
        ({"vertical_acceleration_m_s2": 8.0}, {}, r"vertical_acceleration_m_s2 8 falls quicker"),
        (
            {"vertical_acceleration_m_s2": 3.0},
            {"thrust_min": 0.35},
            r"_m_s2 3 needs less than control\.thrust_min 0\.35",
        ),
        (
            {"vertical_acceleration_m_s2": 4.0},
            {"hover_thrust": 0.78},
            r"_m_s2 4 with guidance\.limits\.acceleration_m_s2 3 needs more than control\.thrust_max 0\.95 .* 0\.78",
        ),
        (
            {"acceleration_m_s2": 6.8, "vertical_acceleration_m_s2": 5.0, "speed_m_s": 10.0},
            {},
            r"6\.8 with vertical_acceleration_m_s2 5 down needs 54\.7 deg of tilt: control\.tilt_max_deg is 35",
        ),
    ],
)
def test_limits_that_no_thrust_and_no_tilt_can_fly_are_refused_with_keys_and_reason(
    limits: dict[str, float], control: dict[str, float], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        load([], {"control": control, "guidance": {"limits": limits}})


@pytest.mark.parametrize("name", ["sim", "sitl", "x500"])
def test_the_shipped_files_are_taken(name: str) -> None:
    load([Path(name)])
