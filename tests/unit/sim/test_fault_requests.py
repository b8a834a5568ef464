from typing import Any

import pytest

from daemon.sim.airframe_files import load
from daemon.sim.fault_requests import fault_requests
from daemon.sim.px4 import SimulatedPx4


@pytest.fixture
def fleet() -> list[SimulatedPx4]:
    return [SimulatedPx4(airframe=load("sih"), seed=number, system_id=number, noise=False) for number in (1, 2)]


def test_a_fault_begins_on_all_vehicles_or_on_the_one_named(fleet: list[SimulatedPx4]) -> None:
    handle = fault_requests(fleet)
    answer = handle({"inject": {"fault": "payload", "mass_kg": 0.25}, "vehicle": 2})
    assert answer == {"active": {"2": ["payload"]}}
    assert [px4.payload_kg for px4 in fleet] == [0.0, 0.25]
    assert handle({"inject": {"fault": "gps_loss"}}) == {"active": {"1": ["gps_loss"], "2": ["payload", "gps_loss"]}}


def test_faults_end_by_name_or_all_at_once(fleet: list[SimulatedPx4]) -> None:
    handle = fault_requests(fleet)
    handle({"inject": {"fault": "payload"}})
    handle({"inject": {"fault": "no_acks"}})
    assert handle({"clear": "payload"}) == {"active": {"1": ["no_acks"], "2": ["no_acks"]}}
    assert fleet[0].payload_kg == 0.0
    assert handle({"clear": None, "vehicle": 1}) == {"active": {"1": []}}
    assert handle({"list": True})["active"] == {"1": [], "2": ["no_acks"]}


def test_the_list_tells_the_faults_that_there_are_and_their_settings(fleet: list[SimulatedPx4]) -> None:
    known = fault_requests(fleet)({"list": True})["known"]
    assert len(known) == 18
    assert known["gps_loss"] == ["duration_s"]
    assert set(known["motor_efficiency"]) == {"duration_s", "rotor", "efficiency"}


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({}, "one of inject, clear, list"),
        ({"inject": {"fault": "payload"}, "clear": None}, "one of inject, clear, list"),
        ({"list": True, "vehicles": 1}, "one of inject, clear, list"),
        ({"inject": "payload"}, "inject: a mapping"),
        ({"inject": {"fault": "payload", "mass_kg": "much"}}, "payload.mass_kg"),
        ({"inject": {"fault": "nonsense"}}, "'nonsense' is none of"),
        ({"clear": "nonsense"}, "'nonsense' is none of"),
        ({"list": True, "vehicle": 3}, "vehicle: 3 is none of 1, 2"),
    ],
)
def test_a_bad_request_is_refused_with_the_reason(
    fleet: list[SimulatedPx4], request_: dict[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        fault_requests(fleet)(request_)
    assert all(not px4.faults.active for px4 in fleet)
