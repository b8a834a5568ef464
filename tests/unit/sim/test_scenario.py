"""Scenarios: files and words of the command line that say when which vehicle has which fault."""

import re
from pathlib import Path

import pytest
from support.px4_talk import fly

from daemon.sim import airframe_files, scenario
from daemon.sim.faults import GpsLoss, Payload, SteadyWind, StoppedTelemetry
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.scenario import ScheduledFault

BAD_DAY = """
- {at_s: 2, fault: gps_loss, duration_s: 10}
- at_s: 1.5
  vehicle: 2
  fault: payload
  mass_kg: 0.3
- fault: wind
  north_m_s: 4
"""


def fleet():
    return [SimulatedPx4(airframe=airframe_files.load("sih"), system_id=n, noise=False) for n in (1, 2)]


def test_a_file_is_read_in_the_order_of_time(tmp_path):
    path = tmp_path / "bad_day.yaml"
    path.write_text(BAD_DAY)
    assert scenario.load(path) == (
        ScheduledFault(0.0, SteadyWind(north_m_s=4.0)),
        ScheduledFault(1.5, Payload(mass_kg=0.3), vehicle=2),
        ScheduledFault(2.0, GpsLoss(duration_s=10.0)),
    )


def test_a_planned_fault_happens_at_its_time_on_its_vehicle(tmp_path):
    path = tmp_path / "bad_day.yaml"
    path.write_text(BAD_DAY)
    vehicles = fleet()
    scenario.schedule(vehicles, scenario.load(path))
    for px4 in vehicles:
        fly(px4, 1.49)
    assert [px4.payload_kg for px4 in vehicles] == [0.0, 0.0]
    assert [px4.wind.steady_ned_m_s for px4 in vehicles] == [(4.0, 0.0, 0.0)] * 2
    for px4 in vehicles:
        fly(px4, 0.02)
    assert [px4.payload_kg for px4 in vehicles] == [0.0, 0.3]


@pytest.mark.parametrize(
    ("text", "planned"),
    [
        ("gps_loss at_s=30 duration_s=10", ScheduledFault(30.0, GpsLoss(duration_s=10.0))),
        ("payload mass_kg=0.5 vehicle=2", ScheduledFault(0.0, Payload(mass_kg=0.5), vehicle=2)),
        ('stopped_telemetry messages=["ODOMETRY","ATTITUDE"]',
         ScheduledFault(0.0, StoppedTelemetry(messages=("ODOMETRY", "ATTITUDE")))),
        ("stopped_telemetry messages=ATTITUDE", ScheduledFault(0.0, StoppedTelemetry(messages=("ATTITUDE",)))),
    ],
)  # fmt: skip
def test_words_say_the_same_as_a_file(text, planned):
    assert scenario.from_option(text) == planned


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "--fault '': fault: '' is none of arming_refused"),
        ("rain", "--fault 'rain': fault: 'rain' is none of"),
        ("gps_loss 10", "'10': key=value is expected"),
        ("gps_loss duration_s=", "gps_loss.duration_s: '' is not a number"),
        ("gps_loss at_s=-1", "at_s: -1 is not in 0 to inf"),
        ("gps_loss at_s=NaN", "at_s: nan is not a number"),
        ("gps_loss vehicle=1.5", "vehicle: 1.5 is not a whole number"),
        ("link loss=2", "link.loss: 2 is not in 0 to 1"),
    ],
)
def test_wrong_words_are_refused_with_the_key_and_the_reason(text, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        scenario.from_option(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fault: gps_loss", "a list of faults is expected"),
        ("- gps_loss", "[0].'gps_loss': a mapping with the key fault is expected"),
        ("- {at_s: 1, fault: reboot}\n- {at_s: soon, fault: reboot}", "[1].at_s: 'soon' is not a number"),
        ("- {fault: wind, north: 3}", "[0].wind.north: unknown; known: duration_s, north_m_s"),
        ("- {fault: [}", "bad_day.yaml: not YAML: line 1"),
        ("", "a list of faults is expected"),
    ],
)
def test_a_wrong_file_is_refused_by_name_place_and_reason(tmp_path, text, words):
    path = tmp_path / "bad_day.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(words)) as refused:
        scenario.load(path)
    assert str(path) in str(refused.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.yaml: No such file"):
        scenario.load(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("payload vehicle=3", "vehicle: 3; there are 1 to 2 (--vehicles)"),
        ("motor_efficiency rotor=6", "rotor: 6 is not in 0 to 3"),
    ],
)
def test_what_does_not_fit_the_fleet_is_refused_before_the_start(text, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        scenario.schedule(fleet(), [scenario.from_option(text)])


def test_the_documented_scenario_can_be_flown(tmp_path):
    text = (Path(__file__).parents[3] / "docs" / "simulator.md").read_text()
    (documented,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    path = tmp_path / "bad_day.yaml"
    path.write_text(documented)
    planned = scenario.load(path)
    assert [entry.at_s for entry in planned] == [0.0, 30.0, 45.0, 60.0, 90.0]
    scenario.schedule(fleet(), planned)
