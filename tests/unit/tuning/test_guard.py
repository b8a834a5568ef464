"""The guard permits pulses tick by tick, and takes the permission back for good."""

from math import cos, radians, sin
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.config import load
from daemon.messages import EstimatedState, Reference
from daemon.safety.supervision import Drive
from daemon.safety.supervisor import State
from daemon.tuning.experiment import Guard, gentle

NEVER = float("-inf")


class Permissions:
    def __init__(self) -> None:
        self.until_s = NEVER

    def permit(self, until_s: float) -> None:
        self.until_s = until_s


def tick(
    guard: Guard,
    now_s: float,
    *,
    state: State = State.HOLDING,
    drive: Drive = Drive.LAW,
    off_m: float = 0.1,
    tilt_deg: float = 5.0,
    estimate: bool = True,
) -> None:
    attitude = (cos(radians(tilt_deg) / 2.0), sin(radians(tilt_deg) / 2.0), 0.0, 0.0)
    newest = EstimatedState(now_s - 0.012, (off_m, 0.0, -5.0), (0.0, 0.0, 0.0), attitude, (0.0, 0.0, 0.0))
    record: Any = SimpleNamespace(
        now_s=now_s,
        supervision=SimpleNamespace(state=state, reason="why"),
        drive=drive,
        estimate=SimpleNamespace(newest=newest if estimate else None),
        reference=Reference(now_s, (0.0, 0.0, -5.0)),
    )
    inputs: Any = SimpleNamespace(odometry=SimpleNamespace(arrival_s=now_s - 0.002))
    guard.on_tick(inputs, record)


@pytest.fixture
def permissions() -> Permissions:
    return Permissions()


@pytest.fixture
def guard(permissions: Permissions) -> Guard:
    watching: Any = permissions
    made = Guard(watching)
    made.watching = True
    return made


def test_while_all_is_well_the_next_tick_is_permitted_and_no_more(guard: Guard, permissions: Permissions) -> None:
    tick(guard, 10.0)
    assert 10.01 < permissions.until_s < 10.05
    assert guard.objection is None


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"state": State.RELEASING}, "releasing"),
        ({"state": State.PILOT}, "pilot"),
        ({"state": State.TRACKING}, "tracking"),
        ({"off_m": 2.1}, "2.1 m off"),
        ({"off_m": float("nan")}, "off"),
        ({"tilt_deg": 21.0}, "tilts by 21 deg"),
        ({"estimate": False}, "no estimate"),
    ],
)
def test_an_objection_ends_the_pulses_for_good(
    guard: Guard, permissions: Permissions, wrong: dict[str, Any], words: str
) -> None:
    tick(guard, 10.0)
    tick(guard, 10.01, **wrong)
    assert permissions.until_s == NEVER
    tick(guard, 10.02)
    assert permissions.until_s == NEVER
    assert guard.objection is not None and words in guard.objection


def test_just_within_the_bounds_is_well(guard: Guard, permissions: Permissions) -> None:
    tick(guard, 10.0, off_m=1.95, tilt_deg=19.5)
    assert permissions.until_s > 10.0


def test_while_the_vehicle_is_levelled_blindly_nothing_is_permitted(guard: Guard, permissions: Permissions) -> None:
    tick(guard, 10.0, drive=Drive.LEVEL)
    assert permissions.until_s == NEVER and guard.objection is None


def test_nothing_is_permitted_before_the_watch_begins(guard: Guard, permissions: Permissions) -> None:
    guard.watching = False
    tick(guard, 10.0)
    assert permissions.until_s == NEVER


def test_each_sample_is_taken_once_with_its_age(guard: Guard) -> None:
    tick(guard, 10.0)
    tick(guard, 10.01)
    assert [sample.age_s for sample in guard.samples] == pytest.approx([0.010, 0.010])


def test_pulses_are_flown_gently_on_the_estimate_of_the_autopilot() -> None:
    config = gentle(load([], {"estimator": {"kind": "ekf", "external_pose": "fused"}}))
    default = load([]).control
    assert config.estimator.kind == "autopilot"
    assert config.control.position_gain_1_s2[0] == pytest.approx(0.25 * default.position_gain_1_s2[0])
    assert config.control.velocity_gain_1_s[0] == pytest.approx(0.5 * default.velocity_gain_1_s[0])
    assert config.control.attitude_time_constant_s[0] == pytest.approx(2.0 * default.attitude_time_constant_s[0])
    assert config.control.rate_max_deg_s == default.rate_max_deg_s
