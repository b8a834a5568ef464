"""The status that the autopilot tells: its mode and the intended one, arming, places, battery and events."""

import pytest
from support.session_rig import HOLD, OFFBOARD, RETURN, current_mode, heartbeat

from daemon.autopilot.session import Px4Session
from daemon.messages import FlightMode


def test_mode_is_the_newest_of_three_messages(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD), 1.0)
    assert session.status.value.mode is FlightMode.OFFBOARD
    session.receive("EVENT", {"id": 31382480, "arguments": "0000060006"}, 2.0)
    status = session.status.value
    assert (status.mode, status.intended_mode) == (FlightMode.RETURN, FlightMode.OFFBOARD)
    session.receive("HEARTBEAT", heartbeat(RETURN, system_status=5), 2.5)
    status = session.status.value
    assert (status.mode, status.intended_mode) == (FlightMode.RETURN, FlightMode.OFFBOARD)
    session.receive("CURRENT_MODE", current_mode(HOLD), 3.0)
    assert (session.status.value.mode, session.status.value.intended_mode) == (FlightMode.HOLD, FlightMode.HOLD)


def test_a_pilots_mode_seen_first_in_the_heartbeat_is_not_taken_for_a_failsafe(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD), 1.0)
    session.receive("HEARTBEAT", heartbeat(HOLD), 1.1)
    assert session.status.value.intended_mode is FlightMode.HOLD


@pytest.mark.parametrize(
    ("mav_type", "words"),
    [
        *((kind, "") for kind in (2, 13, 14, 15)),
        (0, "another kind of vehicle (MAV_TYPE 0)"),
        (1, "a fixed-wing aircraft (MAV_TYPE 1)"),
        (4, "a helicopter (MAV_TYPE 4)"),
        (10, "a rover (MAV_TYPE 10)"),
        (19, "a VTOL aircraft (MAV_TYPE 19)"),
        (25, "a VTOL aircraft (MAV_TYPE 25)"),
        (29, "another kind of vehicle (MAV_TYPE 29)"),  # a dodecarotor, which PX4 gives no thrust
    ],
)
def test_what_is_no_multirotor_is_called_by_its_name(session: Px4Session, mav_type: int, words: str) -> None:
    session.receive("HEARTBEAT", heartbeat(HOLD, type=mav_type), 0.1)
    assert session.status.value.airframe == words


def test_a_ground_station_on_the_link_is_not_the_vehicle(session: Px4Session) -> None:
    session.receive("HEARTBEAT", heartbeat(HOLD), 0.1)
    session.receive("HEARTBEAT", heartbeat(0, type=6, autopilot=8), 0.2)
    assert session.status.value.airframe == ""


def test_status_takes_places_and_battery(session: Px4Session) -> None:
    session.receive("SYS_STATUS", {"battery_remaining": 45}, 0.1)
    session.receive("GPS_GLOBAL_ORIGIN", {"latitude": 473977436, "longitude": 85455940, "altitude": 489397}, 0.1)
    session.receive(
        "HOME_POSITION",
        {"latitude": 473977436, "longitude": 85455940, "altitude": 489397, "x": -0.0028, "y": 0.0026, "z": -0.039},
        0.1,
    )
    status = session.status.value
    assert status.battery_fraction == pytest.approx(0.45)
    assert status.home == status.global_origin
    assert status.home_ned_m == (-0.0028, 0.0026, -0.039)


def test_of_several_batteries_the_worst_is_told_and_no_longer_than_it_is_bad(session: Px4Session) -> None:
    told = []
    for battery, charge in ((0, 1), (1, 2), (0, 1), (1, 3), (0, 2), (1, 1), (0, 2), (1, 1)):
        session.receive("BATTERY_STATUS", {"id": battery, "charge_state": charge}, 0.1)
        told.append(int(session.status.value.battery_charge))
    assert told == [1, 2, 2, 3, 3, 1, 2, 2]


def test_events_are_kept_as_words(session: Px4Session) -> None:
    session.receive("EVENT", {"id": 22400324, "arguments": ""}, 0.1)
    session.receive("EVENT", {"id": 17154777, "arguments": "0800000014"}, 0.1)
    assert session.take_events() == ["manual control lost"]
    assert session.take_events() == []


def test_an_intended_mode_that_is_not_told_is_the_mode(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD, 0), 1.0)
    assert session.status.value.intended_mode is FlightMode.OFFBOARD


def test_the_event_of_a_disarming_shows_before_the_next_heartbeat(session: Px4Session) -> None:
    assert session.status.value.armed
    session.receive("EVENT", {"id": 32794487, "arguments": "04"}, 0.2)
    assert not session.status.value.armed


def test_a_new_mode_in_a_heartbeat_of_a_failsafe_is_not_what_the_autopilot_intends(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(OFFBOARD), 1.0)
    session.receive("HEARTBEAT", heartbeat(RETURN, system_status=5), 1.1)
    assert (session.status.value.mode, session.status.value.intended_mode) == (FlightMode.RETURN, FlightMode.OFFBOARD)


def test_the_heartbeat_that_brings_the_link_back_says_what_is_intended(session: Px4Session) -> None:
    session.receive("CURRENT_MODE", current_mode(HOLD, OFFBOARD), 1.0)
    session.receive("HEARTBEAT", heartbeat(HOLD), 1.1)
    assert session.status.value.intended_mode is FlightMode.OFFBOARD, "nothing new: CURRENT_MODE knows better"
    session.poll(3.0)
    session.receive("HEARTBEAT", heartbeat(HOLD), 5.0)
    assert session.status.value.intended_mode is FlightMode.HOLD
