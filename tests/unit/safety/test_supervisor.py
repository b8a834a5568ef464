"""The table, state by state: what each change of the conditions leads to, and what it leaves alone."""

from dataclasses import replace

import pytest

from daemon.safety.conditions import Conditions
from daemon.safety.supervisor import FLYING, OURS, TABLE, Row, State, next_row

IN_AIR = Conditions(link=True, armed=True, in_flight=True, in_air=True, state_usable=True, estimate_lost=False)
ON_GROUND = Conditions(link=True, landed=True, hold=True, state_usable=True, estimate_lost=False)
OFFBOARD = replace(IN_AIR, offboard=True)
HOLD = replace(IN_AIR, hold=True)

# The conditions under which nothing happens.
QUIET = {
    State.DISCONNECTED: replace(ON_GROUND, link=False),
    State.STANDBY: ON_GROUND,
    State.TAKING_OFF: replace(IN_AIR, takeoff=True, in_air=False),
    State.READY: HOLD,
    State.ENGAGING: HOLD,
    State.HOLDING: OFFBOARD,
    State.TRACKING: replace(OFFBOARD, goal_active=True),
    State.RELEASING: OFFBOARD,
    State.LANDING: replace(IN_AIR, landing=True),
    State.PILOT: IN_AIR,
    State.FAULT: IN_AIR,
}
WATCHING = (State.STANDBY, State.TAKING_OFF, State.READY, State.LANDING, State.PILOT, State.FAULT)


def after(state: State, **changes: bool) -> tuple[State, str] | None:
    row = next_row(state, replace(QUIET[state], **changes))
    return None if row is None else (row.to, row.reason)


@pytest.mark.parametrize("state", list(State))
def test_nothing_new_changes_nothing(state: State) -> None:
    assert after(state) is None


@pytest.mark.parametrize("state", [state for state in State if state is not State.DISCONNECTED])
def test_a_lost_link_and_a_reboot_end_every_state(state: State) -> None:
    assert after(state, link=False) == (State.DISCONNECTED, "link_lost")
    assert after(state, rebooted=True) == (State.STANDBY, "autopilot_rebooted")


def test_a_vehicle_that_is_met_is_a_pilots_when_it_flies() -> None:
    assert after(State.DISCONNECTED, link=True) == (State.STANDBY, "connected")
    assert after(State.DISCONNECTED, link=True, in_flight=True) == (State.PILOT, "found_flying")
    assert after(State.DISCONNECTED, link=True, in_flight=True, lost_while_ours=True) == (State.PILOT, "link_returned")
    assert after(State.DISCONNECTED, link=True, lost_while_ours=True) == (State.STANDBY, "connected")
    assert after(State.DISCONNECTED, in_flight=True) is None
    assert after(State.DISCONNECTED, latched=True) is None


@pytest.mark.parametrize("state", sorted(OURS, key=lambda s: s.value))
def test_a_vehicle_of_ours_is_let_go_at_once(state: State) -> None:
    assert after(state, latched=True, link=False) == (State.FAULT, "control_stalled"), "the gate comes first"
    assert after(state, armed=False, failsafe=True) == (State.STANDBY, "disarmed")
    assert after(state, terminated=True, failsafe=True) == (State.FAULT, "terminated")
    assert after(state, failsafe=True, offboard=False) == (State.FAULT, "autopilot_failsafe")
    assert after(state, offboard=False, hold=False) == (State.PILOT, "pilot_override")


@pytest.mark.parametrize("state", [state for state in WATCHING if state is not State.STANDBY])
def test_a_vehicle_that_is_not_ours_knows_no_latch_and_ends_disarmed(state: State) -> None:
    assert after(state, latched=True) is None
    assert after(state, terminated=True) is None
    assert after(state, armed=False) == (State.STANDBY, "disarmed")


def test_a_failsafe_of_the_autopilot_counts_in_flight() -> None:
    for state in (State.TAKING_OFF, State.READY, State.LANDING, State.PILOT):
        assert after(state, failsafe=True, overruled=True) == (State.FAULT, "autopilot_failsafe")
        assert after(state, failsafe=True, overruled=True, in_flight=False) is None
    assert after(State.STANDBY, failsafe=True, overruled=True) is None


