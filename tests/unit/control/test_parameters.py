from dataclasses import replace
from math import inf, nan, pi, radians
from pathlib import Path

import pytest
import yaml

from daemon.control.parameters import AttitudeLaw, ControlParameters, HeadingAxis, from_airframe, mavros_controllers
from daemon.guidance.parameters import GuidanceParameters

CONFIGURATION = Path(__file__).parents[3] / "config" / "default.yaml"


@pytest.mark.parametrize(
    "bad",
    [
        {"hover_thrust": 0.0},
        {"hover_thrust": nan},
        {"position_gain_1_s2": (1.0, -1.0, 1.0)},
        {"position_gain_1_s2": (1.0, inf, 1.0)},
        {"attitude_time_constant_s": (0.1, 0.0, 0.1)},
        {"tilt_max_rad": 1.6},
        {"thrust_min": 0.9, "thrust_max": 0.5},
        {"vertical_thrust_min_m_s2": 0.0},
    ],
)
def test_number_without_sense_is_refused_by_name(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="control parameter"):
        replace(ControlParameters(), **bad)


def test_airframe_of_the_default_lag_has_the_default_gains() -> None:
    default, derived = ControlParameters(), from_airframe(0.5, 0.055)
    assert derived.position_gain_1_s2 == pytest.approx(default.position_gain_1_s2)
    assert derived.velocity_gain_1_s == pytest.approx(default.velocity_gain_1_s)
    assert derived.attitude_time_constant_s == pytest.approx(default.attitude_time_constant_s, rel=0.03)


def test_slower_airframe_keeps_the_damping() -> None:
    quick, slow = from_airframe(0.5, 0.04), from_airframe(0.5, 0.08)
    for p in (quick, slow):
        assert p.velocity_gain_1_s[0] / p.position_gain_1_s2[0] ** 0.5 == pytest.approx(3.2 / 5.0**0.5)
    assert slow.position_gain_1_s2[0] == pytest.approx(quick.position_gain_1_s2[0] / 4.0)


@pytest.mark.parametrize(
    "good",
    [
        {"hover_thrust": 0.01},
        {"hover_thrust": 0.99},
        {"thrust_curve": 1.0},
        {"gravity_m_s2": 1.6},
        {"attitude_time_constant_s": (0.01, 0.01, 0.01)},
        {"hover_time_constant_s": inf},
        {"approach_max_m_s": inf, "feedback_max_m_s2": inf},
        {"hover_range": 0.99},
        {"tilt_max_rad": radians(85.0)},
        {"tilt_max_rad": 0.01},
        {"thrust_min": 0.0, "thrust_max": 1.0},
        {"vertical_thrust_min_m_s2": 0.1},
        {"rate_slew_max_rad_s2": 0.1, "thrust_slew_max_1_s": 0.1},
        {"drag_1_s": (-0.5, -0.5, -2.0)},
        {"linear_thrust": (0.05, -0.1)},
        {"position_gain_1_s2": (0.0, 0.0, 9999.0)},
        {"rate_lag_s": (0.0, 0.0, 0.0)},
    ],
)
def test_number_at_the_edge_of_its_sense_is_taken(good: dict[str, object]) -> None:
    parameters = replace(ControlParameters(), **good)  # type: ignore[arg-type]
    assert all(getattr(parameters, name) == value for name, value in good.items())


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("hover_thrust", 1.0),
        ("thrust_curve", 1.01),
        ("gravity_m_s2", 1.0),
        ("attitude_time_constant_s", (0.1, 0.1, 0.0)),
        ("hover_time_constant_s", 0.0),
        ("hover_range", 1.0),
        ("tilt_max_rad", 0.0),
        ("tilt_max_rad", radians(85.1)),
        ("thrust_min", -0.01),
        ("thrust_max", 1.01),
        ("thrust_max", 0.08),
        ("vertical_thrust_min_m_s2", 0.0),
        ("rate_slew_max_rad_s2", 0.0),
        ("thrust_slew_max_1_s", 0.0),
        ("drag_1_s", (0.0, -10001.0, 0.0)),
        ("linear_thrust", (0.05, nan)),
        ("position_gain_1_s2", (0.0, 0.0, 10000.0)),
        ("velocity_gain_1_s", (0.0, 0.0, -0.1)),
        ("rate_max_rad_s", inf),
        ("approach_max_m_s", nan),
        ("approach_max_m_s", -1.0),
        ("feedback_max_m_s2", 2e4),
        ("hover_time_constant_s", -1.0),
        ("tilt_max_rad", -0.1),
    ],
)
def test_number_beyond_the_edge_is_refused_by_its_own_name(name: str, bad: object) -> None:
    with pytest.raises(ValueError, match=f"^control parameter {name} is out of range$"):
        replace(ControlParameters(), **{name: bad})  # type: ignore[arg-type]


