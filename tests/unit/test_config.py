"""Configuration: every bad key, type and range is refused with its path, its value and what is allowed."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from daemon import config as configuration
from daemon.config import ConfigError, describe, load, validated, value_at, with_value
from daemon.parameters import geofence, guidance_parameters, pipeline_parameters
from daemon.settings import Config

ROOT = Path(__file__).parents[2]


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "own.yaml"
    file.write_text(text)
    return file


def leaves(values: dict[str, Any], path: str = "") -> list[str]:
    found: list[str] = []
    for key, value in values.items():
        inner = f"{path}{key}"
        found += leaves(value, f"{inner}.") if isinstance(value, dict) else [inner]
    return found


def test_the_default_file_holds_every_key_with_a_comment() -> None:
    text = configuration.default_path().read_text()
    assert sorted(leaves(yaml.safe_load(text))) == sorted(leaves(load([]).model_dump()))
    for line in text.splitlines():
        if ":" in line and not line.strip().startswith("#") and not line.rstrip().endswith(":"):
            assert "#" in line, line


@pytest.mark.parametrize("file", sorted((ROOT / "config").glob("*.yaml")), ids=lambda f: f.name)
def test_each_shipped_file_is_good_and_gives_parameters(file: Path) -> None:
    config = load([file])
    parameters = pipeline_parameters(config, geofence(config, (0.0, 0.0, 0.0)))
    assert parameters.control.hover_thrust == (config.control.hover_thrust or 0.5)
    assert guidance_parameters(config).profile.value == config.guidance.profile


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("guidance:\n  limits:\n    speed_m_s: 300\n", ["guidance.limits.speed_m_s", "300", "0.1 to 25 m/s"]),
        ("gudance: 1\n", ["gudance: there is no such key; did you mean guidance?"]),
        ("control:\n  kp: 1\n", ["control.kp: there is no such key"]),
        ("link:\n  conection: a\n", ["link.conection: there is no such key; did you mean link.connection?"]),
        ("guidance:\n  speed_m_s: 3\n", ["there is no such key; did you mean guidance.limits.speed_m_s?"]),
        ("tilt_max_deg: 30\n", ["did you mean control.tilt_max_deg or safety.tilt_max_deg?"]),
        ("guidance.limits.speed_m_s: 3\n", ["no such key; write its sections as sections, one below the other"]),
        ("guidance:\n", ["guidance: must be a section of keys, not empty (leave out what does not differ)"]),
        ("guidance:\n  limits:\n    speed_m_s:\n", ["limits.speed_m_s: must be a number, not empty"]),
        ("control:\n  hover_thrust: high\n", ["control.hover_thrust: must be a number, not 'high'"]),
        ("control:\n  hover_thrust: .nan\n", ["control.hover_thrust"]),
        ("control:\n  position_gain_1_s2: [1, 2]\n", ["control.position_gain_1_s2"]),
        ("control:\n  position_gain_1_s2: [1, 2, 99]\n", ["position_gain_1_s2", "99", "0 to 50 1/s2"]),
        ("loops:\n  lock_memory: 1\n", ["loops.lock_memory: must be true or false, not 1"]),
        ("loops:\n  control_rate_hz: 1e2\n", ["must be a number, not '1e2' (YAML reads it as text: write 1.0e+2)"]),
        ("guidance: 5\n", ["guidance: must be a section of keys, not 5"]),
        ("loops:\n  realtime_priority: 1.5\n", ["realtime_priority: must be a whole number, not 1.5"]),
        ("log:\n  level: on\n", ["log.level: must be 'debug'", "not true", "write it in quotes"]),
        ("d: 2026-13-45\n", ["own.yaml: not YAML: month must be in 1..12"]),
        ("safety: {fence: {polygon_ne_m: [[1, 2, 3]]}}\n", ["polygon_ne_m.0: must have at most 2 items, not 3"]),
        ("link: {connection: 'udpin://127.0.0.1:99999'}\n", ["port 99999 is not within 1 to 65535"]),
        ("guidance:\n  profile: fastest\n", ["guidance.profile", "jerk_limited", "'fastest'"]),
        ("safety:\n  coast_s: 0.5\n", ["safety", "coast_s 0.5 is not below lost_s 0.5"]),
        ("safety:\n  fence:\n    floor_m: 200\n", ["safety.fence", "floor_m 200 is not below ceiling_m 120"]),
        ("safety:\n  fence:\n    polygon_ne_m: [[0, 0], [1, 1]]\n", ["three corners"]),
        (
            "safety:\n  fence:\n    polygon_ne_m: [[0, 0], [9, 9], [9, 0], [0, 12]]\n",
            ["safety.fence", "crosses itself"],
        ),
        ("link:\n  connection: foo://bar\n", ["link.connection", "'foo://bar'", "udpin://0.0.0.0:14540"]),
        ("link:\n  connection: udpin://127.0.0.1\n", ["link.connection"]),
        ("link:\n  connection: udpin://:14540\n", ["link.connection"]),
        ("link:\n  connection: serial:///dev/ttyAMA0\n", ["link.connection"]),
        ("link:\n  connection: serial://dev/ttyAMA0:921600\n", ["link.connection", "serial:///dev/ttyAMA0:921600"]),
        ("- a\n", ["own.yaml", "sections"]),
        ("a: [\n", ["own.yaml: not YAML: line 2, column 1: expected the node content"]),
        (
            "safety:\n  fence: {radius_m: 30}\nlog: {level: info}\nsafety:\n  coast_s: 0.1\n",
            ["own.yaml: not YAML: line 4, column 1: the key safety is there already, in line 1"],
        ),
        ("log:\n  level: info\n  level: debug\n", ["line 3, column 3: the key level is there already, in line 2"]),
    ],
)
def test_a_bad_file_is_refused_in_words(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        load([written(tmp_path, text)])
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    "url",
    [
        "udp://:14540",
        "udpout://px4.local:14540",
        "tcpin://0.0.0.0:5760",
        "tcp://10.0.0.1:5760",
        "serial:///dev/tty0:9600",
    ],
)
def test_each_kind_of_connection_is_taken(url: str) -> None:
    assert load([], {"link": {"connection": url}}).link.connection == url


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as error:
        load([written(tmp_path, "loops:\n  control_rate_hz: 1\n  trajectory_rate_hz: 1000\n")])
    assert len(error.value.faults) == 2


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        load([tmp_path / "nowhere.yaml"])
    with pytest.raises(ConfigError, match=r"^flying: No such file or directory; sim, sitl, x500 come with flightd$"):
        load([Path("flying")])


def test_a_configured_hover_thrust_wins_over_the_autopilots() -> None:
    fence = geofence(load([]), (0.0, 0.0, 0.0))
    assert pipeline_parameters(load([]), fence, 0.41).control.hover_thrust == 0.41
    measured = load([], {"control": {"hover_thrust": 0.37}})
    assert pipeline_parameters(measured, fence, 0.41).control.hover_thrust == 0.37


def test_a_bare_name_means_the_shipped_file() -> None:
    assert load([Path("sitl")]).control.drag_1_s == (1.0, 1.0, 1.0)
    with pytest.raises(ConfigError, match="nosuch"):
        load([Path("nosuch")])


def test_files_stack_and_the_last_wins(tmp_path: Path) -> None:
    first = written(tmp_path, "guidance:\n  limits:\n    speed_m_s: 3\n    climb_m_s: 1\n")
    second = tmp_path / "second.yaml"
    second.write_text("guidance:\n  limits:\n    speed_m_s: 4\n")
    polygon = {"safety": {"fence": {"polygon_ne_m": [[0, 0], [9, 0], [9, 9.5]]}}}
    assert load([], polygon).safety.fence.polygon_ne_m[2] == (9.0, 9.5)
    limits = load([first, second], {"log": {"level": "debug"}}).guidance.limits
    assert (limits.speed_m_s, limits.climb_m_s, limits.jerk_m_s3) == (4.0, 1.0, 10.0)


def test_the_hash_changes_with_a_value_and_only_then() -> None:
    config = load([])
    changed = with_value(config, "guidance.limits.speed_m_s", 4.5)
    assert load([]).hash() == config.hash() != changed.hash()
    assert value_at(changed, "guidance.limits.speed_m_s") == 4.5


def test_a_setting_tells_its_range() -> None:
    assert describe("guidance.limits.speed_m_s") == {"min": 0.1, "max": 25.0, "unit": "m/s", "settable": True}
    for path in ("guidance.limits.speed", "guidance", "a.b", "guidance.limits.speed_m_s.x"):
        with pytest.raises(KeyError):
            value_at(load([]), path)
        with pytest.raises(KeyError):
            describe(path)


def test_a_refused_value_changes_nothing() -> None:
    config = load([])
    with pytest.raises(ValidationError):
        with_value(config, "guidance.limits.speed_m_s", -1.0)
    assert validated(config.model_dump(mode="json")) == config
    assert isinstance(config, Config)


def test_limits_that_need_more_tilt_than_there_is_are_refused() -> None:
    config = load([])
    with pytest.raises(
        ValidationError, match=r"acceleration_m_s2 3 with .* 2 down needs 21\.0 deg of tilt: control.*10"
    ):
        with_value(config, "control.tilt_max_deg", 10.0)
    with pytest.raises(
        ValidationError,
        match=r"acceleration_m_s2 8 with .* 2 down needs 45\.7 deg of tilt: control\.tilt_max_deg is 35",
    ):
        with_value(config, "guidance.limits.acceleration_m_s2", 8.0)
    assert with_value(config, "control.tilt_max_deg", 21.1).control.tilt_max_deg == 21.1


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("guidance.limits.speed_m_s", 17.0, r"guidance\.limits\.speed_m_s 17 .*safety\.speed_max_m_s is 20"),
        ("safety.speed_max_m_s", 6.0, r"guidance\.limits\.speed_m_s 5 .* 5\.4 m/s.*safety\.speed_max_m_s is 6"),
        ("control.tilt_max_deg", 66.0, r"control\.tilt_max_deg 66 .*safety\.tilt_max_deg 75"),
        ("safety.tilt_max_deg", 44.0, r"control\.tilt_max_deg 35 .*safety\.tilt_max_deg 44"),
    ],
)
def test_limits_that_the_supervisor_would_end_the_flight_at_are_refused(path: str, value: float, reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        with_value(load([]), path, value)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("guidance.limits.speed_m_s", 16.5),
        ("safety.speed_max_m_s", 6.5),
        ("control.tilt_max_deg", 65.0),
        ("safety.tilt_max_deg", 45.0),
    ],
)
def test_limits_with_room_to_the_supervisors_are_taken(path: str, value: float) -> None:
    with_value(load([]), path, value)