def test_a_failsafe_that_lands_as_was_asked_for_is_that_landing() -> None:
    assert after(State.LANDING, failsafe=True) is None
    for state in (State.READY, State.FAULT, State.PILOT):
        landing = after(state, landing_confirmed=True, failsafe=True)
        assert landing == (State.LANDING, "requested")
        overruled = after(state, landing_confirmed=True, failsafe=True, overruled=True)
        assert overruled == (None if state is State.FAULT else (State.FAULT, "autopilot_failsafe"))


def test_a_fall_back_land_that_comes_after_hold_is_a_landing_for_a_reason_of_its_own() -> None:
    assert after(State.READY, landing_late=True, hold=False, fence_drifts=True) == (
        State.LANDING,
        "land_overtook_hold",
    )
    assert after(State.PILOT, landing_late=True) is None


def test_hold_ends_flying_even_when_nobody_asked_for_it() -> None:
    for state in FLYING:
        assert after(state, offboard=False, hold=True) == (State.PILOT, "pilot_override")


def test_engaging_ends_in_flight_or_where_it_came_from() -> None:
    engaging = State.ENGAGING
    assert after(engaging, release_asked=True, offboard=True) == (State.RELEASING, "requested")
    assert after(engaging, hold=False, offboard=True) == (State.HOLDING, "engaged")
    assert after(engaging, hold=False, offboard=True, state_usable=False) == (State.RELEASING, "estimate_lost")
    assert after(engaging, engage_over=True) == (State.READY, "engage_refused")
    assert after(engaging, state_usable=False) == (State.READY, "estimate_lost")
    assert after(engaging, goal_active=True) is None


@pytest.mark.parametrize("state", sorted(FLYING, key=lambda s: s.value))
@pytest.mark.parametrize(
    ("condition", "reason"),
    [
        ("release_asked", "requested"),
        ("estimate_lost", "estimate_lost"),
        ("estimate_poor", "estimate_poor"),
        ("truth_returned", "position_reset"),
        ("attitude_disagrees", "attitude_disagreement"),
        ("tilt_excess", "tilt_excess"),
        ("speed_excess", "speed_excess"),
        ("fence_breached", "geofence"),
        ("left_behind", "not_followed"),
        ("link_slow", "link_slow"),
        ("landed", "landed"),
        ("battery_low", "battery_low"),
    ],
)
def test_what_makes_us_give_the_vehicle_back(state: State, condition: str, reason: str) -> None:
    assert after(state, **{condition: True}) == (State.RELEASING, reason)
    for other in (State.READY, State.RELEASING, State.PILOT):
        assert after(other, **{condition: True}) is None


def test_a_goal_is_tracked_and_its_end_is_holding() -> None:
    assert after(State.HOLDING, goal_active=True) == (State.TRACKING, "goal")
    assert after(State.TRACKING, goal_active=False) == (State.HOLDING, "no_goal")
    for doubt in ("fence_crossed", "estimate_worsens", "engage_over", "release_over"):
        assert after(State.TRACKING, **{doubt: True}) is None


def test_a_release_ends_in_the_mode_that_was_asked_for_or_with_whoever_took_the_vehicle() -> None:
    releasing, in_hold = State.RELEASING, {"offboard": False, "hold": True}
    assert after(releasing, release_confirmed=True, **in_hold) == (State.READY, "released")
    assert after(releasing, release_confirmed=True, landing=True) == (State.LANDING, "released_to_land")
    assert after(releasing, **in_hold) == (State.READY, "released"), "a Hold is a Hold, whoever asked for it"
    assert after(releasing, hold_stale=True, **in_hold) is None, "the Hold of before"
    assert after(releasing, hold_stale=True, release_over=True, **in_hold) == (State.FAULT, "release_failed")
    assert after(releasing, hold_stale=True, offboard=False, hold=False) == (State.PILOT, "pilot_override")
    assert after(releasing, release_over=True) == (State.FAULT, "release_failed")


