"""Each condition on its own: its bound, its time, its hysteresis, and what the autopilot's words mean."""

from dataclasses import fields, replace
from math import cos, inf, nan, radians, sin
from pathlib import Path

import pytest
import yaml
from support.statuses import IN_HOLD

from daemon.messages import BatteryCharge, EstimatedState, FlightMode, LandedState, SystemStatus
from daemon.safety.conditions import Bounds, Conditions, Facts, Lasting, Memory, evaluate, in_flight, lasting
from daemon.safety.dead_man import DeadManTiming
from daemon.safety.geofence import Geofence

TICK_S = 0.01
REST = EstimatedState(0.0, (0.0, 0.0, -5.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
CALM = Facts(IN_HOLD, REST, 0.01)


def tilted(angle_rad: float) -> Facts:
    return replace(CALM, state=replace(REST, attitude_wb=(cos(0.5 * angle_rad), 0.0, sin(0.5 * angle_rad), 0.0)))


def moving(speed_m_s: float) -> Facts:
    return replace(CALM, state=replace(REST, velocity_ned_m_s=(0.6 * speed_m_s, 0.0, -0.8 * speed_m_s)))


def at_height(height_m: float) -> Facts:
    return replace(CALM, state=replace(REST, position_ned_m=(0.0, 0.0, -height_m)))


def charged(fraction: float | None) -> Facts:
    return replace(CALM, status=replace(IN_HOLD, battery_fraction=fraction))


def off(deviation_m: float) -> Facts:
    return replace(CALM, deviation_ned_m=(0.6 * deviation_m, -0.8 * deviation_m, 0.0))


def sinking(below_m: float) -> Facts:
    state = replace(REST, velocity_ned_m_s=(0.0, 0.0, 0.3))
    return replace(CALM, state=state, deviation_ned_m=(0.0, 0.0, below_m))


# What is measured, what it makes true, the bound and the time it has to last: as the configuration and its guide say.
EXCESSES = {
    "variance": (lambda v: replace(CALM, position_variance_m2=v), "estimate_poor", 0.3, 0.0),
    "innovation": (lambda v: replace(CALM, innovation=v), "estimate_poor", 1.0, 1.0),
    "disagreement": (lambda v: replace(CALM, disagreement_rad=v), "attitude_disagrees", 0.26, 2.0),
    "tilt": (tilted, "tilt_excess", 1.3, 0.3),
    "speed": (moving, "speed_excess", 20.0, 0.5),
    "deviation": (off, "left_behind", 4.0, 3.0),
    "sinking": (sinking, "left_behind", 1.0, 0.5),
    "round trip": (lambda v: replace(CALM, round_trip_s=v), "link_slow", 0.1, 0.3),
}


class Ticks:
    """Evaluates the conditions at 100 Hz, beginning at a time that is not zero."""

    def __init__(self, bounds: Bounds | None = None) -> None:
        self.bounds = bounds or Bounds()
        self.memory = Memory()
        self.n = 0

    def run(self, facts: Facts, seconds: float = TICK_S) -> Conditions:
        for _ in range(max(1, round(seconds / TICK_S))):
            self.memory, conditions = evaluate(self.memory, facts, 7.0 + self.n * TICK_S, self.bounds)
            self.n += 1
        return conditions

    def lasts_s(self, facts: Facts, condition: str) -> float:
        """How long it takes until the condition is true."""
        begin = self.n
        while not getattr(self.run(facts), condition):
            assert self.n - begin < 1000
        return (self.n - 1 - begin) * TICK_S


@pytest.mark.parametrize("name", EXCESSES)
def test_an_excess_counts_after_its_time_without_a_break(name: str) -> None:
    facts, condition, bound, for_s = EXCESSES[name]
    ticks = Ticks()
    assert not getattr(ticks.run(facts(0.99 * bound), 4.0), condition)
    assert ticks.lasts_s(facts(1.01 * bound), condition) == pytest.approx(for_s, abs=1.5 * TICK_S)
    ticks = Ticks()
    for _ in range(3):
        assert not for_s or not getattr(ticks.run(facts(1.01 * bound), 0.9 * for_s), condition)
        ticks.run(CALM)
    assert ticks.lasts_s(facts(nan), condition) == pytest.approx(for_s, abs=1.5 * TICK_S), "no number is an excess"


@pytest.mark.parametrize("name", EXCESSES)
def test_an_excess_that_counted_ends_below_four_fifths_of_its_bound(name: str) -> None:
    facts, condition, bound, _ = EXCESSES[name]
    ticks = Ticks()
    ticks.lasts_s(facts(1.01 * bound), condition)
    assert getattr(ticks.run(facts(0.82 * bound), 3.0), condition)
    assert not getattr(ticks.run(facts(0.78 * bound)), condition)
    assert not getattr(ticks.run(facts(0.82 * bound), 3.0), condition)


def test_the_bound_itself_is_no_excess() -> None:
    assert lasting(Lasting(), 2.0, 2.0, 0.0, 5.0, 0.8) == Lasting()
    assert lasting(Lasting(), 2.1, 2.0, 0.0, 5.0, 0.8) == Lasting(5.0, True)
    assert lasting(Lasting(4.0), 2.1, 2.0, 1.0, 5.0, 0.8) == Lasting(4.0, True)
    assert lasting(Lasting(4.5), 2.1, 2.0, 1.0, 5.0, 0.8) == Lasting(4.5, False)


def test_a_vehicle_below_its_reference_that_does_not_sink_has_time_to_climb() -> None:
    resting = replace(sinking(2.0), state=replace(REST, velocity_ned_m_s=(0.0, 0.0, 0.19)))
    assert not Ticks().run(resting, 2.9).left_behind
    assert not Ticks().run(sinking(-2.0), 2.9).left_behind, "above it"


def test_without_a_state_neither_tilt_nor_speed_nor_fence_is_exceeded() -> None:
    bounds = Bounds(tilt_rad=0.5, speed_m_s=0.5, fence=Geofence(radius_m=0.0, hard_margin_m=0.0))
    conditions = Ticks(bounds).run(replace(CALM, state=None), 1.0)
    assert not (conditions.tilt_excess or conditions.speed_excess)
    assert not (conditions.fence_crossed or conditions.fence_breached or conditions.fence_drifts)
    assert not conditions.state_usable


def test_a_low_battery_counts_after_five_seconds_and_no_longer_once_it_is_charged_enough() -> None:
    ticks = Ticks(Bounds(battery_fraction=0.3))
    assert not ticks.run(charged(0.31), 10.0).battery_low
    assert not ticks.run(charged(0.30), 10.0).battery_low
    assert not ticks.run(charged(None), 10.0).battery_low
    assert ticks.lasts_s(charged(0.29), "battery_low") == pytest.approx(5.0, abs=1.5 * TICK_S)
    assert not ticks.run(charged(0.30)).battery_low
    assert ticks.lasts_s(charged(0.0), "battery_low") == pytest.approx(5.0, abs=1.5 * TICK_S)


def test_an_empty_battery_is_left_to_the_autopilot_unless_a_bound_is_set() -> None:
    assert not Ticks().run(charged(0.0), 10.0).battery_low
    assert not Ticks().run(charged(-0.01), 10.0).battery_low


@pytest.mark.parametrize(
    ("height_m", "crossed", "breached"),
    [(30.0, False, False), (30.1, True, False), (36.0, True, False), (36.1, True, True)],
)
def test_the_hard_fence_lies_a_margin_outside(height_m: float, crossed: bool, breached: bool) -> None:
    conditions = Ticks(Bounds(fence=Geofence(ceiling_m=30.0, hard_margin_m=6.0))).run(at_height(height_m))
    assert (conditions.fence_crossed, conditions.fence_breached) == (crossed, breached)


def outwards(distance_m: float, speed_m_s: float) -> Facts:
    """North of the anchor at (50, 0), to the north."""
    state = replace(REST, position_ned_m=(50.0 + distance_m, 0.0, -5.0), velocity_ned_m_s=(speed_m_s, 0.0, 0.0))
    return replace(CALM, state=state)


FENCED = Bounds(fence=Geofence(anchor_ned_m=(50.0, 0.0, 0.0), radius_m=30.0, hard_margin_m=6.0))


def test_a_vehicle_drifts_when_it_goes_on_outwards_a_margin_beyond_where_it_was_handed_over() -> None:
    for first_m in (36.1, 80.0):
        ticks = Ticks(FENCED)
        assert not ticks.run(outwards(first_m, 5.0), 3.0).fence_drifts, "near to where it was handed over"
        assert not ticks.run(outwards(first_m + 5.9, 5.0), 3.0).fence_drifts
        beyond = outwards(first_m + 6.1, 0.6)
        assert ticks.lasts_s(beyond, "fence_drifts") == pytest.approx(2.0, abs=1.5 * TICK_S)
        assert not ticks.run(outwards(first_m + 6.1, 0.3), 3.0).fence_drifts, "it has come to rest there"
        assert not ticks.run(outwards(first_m + 6.1, -5.0), 3.0).fence_drifts, "it comes back"
        ticks.run(outwards(35.0, 5.0))
        assert not ticks.run(outwards(first_m + 6.1, 5.0), 3.0).fence_drifts, "another breach"


def test_a_fence_that_moves_away_from_a_vehicle_makes_it_no_drifter() -> None:
    ticks = Ticks(FENCED)
    assert ticks.run(outwards(36.1, 5.0), 0.5).fence_breached
    ticks.bounds = replace(FENCED, fence=replace(FENCED.fence, anchor_ned_m=(-550.0, 0.0, 0.0)))
    conditions = ticks.run(outwards(37.0, 5.0), 3.0)
    assert conditions.fence_breached and not conditions.fence_drifts


def test_the_margin_of_the_fence_is_five_metres_unless_told() -> None:
    bounds = Bounds(fence=Geofence(ceiling_m=30.0))
    assert not Ticks(bounds).run(at_height(34.9)).fence_breached
    assert Ticks(bounds).run(at_height(35.1)).fence_breached


@pytest.mark.parametrize(("age_s", "usable", "lost"), [(0.2, True, False), (0.21, False, False), (0.5, False, False)])
def test_a_state_is_usable_until_it_is_too_old_to_coast(age_s: float, usable: bool, lost: bool) -> None:
    conditions = Ticks().run(replace(CALM, age_s=age_s))
    assert (conditions.state_usable, conditions.estimate_lost) == (usable, lost)


def test_a_state_older_than_half_a_second_and_one_that_never_came_are_lost() -> None:
    assert Ticks().run(replace(CALM, age_s=0.51)).estimate_lost
    never = Ticks().run(Facts(IN_HOLD))
    assert never.estimate_lost and not never.state_usable


@pytest.mark.parametrize("armed", [True, False])
@pytest.mark.parametrize("landed", list(LandedState))
def test_in_flight_is_armed_and_not_said_to_be_on_the_ground(armed: bool, landed: LandedState) -> None:
    status = replace(IN_HOLD, armed=armed, landed=landed)
    conditions = Ticks().run(replace(CALM, status=status))
    assert in_flight(status) == (armed and landed != LandedState.ON_GROUND)
    assert conditions.in_flight == in_flight(status)
    assert conditions.in_air == (armed and landed == LandedState.IN_AIR)
    assert conditions.landed == (landed == LandedState.ON_GROUND)
    assert conditions.armed == armed


@pytest.mark.parametrize("status", list(SystemStatus))
def test_from_critical_on_the_autopilot_has_a_failsafe_and_termination_ends_all(status: SystemStatus) -> None:
    conditions = Ticks().run(replace(CALM, status=replace(IN_HOLD, system_status=status)))
    assert conditions.failsafe == (status >= 5), "MAV_STATE_CRITICAL"
    assert conditions.terminated == (status >= 8), "MAV_STATE_FLIGHT_TERMINATION"
    assert conditions.engageable == (status == 4), "MAV_STATE_ACTIVE"


@pytest.mark.parametrize(
    ("mode", "intended", "status", "overruled"),
    [
        (FlightMode.LAND, FlightMode.LAND, SystemStatus.CRITICAL, False),
        (FlightMode.RETURN, FlightMode.RETURN, SystemStatus.CRITICAL, False),
        (FlightMode.LAND, FlightMode.UNKNOWN, SystemStatus.CRITICAL, False),
        (FlightMode.LAND, FlightMode.RETURN, SystemStatus.CRITICAL, True),
        (FlightMode.LAND, FlightMode.HOLD, SystemStatus.ACTIVE, True),
        (FlightMode.HOLD, FlightMode.HOLD, SystemStatus.CRITICAL, True),
        (FlightMode.LAND, FlightMode.LAND, SystemStatus.ACTIVE, False),
        (FlightMode.OFFBOARD, FlightMode.OFFBOARD, SystemStatus.CRITICAL, False),
    ],
)
def test_a_failsafe_overrules_unless_it_brings_the_vehicle_down_in_the_way_that_was_asked_for(
    mode: FlightMode, intended: FlightMode, status: SystemStatus, overruled: bool
) -> None:
    told = replace(IN_HOLD, mode=mode, intended_mode=intended, system_status=status)
    assert Ticks().run(replace(CALM, status=told)).overruled is overruled


def test_an_autopilot_that_flies_another_mode_than_it_was_told_has_a_failsafe() -> None:
    for mode, intended, failsafe in (
        (FlightMode.RETURN, FlightMode.MISSION, True),
        (FlightMode.RETURN, FlightMode.RETURN, False),
        (FlightMode.RETURN, FlightMode.UNKNOWN, False),
        (FlightMode.UNKNOWN, FlightMode.RETURN, False),
        (FlightMode.OFFBOARD, FlightMode.HOLD, False),
    ):
        conditions = Ticks().run(replace(CALM, status=replace(IN_HOLD, mode=mode, intended_mode=intended)))
        assert conditions.failsafe is failsafe, (mode, intended)


@pytest.mark.parametrize("mode", list(FlightMode))
def test_each_mode_is_called_by_its_name(mode: FlightMode) -> None:
    conditions = Ticks().run(replace(CALM, status=replace(IN_HOLD, mode=mode, intended_mode=mode)))
    assert conditions.offboard == (mode.name == "OFFBOARD")
    assert conditions.hold == conditions.engageable == (mode.name == "HOLD")
    assert conditions.takeoff == (mode.name == "TAKEOFF")
    assert conditions.landing == (mode.name in ("LAND", "RETURN", "PRECISION_LAND"))


def test_what_makes_a_vehicle_engageable_is_needed_all_together() -> None:
    bounds = Bounds(battery_fraction=0.3, fence=Geofence(ceiling_m=120.0, hard_margin_m=5.0))
    assert Ticks(bounds).run(CALM).engageable
    for spoiled in (
        replace(CALM, status=replace(IN_HOLD, armed=False)),
        replace(CALM, status=replace(IN_HOLD, airframe="a rover (MAV_TYPE 10)")),
        replace(CALM, status=replace(IN_HOLD, landed=LandedState.LANDING)),
        replace(CALM, status=replace(IN_HOLD, intended_mode=FlightMode.MISSION)),
        replace(CALM, age_s=0.3),
        replace(CALM, state=None),
        replace(CALM, variance_grows=True),
        replace(CALM, position_variance_m2=0.31),
        replace(CALM, innovation=1.1),
        replace(CALM, disagreement_rad=0.3),
        tilted(1.4),
        moving(21.0),
        charged(0.2),
        at_height(126.0),
        replace(CALM, status=replace(IN_HOLD, battery_charge=BatteryCharge.CRITICAL)),
        replace(CALM, status=replace(IN_HOLD, battery_charge=BatteryCharge.EMERGENCY)),
    ):
        assert not Ticks(bounds).run(spoiled, 5.5).engageable, spoiled
    low = replace(CALM, status=replace(IN_HOLD, battery_charge=BatteryCharge.LOW))
    assert Ticks(bounds).run(low, 5.5).engageable, "a low battery is not yet a critical one"
    assert Ticks(bounds).run(at_height(124.0), 5.5).engageable, "it may be flown back from the margin"


def test_facts_that_are_conditions_are_passed_on() -> None:
    for name, condition in (
        ("variance_grows", "estimate_worsens"),
        ("truth_returned", "truth_returned"),
        ("goal_active", "goal_active"),
        ("latched", "latched"),
    ):
        assert not getattr(Ticks().run(CALM), condition)
        assert getattr(Ticks().run(replace(CALM, **{name: True})), condition)  # type: ignore[arg-type]
    assert not Ticks().run(replace(CALM, status=replace(IN_HOLD, connected=False))).link


def test_requests_are_taken_as_they_are_named_and_the_boot_count_is_remembered() -> None:
    memory, conditions = evaluate(Memory(), CALM, 1.0, Bounds(), engage_asked=True, release_over=True)
    assert conditions.engage_asked and conditions.release_over and not conditions.release_asked
    assert memory.boot_count == IN_HOLD.boot_count
    assert Facts(IN_HOLD).age_s == inf


def test_the_bounds_and_times_are_those_of_the_default_configuration() -> None:
    """Angles are degrees there, rounded."""
    written = yaml.safe_load((Path(__file__).parents[3] / "config" / "default.yaml").read_text())
    safety, bounds, timing = written["safety"], Bounds(), DeadManTiming()
    assert (bounds.coast_s, bounds.lost_s) == (safety["coast_s"], safety["lost_s"])
    assert bounds.position_variance_m2 == written["estimator"]["position_variance_max_m2"]
    assert bounds.attitude_disagreement_rad == pytest.approx(radians(safety["attitude_disagreement_deg"]), rel=0.01)
    assert bounds.tilt_rad == pytest.approx(radians(safety["tilt_max_deg"]), rel=0.01)
    assert bounds.deviation_m == written["guidance"]["deviation_max_m"]
    assert bounds.round_trip_s == written["link"]["round_trip_max_s"]
    assert (bounds.speed_m_s, bounds.battery_fraction) == (safety["speed_max_m_s"], safety["battery_min_pct"])
    assert bounds.fence.hard_margin_m == safety["fence"]["hard_margin_m"]
    assert timing.level_after_s == safety["dead_man_level_s"]
    assert timing.latch_after_s == safety["dead_man_latch_s"]
    assert timing.clock_gap_s == safety["clock_gap_s"]


def test_what_nobody_said_is_not_so_but_an_estimate_that_nobody_gave_is_lost() -> None:
    nothing = Conditions()
    assert [f.name for f in fields(nothing) if getattr(nothing, f.name)] == ["estimate_lost"]
    assert Facts(IN_HOLD) == Facts(IN_HOLD, None, inf, 0.0, False, 0.0, 0.0, False, False, False)
    assert Lasting() == Lasting(inf, False)