def test_defaults_are_those_of_the_default_configuration() -> None:
    """Angles are degrees there, rounded; ``velocity_yaw`` is flown by guidance."""
    written = yaml.safe_load(CONFIGURATION.read_text())["control"]
    assert written.pop("velocity_yaw") is GuidanceParameters().velocity_yaw
    default = ControlParameters()
    compared = 0
    for key, value in written.items():
        for degrees, radian in (("_deg_s2", "_rad_s2"), ("_deg_s", "_rad_s"), ("_deg", "_rad")):
            if key.endswith(degrees):
                in_radians = getattr(default, key.removesuffix(degrees) + radian)
                assert in_radians == pytest.approx(radians(value), rel=0.02), key
                compared += 1
                break
        else:
            here = getattr(default, key)
            if value is not None:
                here = here.value if isinstance(here, AttitudeLaw) else here
                assert here == (tuple(value) if isinstance(value, list) else value), key
                compared += 1
    assert compared > 20


def test_a_small_quadrotor_hovers_at_half_thrust_until_it_is_known_better() -> None:
    """What the configuration does not set: the hover thrust of a PX4 that was never tuned, and what is learned."""
    p = ControlParameters()
    assert p.hover_thrust == 0.5, "MPC_THR_HOVER"
    assert p.gravity_m_s2 == 9.80665, "standard gravity"
    assert (p.hover_time_constant_s, p.hover_range, p.hover_tilt_max_rad) == (3.0, 0.5, radians(15.0))
    assert p.linear_thrust is None and not (p.original_gain or p.original_drag) and p.heading_axis is HeadingAxis.NOSE
    assert (p.heading_error_max_rad, p.vertical_thrust_min_m_s2) == (0.5, 3.0)


def test_the_original_flies_its_published_numbers() -> None:
    """Kp 8, 8, 10; Kv 1.5, 1.5, 3.3; attctrl_constant 0.1; thrust 0.05 a + 0.1: the launch file's."""
    p = mavros_controllers()
    assert (p.position_gain_1_s2, p.velocity_gain_1_s) == ((8.0, 8.0, 10.0), (1.5, 1.5, 3.3))
    assert (p.attitude_time_constant_s, p.linear_thrust) == ((0.1, 0.1, 0.1), (0.05, 0.1))
    assert p.original_gain and p.original_drag and p.heading_axis is HeadingAxis.LATERAL
    assert not (p.rate_feed_forward or p.lag_compensation)
    assert (p.velocity_bias_bandwidth_rad_s, p.disturbance_bandwidth_rad_s) == (0.0, 0.0)
    assert (p.hover_time_constant_s, p.approach_max_m_s, p.heading_error_max_rad) == (inf, inf, pi)
    assert (p.thrust_min, p.thrust_max) == (0.0, 1.0)
    assert p.rate_max_rad_s == p.yaw_rate_max_rad_s == 20.0, "PX4 takes no more"


def test_airframe_gives_each_loop_its_own_lag() -> None:
    p = from_airframe(0.4, 0.11, drag_1_s=(0.1, 0.2, 0.3))
    assert p.rate_lag_s == pytest.approx((0.11, 0.11, 5.6 * 0.11))
    assert p.attitude_time_constant_s == pytest.approx((2.7 * 0.11, 2.7 * 0.11, 2.3 * 5.6 * 0.11))
    assert (p.hover_thrust, p.drag_1_s) == (0.4, (0.1, 0.2, 0.3))
    default = ControlParameters()
    assert p.position_gain_1_s2 == pytest.approx(tuple(k / 4.0 for k in default.position_gain_1_s2))
    assert p.velocity_gain_1_s == pytest.approx(tuple(k / 2.0 for k in default.velocity_gain_1_s))
    assert p.disturbance_bandwidth_rad_s == pytest.approx(default.disturbance_bandwidth_rad_s / 2.0)
    known = from_airframe(0.4, 0.11, yaw_rate_lag_s=0.2)
    assert known.drag_1_s == (0.0, 0.0, 0.0)
    assert known.rate_lag_s[2] == 0.2 and known.attitude_time_constant_s[2] == pytest.approx(0.46)
