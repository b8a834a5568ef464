"""The supervisor as sentences: what it is told, what it does, and within which time."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import pytest

from daemon.messages import (
    AutopilotStatus,
    EstimatedState,
    FlightMode,
    LandedState,
    ModeRefusal,
    RequestKind,
    SystemStatus,
    VehicleRequest,
)
from daemon.safety import supervision as safety
from daemon.safety.conditions import Bounds, Conditions, Facts
from daemon.safety.geofence import Geofence
from daemon.safety.supervision import Drive, Supervision, Timing
from daemon.safety.supervisor import OURS, TABLE, State, next_row

TICK_S = 0.01
LEVEL = (1.0, 0.0, 0.0, 0.0)
ON_GROUND = AutopilotStatus(
    connected=True,
    mode=FlightMode.HOLD,
    intended_mode=FlightMode.HOLD,
    armed=False,
    landed=LandedState.ON_GROUND,
    system_status=SystemStatus.STANDBY,
)
IN_HOLD = replace(ON_GROUND, armed=True, landed=LandedState.IN_AIR, system_status=SystemStatus.ACTIVE)
IN_OFFBOARD = replace(IN_HOLD, mode=FlightMode.OFFBOARD, intended_mode=FlightMode.OFFBOARD)


def vehicle_at(position: tuple[float, float, float] = (0.0, 0.0, -5.0)) -> EstimatedState:
    return EstimatedState(0.0, position, (0.0, 0.0, 0.0), LEVEL, (0.0, 0.0, 0.0), 0.04)


@dataclass
class Rig:
    """Ticks the supervision at 100 Hz with facts that the test changes."""

    facts: Facts = field(default_factory=lambda: Facts(ON_GROUND, vehicle_at(), 0.01, 0.04))
    bounds: Bounds = field(default_factory=Bounds)
    supervision: Supervision = field(default_factory=Supervision)
    now_s: float = 0.0
    request: VehicleRequest | None = None
    asked: list[tuple[float, FlightMode]] = field(default_factory=list)
    drive: Drive = Drive.SILENT

    def tick(self, count: int = 1) -> State:
        for _ in range(count):
            self.now_s += TICK_S
            self.supervision, conditions, modes = safety.step(
                self.supervision, self.facts, self.request, self.now_s, bounds=self.bounds, timing=Timing()
            )
            self.asked += [(self.now_s, mode) for mode in modes]
            self.drive = safety.drive(self.supervision, conditions)
        return self.supervision.state

    def set(self, **changes: object) -> "Rig":
        self.facts = replace(self.facts, **changes)  # type: ignore[arg-type]
        return self

    def status(self, status: AutopilotStatus, **changes: object) -> "Rig":
        return self.set(status=replace(status, **changes))  # type: ignore[arg-type]

    def ask(self, kind: RequestKind) -> "Rig":
        self.request = VehicleRequest(1 if self.request is None else self.request.serial + 1, kind)
        return self


def ready() -> Rig:
    """In Hold that we asked for, after a take-off."""
    rig = Rig()
    assert rig.tick() is State.STANDBY
    rig.ask(RequestKind.TAKEOFF).status(
        IN_HOLD, mode=FlightMode.TAKEOFF, intended_mode=FlightMode.TAKEOFF, landed=LandedState.ON_GROUND
    )
    assert rig.tick(2) is State.TAKING_OFF
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    return rig


def engaging() -> Rig:
    rig = ready()
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick() is State.ENGAGING
    return rig


def holding() -> Rig:
    rig = engaging()
    rig.tick(25)
    rig.status(IN_OFFBOARD)
    assert rig.tick() is State.HOLDING
    rig.asked.clear()
    return rig


def tracking() -> Rig:
    rig = holding().set(goal_active=True)
    assert rig.tick() is State.TRACKING
    return rig


def releasing() -> Rig:
    rig = tracking().ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    return rig


def test_a_vehicle_met_in_flight_belongs_to_the_pilot_and_nothing_is_asked() -> None:
    rig = Rig().status(IN_HOLD)
    assert rig.tick(100) is State.PILOT
    assert rig.supervision.reason == "found_flying"
    assert rig.asked == []
    assert rig.drive is Drive.SILENT


def test_engage_matches_for_two_tenths_before_it_asks_for_offboard() -> None:
    rig = engaging()
    since = rig.now_s
    assert rig.drive is Drive.MATCH
    rig.tick(40)
    (when, mode), *more = rig.asked
    assert mode is FlightMode.OFFBOARD
    assert when - since == pytest.approx(0.2, abs=0.015)
    assert more == []


def test_a_refused_offboard_is_asked_again_until_two_seconds_then_hold_and_silence() -> None:
    rig = engaging()
    since = rig.now_s
    for _ in range(220):
        rig.tick()
        if rig.asked and rig.asked[-1][1] is FlightMode.OFFBOARD:
            rig.status(IN_HOLD, mode_refusal=ModeRefusal(FlightMode.OFFBOARD, "no", rig.now_s))
        if rig.supervision.state is not State.ENGAGING:
            break
    assert rig.supervision.state is State.READY
    assert rig.supervision.reason == "engage_refused"
    assert rig.now_s - since == pytest.approx(2.0, abs=0.03)
    modes = [mode for _, mode in rig.asked]
    assert 5 <= modes.count(FlightMode.OFFBOARD) <= 10
    assert modes[-1] is FlightMode.HOLD
    assert rig.drive is Drive.SILENT


def test_an_engage_that_is_not_possible_is_not_begun() -> None:
    for changes in (
        {"armed": False},
        {"landed": LandedState.LANDING},
        {"mode": FlightMode.RETURN, "intended_mode": FlightMode.RETURN},
        {"mode": FlightMode.POSITION, "intended_mode": FlightMode.POSITION},
        {"intended_mode": FlightMode.OFFBOARD},
        {"system_status": SystemStatus.CRITICAL},
    ):
        rig = Rig().status(IN_HOLD)
        rig.tick()
        rig.status(IN_HOLD, **changes).ask(RequestKind.ENGAGE)
        assert rig.tick(5) not in OURS, changes
        rig.status(IN_HOLD)
        assert rig.tick(5) not in OURS, "a request is taken at once or not at all"
        assert rig.asked == []


def test_an_engage_on_an_attitude_that_the_accelerometer_contradicts_is_not_begun() -> None:
    rig = ready().set(disagreement_rad=0.5)
    rig.tick(250)
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick(5) is State.READY


@pytest.mark.parametrize("mode", [m for m in FlightMode if m not in (FlightMode.OFFBOARD, FlightMode.UNKNOWN)])
def test_a_mode_change_not_asked_for_silences_within_one_tick_and_asks_nothing(mode: FlightMode) -> None:
    rig = tracking().status(IN_OFFBOARD, mode=mode, intended_mode=mode)
    assert rig.tick() is State.PILOT
    assert rig.supervision.left == "pilot_override"
    assert rig.drive is Drive.SILENT
    rig.tick(300)
    assert rig.asked == []


def test_a_failsafe_of_the_autopilot_silences_and_stays_silent_while_it_intends_offboard() -> None:
    rig = tracking().status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL)
    assert rig.tick() is State.FAULT
    assert rig.supervision.left == "autopilot_failsafe"
    rig.status(IN_OFFBOARD)
    rig.tick(500)
    assert rig.supervision.state is State.FAULT
    assert rig.drive is Drive.SILENT
    assert rig.asked == []


def test_a_failsafe_that_shows_only_in_the_intended_mode_is_one() -> None:
    rig = tracking().status(IN_OFFBOARD, mode=FlightMode.RETURN)
    assert rig.tick() is State.FAULT


def test_a_kill_switch_silences_within_one_tick_while_the_autopilot_still_calls_itself_armed() -> None:
    rig = tracking().status(IN_OFFBOARD, system_status=SystemStatus.FLIGHT_TERMINATION)
    assert rig.tick() is State.FAULT
    assert rig.supervision.left == "terminated"
    assert rig.drive is Drive.SILENT
    rig.tick(100)
    assert rig.asked == []


def test_disarming_silences_within_one_tick() -> None:
    rig = tracking().status(IN_OFFBOARD, armed=False)
    assert rig.tick() is State.STANDBY
    assert rig.drive is Drive.SILENT
    assert rig.asked == []


def test_a_young_state_is_flown_an_older_one_levelled_a_lost_one_released() -> None:
    rig = tracking()
    rig.set(age_s=0.19).tick()
    assert (rig.supervision.state, rig.drive) == (State.TRACKING, Drive.LAW)
    rig.set(age_s=0.21).tick()
    assert (rig.supervision.state, rig.drive) == (State.TRACKING, Drive.LEVEL)
    rig.set(age_s=0.51).tick()
    assert (rig.supervision.state, rig.drive) == (State.RELEASING, Drive.LEVEL)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    assert rig.supervision.left == "estimate_lost"


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"position_variance_m2": 0.31}, "estimate_poor"),
        ({"position_variance_m2": float("nan")}, "estimate_poor"),
        ({"innovation": 1.1}, "estimate_poor"),
        ({"truth_returned": True}, "position_reset"),
        ({"state": vehicle_at((0.0, 0.0, -130.0))}, "geofence"),
        ({"state": replace(vehicle_at(), attitude_wb=(0.5, 0.866, 0.0, 0.0))}, "tilt_excess"),
        ({"state": replace(vehicle_at(), velocity_ned_m_s=(21.0, 0.0, 0.0))}, "speed_excess"),
        ({"disagreement_rad": 0.5}, "attitude_disagreement"),
    ],
)
def test_what_cannot_be_flown_is_handed_over_to_hold(changes: dict[str, object], reason: str) -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0))
    rig.set(**changes)
    for _ in range(300):
        if rig.tick() is State.RELEASING:
            break
    assert rig.supervision.left == reason
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


@pytest.mark.parametrize("beyond", [FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN])
def test_a_vehicle_that_drifts_on_beyond_the_hard_fence_is_brought_down_or_back_as_configured(
    beyond: FlightMode,
) -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=beyond)
    rig.set(state=vehicle_at((0.0, 0.0, -126.0)))
    assert rig.tick() is State.RELEASING
    rig.status(IN_HOLD)
    assert rig.tick(100) is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -131.0)))
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == ([] if beyond is FlightMode.HOLD else [beyond])
    rig.tick(5000)
    assert len(rig.asked) == (0 if beyond is FlightMode.HOLD else 5), "a refusal is not argued with for ever"
    if beyond is not FlightMode.HOLD:
        rig.ask(RequestKind.LAND if beyond is FlightMode.LAND else RequestKind.RETURN)
        rig.tick()
        rig.status(IN_HOLD, mode=beyond, intended_mode=beyond)
        assert rig.tick() is State.LANDING


def test_a_hold_that_a_person_asked_for_beyond_the_fence_is_left_alone() -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND)
    rig.ask(RequestKind.HOLD)
    rig.tick()
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -140.0)))
    rig.tick(200)
    assert rig.asked == []


def test_a_short_excess_of_tilt_is_not_handed_over() -> None:
    rig = tracking().set(state=replace(vehicle_at(), attitude_wb=(0.5, 0.866, 0.0, 0.0)))
    rig.tick(20)
    rig.set(state=vehicle_at())
    assert rig.tick(100) is State.TRACKING


def test_release_ends_when_hold_is_confirmed() -> None:
    rig = releasing()
    assert rig.drive is Drive.LAW
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(5)
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    assert rig.drive is Drive.SILENT


def test_hold_unconfirmed_becomes_land_then_level_then_silence_within_a_second() -> None:
    rig = releasing()
    since = rig.now_s
    driven: list[Drive] = []
    while rig.tick() is State.RELEASING:
        driven.append(rig.drive)
        assert rig.now_s - since < 1.0
    assert rig.supervision.state is State.FAULT
    modes = [mode for _, mode in rig.asked]
    assert list(dict.fromkeys(modes)) == [FlightMode.HOLD, FlightMode.LAND]
    assert modes == sorted(modes, key=[FlightMode.HOLD, FlightMode.LAND].index), "Hold is not asked for after Land"
    assert modes.count(FlightMode.HOLD) >= 3, "a message may be lost"
    assert next(t for t, mode in rig.asked if mode is FlightMode.LAND) - since == pytest.approx(0.3, abs=0.02)
    assert rig.now_s - since <= 1.0
    assert Drive.SILENT not in driven
    assert driven[-10:] == [Drive.LEVEL] * 10, "the autopilot's failsafe has to start from level"
    rig.tick(200)
    assert rig.drive is Drive.SILENT


def test_the_commands_of_a_hand_over_are_repeated_twenty_times_a_second() -> None:
    rig = releasing()
    while rig.tick() is State.RELEASING:
        pass
    times = [time for time, _ in rig.asked]
    assert 14 <= len(times) <= 16
    assert all(0.04 < after - before < 0.07 for before, after in pairwise(times))


def test_a_refused_offboard_is_not_asked_for_again_before_two_tenths() -> None:
    rig = engaging()
    for _ in range(150):
        rig.tick()
        if rig.asked:
            rig.status(IN_HOLD, mode_refusal=ModeRefusal(FlightMode.OFFBOARD, "no", rig.now_s))
    times = [time for time, _ in rig.asked]
    assert len(times) == 7
    assert all(0.19 < after - before < 0.22 for before, after in pairwise(times))


def test_a_hold_that_comes_long_after_it_was_asked_for_is_somebody_elses() -> None:
    for late_s, state in ((2.9, State.READY), (3.1, State.PILOT)):
        rig = Rig().status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION)
        rig.tick()
        rig.ask(RequestKind.HOLD)
        rig.tick(round(late_s / TICK_S))
        rig.status(IN_HOLD)
        assert rig.tick(5) is state


@pytest.mark.parametrize("kind", [RequestKind.HOLD, RequestKind.LAND, RequestKind.RETURN])
def test_a_request_that_meets_a_pilots_mode_in_its_tick_commands_nothing(kind: RequestKind) -> None:
    rig = Rig().status(IN_HOLD)
    rig.tick()
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    rig.ask(kind)
    assert rig.tick(5) is State.PILOT
    assert rig.asked == []


def test_a_refused_hold_becomes_land_at_once() -> None:
    rig = releasing()
    rig.status(IN_OFFBOARD, mode_refusal=ModeRefusal(FlightMode.HOLD, "no position", rig.now_s))
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD, FlightMode.LAND]
    rig.status(IN_OFFBOARD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING


def test_land_and_return_release_into_their_own_modes() -> None:
    for kind, mode in ((RequestKind.LAND, FlightMode.LAND), (RequestKind.RETURN, FlightMode.RETURN)):
        rig = tracking().ask(kind)
        assert rig.tick() is State.RELEASING
        assert [m for _, m in rig.asked] == [mode]
        rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode)
        assert rig.tick() is State.LANDING


def test_the_latch_silences_before_everything_and_only_engage_comes_back() -> None:
    rig = tracking().set(latched=True)
    assert rig.tick() is State.FAULT
    assert rig.drive is Drive.SILENT
    rig.set(latched=False).status(IN_HOLD)
    assert rig.tick(50) is State.FAULT
    rig.ask(RequestKind.ENGAGE)
    assert rig.tick() is State.ENGAGING


def test_a_stalled_task_asks_for_hold_once_more_when_a_heartbeat_of_now_still_shows_offboard() -> None:
    rig = tracking().status(IN_OFFBOARD, heartbeat_s=0.0).set(latched=True)
    assert rig.tick(100) is State.FAULT
    assert rig.asked == [], "an old heartbeat does not tell who has the vehicle"
    rig.status(IN_OFFBOARD, heartbeat_s=rig.supervision.since_s + 0.29)
    rig.tick(100)
    assert rig.asked == [], "it may have waited in a buffer"
    rig.status(IN_OFFBOARD, heartbeat_s=rig.now_s)
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


def test_a_stalled_task_asks_nothing_of_a_vehicle_that_somebody_else_took() -> None:
    rig = tracking().set(latched=True)
    rig.tick()
    for mode in (FlightMode.POSITION, FlightMode.RETURN):
        rig.status(IN_OFFBOARD, mode=mode, heartbeat_s=rig.now_s + 1.0)
        rig.tick(200)
    assert rig.asked == []


def test_a_lost_link_silences_asks_hold_once_and_the_vehicle_is_not_taken_back() -> None:
    rig = tracking().status(IN_OFFBOARD, connected=False)
    assert rig.tick() is State.DISCONNECTED
    assert rig.drive is Drive.SILENT
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    rig.tick(100)
    rig.status(IN_OFFBOARD)
    assert rig.tick() is State.PILOT
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD] * 2, "the first may not have been heard"
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY


def test_what_flew_the_vehicle_while_the_link_was_lost_keeps_it() -> None:
    for mode in (FlightMode.POSITION, FlightMode.RETURN):
        rig = tracking().status(IN_OFFBOARD, connected=False)
        rig.tick(100)
        rig.asked.clear()
        rig.status(IN_OFFBOARD, mode=mode, intended_mode=mode)
        assert rig.tick(100) is State.PILOT
        assert rig.asked == []
        rig.status(IN_OFFBOARD, connected=False)
        rig.tick(100)
        rig.status(IN_OFFBOARD)
        assert rig.tick(100) is State.PILOT
        assert rig.asked == [], "the second loss was not of ours"


def test_a_rebooted_autopilot_is_met_anew() -> None:
    rig = tracking().status(ON_GROUND, boot_count=1)
    assert rig.tick() is State.STANDBY
    assert rig.drive is Drive.SILENT


def test_hold_after_a_failsafe_counts_when_the_next_heartbeat_no_longer_shows_it() -> None:
    rig = Rig().status(IN_OFFBOARD, mode=FlightMode.RETURN, system_status=SystemStatus.CRITICAL)
    assert rig.tick(5) is State.FAULT
    rig.ask(RequestKind.HOLD)
    rig.tick()
    rig.status(IN_HOLD, system_status=SystemStatus.CRITICAL)
    assert rig.tick(80) is State.FAULT
    rig.status(IN_HOLD)
    assert rig.tick(5) is State.READY


def test_hold_can_be_asked_for_after_a_pilot_let_go() -> None:
    rig = Rig().status(IN_HOLD)
    rig.tick()
    rig.ask(RequestKind.HOLD)
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
    assert rig.tick() is State.READY


def test_landing_ends_disarmed_on_the_ground() -> None:
    rig = ready().ask(RequestKind.LAND)
    rig.tick()
    rig.status(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING
    rig.status(ON_GROUND, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.STANDBY


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


@pytest.mark.parametrize("changes", [{"variance_grows": True}, {"innovation": 1.1}, {"position_variance_m2": 0.31}])
def test_a_vehicle_whose_position_becomes_doubtful_is_not_taken(changes: dict[str, object]) -> None:
    rig = ready().set(**changes)
    rig.tick(150)
    rig.ask(RequestKind.ENGAGE)
    rig.tick(5)
    assert rig.supervision.state is State.READY


def test_an_estimate_that_contradicts_itself_for_a_moment_is_flown() -> None:
    rig = tracking().set(innovation=5.0)
    rig.tick(90)
    rig.set(innovation=0.5).tick(100)
    assert rig.supervision.state is State.TRACKING


def test_a_release_from_an_engage_waits_until_the_offboard_that_was_asked_for_cannot_come_any_more() -> None:
    rig = engaging()
    while not rig.asked:
        rig.tick()
    offboard_s = rig.now_s
    rig.tick(4)
    rig.ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    while rig.tick() is State.RELEASING:
        assert rig.now_s - offboard_s < 0.3
    assert rig.supervision.state is State.READY
    assert rig.now_s - offboard_s == pytest.approx(0.2, abs=0.015)


def test_a_release_before_offboard_was_asked_for_ends_in_the_hold_that_is_flown() -> None:
    rig = engaging()
    rig.tick(5)
    assert rig.asked == []
    rig.ask(RequestKind.HOLD)
    assert rig.tick() is State.RELEASING
    assert rig.tick() is State.READY


def test_a_landing_asked_for_while_engaging_has_two_tenths_to_begin() -> None:
    rig = engaging()
    rig.tick(5)
    rig.ask(RequestKind.LAND)
    assert rig.tick() is State.RELEASING
    since = rig.now_s
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]
    while rig.tick() is State.RELEASING:
        assert rig.now_s - since < 0.3
    assert rig.supervision.state is State.READY
    assert rig.now_s - since == pytest.approx(0.2, abs=0.015)
    rig.status(IN_HOLD, mode=FlightMode.LAND, intended_mode=FlightMode.LAND)
    assert rig.tick() is State.LANDING, "it came after all"
    assert rig.supervision.reason == "requested"


def test_an_offboard_that_comes_while_the_engage_is_given_up_is_answered_by_hold() -> None:
    rig = engaging()
    rig.tick(210)
    assert rig.supervision.state is State.READY
    assert rig.asked[-1][1] is FlightMode.HOLD
    assert rig.supervision.asked_mode is FlightMode.HOLD


def test_a_stale_heartbeat_does_not_tell_who_has_the_vehicle_long_after_the_start_either() -> None:
    rig = tracking()
    rig.now_s += 50.0
    rig.tick()
    rig.status(IN_OFFBOARD, heartbeat_s=rig.now_s).set(latched=True)
    assert rig.tick() is State.FAULT
    rig.status(IN_OFFBOARD, heartbeat_s=rig.supervision.since_s + 0.2)
    rig.tick(50)
    assert rig.asked == []
    rig.status(IN_OFFBOARD, heartbeat_s=rig.supervision.since_s + 0.31)
    rig.tick(50)
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


def test_the_first_request_counts_whatever_its_serial() -> None:
    for serial in (1, 7, -1):
        rig = Rig().status(IN_HOLD)
        rig.tick()
        rig.request = VehicleRequest(serial, RequestKind.HOLD)
        rig.tick()
        assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]
        assert rig.tick() is State.READY


def test_a_request_is_answered_once() -> None:
    rig = Rig().status(IN_HOLD, mode=FlightMode.MISSION, intended_mode=FlightMode.MISSION)
    rig.tick()
    rig.ask(RequestKind.LAND)
    rig.tick(100)
    assert [mode for _, mode in rig.asked] == [FlightMode.LAND]


def test_nothing_is_asked_of_an_autopilot_that_is_not_heard() -> None:
    rig = Rig().status(IN_HOLD, connected=False)
    rig.ask(RequestKind.LAND)
    rig.tick(5)
    rig.status(IN_HOLD)
    assert rig.tick(5) is State.PILOT
    assert rig.asked == []


def test_a_take_off_is_commanded_by_whoever_asks_for_it() -> None:
    rig = Rig()
    rig.tick()
    rig.ask(RequestKind.TAKEOFF)
    rig.tick(10)
    assert rig.asked == []
    assert rig.supervision.asked_mode is FlightMode.TAKEOFF


def test_a_landing_of_a_vehicle_on_the_ground_may_be_asked_for_in_a_pilots_mode() -> None:
    rig = Rig().status(ON_GROUND, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    rig.tick()
    rig.ask(RequestKind.HOLD)
    rig.tick()
    assert [mode for _, mode in rig.asked] == [FlightMode.HOLD]


def test_a_flight_is_given_back_for_the_reason_that_ended_it_whatever_follows() -> None:
    rig = tracking().set(truth_returned=True)
    assert rig.tick() is State.RELEASING
    rig.set(truth_returned=False).status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.status(IN_HOLD, mode=FlightMode.POSITION, intended_mode=FlightMode.POSITION)
    assert rig.tick() is State.PILOT
    assert (rig.supervision.left, rig.supervision.reason) == ("position_reset", "pilot_override")


@pytest.mark.parametrize(
    ("changes", "drive"),
    [
        ({}, Drive.LAW),
        ({"state_usable": False}, Drive.LEVEL),
        ({"estimate_poor": True}, Drive.LEVEL),
        ({"attitude_disagrees": True}, Drive.LEVEL),
        ({"release_levels": True}, Drive.LEVEL),
    ],
)
def test_while_releasing_only_a_trusted_estimate_is_flown(changes: dict[str, bool], drive: Drive) -> None:
    conditions = replace(Conditions(state_usable=True), **changes)
    assert safety.drive(Supervision(state=State.RELEASING), conditions) is drive
    for state in (State.HOLDING, State.TRACKING):
        expected = Drive.LEVEL if "state_usable" in changes else Drive.LAW
        assert safety.drive(Supervision(state=state), conditions) is expected
    assert safety.drive(Supervision(state=State.ENGAGING), conditions) is Drive.MATCH
    for state in set(State) - OURS:
        assert safety.drive(Supervision(state=state), conditions) is Drive.SILENT


def test_a_hold_that_was_given_for_another_reason_than_the_fence_is_left_alone_beyond_it() -> None:
    rig = tracking()
    rig.bounds = Bounds(fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0), fence_beyond=FlightMode.LAND)
    rig.set(position_variance_m2=9.0)
    assert rig.tick() is State.RELEASING
    assert rig.supervision.left == "estimate_poor"
    rig.status(IN_HOLD)
    assert rig.tick() is State.READY
    rig.asked.clear()
    rig.set(state=vehicle_at((0.0, 0.0, -140.0)))
    rig.tick(400)
    assert rig.asked == []


@pytest.mark.parametrize("mode", list(FlightMode))
def test_nothing_is_asked_of_a_vehicle_met_in_flight_whatever_mode_it_flies(mode: FlightMode) -> None:
    """Offboard too: another program may fly it."""
    rig = Rig().status(IN_HOLD, mode=mode, intended_mode=mode)
    assert rig.tick(300) is State.PILOT
    assert rig.asked == []
    assert rig.drive is Drive.SILENT