def test_an_engage_needs_a_state_that_waits_and_a_vehicle_that_can_be_taken() -> None:
    for state in (State.READY, State.PILOT, State.FAULT):
        assert after(state, engage_asked=True, engageable=True) == (State.ENGAGING, "requested")
    for state in State:
        assert after(state, engage_asked=True) is None
        assert after(state, engageable=True) is None
    for state in (State.STANDBY, State.TAKING_OFF, State.LANDING, State.HOLDING, State.RELEASING):
        assert after(state, engage_asked=True, engageable=True) is None


@pytest.mark.parametrize("state", WATCHING)
def test_modes_that_were_asked_for_while_watching_are_believed_when_they_are_seen(state: State) -> None:
    hold, landing, takeoff = (State.READY, "requested"), (State.LANDING, "requested"), (State.TAKING_OFF, "requested")
    assert after(state, hold_confirmed=True) == (None if state is State.READY else hold)
    assert after(state, landing_confirmed=True) == (None if state is State.LANDING else landing)
    assert after(state, takeoff_confirmed=True) == (None if state is State.TAKING_OFF else takeoff)
    assert after(state, hold_confirmed=True, failsafe=True, in_flight=False) is None, "not while a failsafe acts"


def test_a_landing_beyond_the_fence_is_the_fences() -> None:
    assert after(State.READY, landing_confirmed=True, fence_drifts=True) == (State.LANDING, "geofence")
    assert after(State.PILOT, landing_confirmed=True, fence_drifts=True) == (State.LANDING, "requested")
    assert after(State.READY, fence_drifts=True) is None


def test_a_take_off_ends_in_a_hold_in_the_air() -> None:
    taking_off = State.TAKING_OFF
    assert after(taking_off, takeoff=False, hold=True, in_air=True) == (State.READY, "taken_off")
    assert after(taking_off, takeoff=False, hold=True) is None, "still on its way up"
    assert after(taking_off, in_air=True) is None, "in the air, and still taking off"
    assert after(taking_off, takeoff=False) == (State.PILOT, "pilot_override")


def test_who_leaves_the_mode_of_a_watched_state_has_the_vehicle() -> None:
    assert after(State.READY, hold=False) == (State.PILOT, "pilot_override")
    assert after(State.LANDING, landing=False) == (State.PILOT, "pilot_override")
    assert after(State.LANDING, landing=False, landed=True) is None, "on the ground the mode says nothing"
    assert after(State.LANDING, landed=True) is None
    assert after(State.STANDBY, in_flight=True) == (State.PILOT, "pilot_takeoff")
    assert after(State.FAULT, hold=True) is None
    assert after(State.PILOT, hold=True) is None


def test_of_two_rows_that_fit_the_first_is_taken() -> None:
    assert after(State.TRACKING, estimate_lost=True, battery_low=True) == (State.RELEASING, "estimate_lost")
    assert after(State.READY, landing_confirmed=True, hold=False) == (State.LANDING, "requested")
    assert isinstance(next_row(State.READY, replace(HOLD, link=False)), Row)


def test_every_condition_of_the_table_exists_and_every_state_can_be_left_and_reached() -> None:
    names = {name.removeprefix("!") for row in TABLE for name in row.when}
    assert names <= set(Conditions.__dataclass_fields__)
    assert {row.to for row in TABLE} == set(State)
    assert {state for row in TABLE for state in row.states} == set(State)


@pytest.mark.parametrize("index", range(len(TABLE)), ids=lambda i: f"{i}-{TABLE[i].reason}")
def test_each_row_can_be_taken_and_needs_each_of_its_conditions(index: int) -> None:
    row = TABLE[index]
    wanted = {name.removeprefix("!"): not name.startswith("!") for name in row.when}
    quiet = Conditions(link=True, armed=True, estimate_lost=False, state_usable=True, offboard=True)
    for state in row.states:
        for neutral in (quiet, replace(quiet, offboard=False, hold=True), replace(quiet, in_flight=True)):
            neutral = replace(neutral, takeoff=state is State.TAKING_OFF, landing=state is State.LANDING)
            if next_row(state, replace(neutral, **wanted)) is row:
                break
        else:
            continue
        break
    else:
        pytest.fail("no conditions lead to this row")
    for name, value in wanted.items():
        assert next_row(state, replace(neutral, **{**wanted, name: not value})) is not row, name
