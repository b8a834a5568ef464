from dataclasses import replace
from math import acos, atan2, cos, exp, hypot, radians, sin

import pytest

from daemon import frames
from daemon.control import vehicle_model
from daemon.control.drag import Drag
from daemon.control.observer import Observer
from daemon.control.parameters import ControlParameters
from daemon.control.vehicle_model import VehicleModel
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reset, Setpoint, Vec3

P = ControlParameters(hover_thrust=0.5, thrust_lag_s=0.06)
G = P.gravity_m_s2
DT = 0.01


def sample(time_s: float, velocity: Vec3 = ZERO3, attitude: Quat = IDENTITY, position: Vec3 = ZERO3) -> EstimatedState:
    return EstimatedState(time_s, position, velocity, attitude, ZERO3)


def thrust(value: float) -> Setpoint:
    return Setpoint(ZERO3, value)


def test_thrust_step_after_dead_time_and_lag_is_no_disturbance() -> None:
    """The body follows the step of thrust exactly: v = -k (t - T (1 - exp(-t / T))) from the moment it acts."""
    model, largest = VehicleModel(hover_thrust=0.5), 0.0
    for i in range(120):
        t = i * DT
        since = max(t - 0.5, 0.0)
        gained = since - 0.06 * (1.0 - exp(-since / 0.06))
        fallen = 0.5 * since**2 - 0.06 * (since - 0.06 * (1.0 - exp(-since / 0.06)))
        speed = -G * 0.2 * gained
        state = sample(t, (0.0, 0.0, speed), position=(0.0, 0.0, -G * 0.2 * fallen))
        model = vehicle_model.observed(model, state, P)
        # sent 30 ms before it acts: the newest commands are not yet in force
        model = vehicle_model.commanded(model, t + 0.03, thrust(0.6 if t + 0.03 >= 0.5 - 1e-9 else 0.5))
        largest = max(largest, abs(model.disturbance_ned_m_s2[2]))
    assert largest < 0.12


@pytest.mark.parametrize(("tilt_deg", "learns"), [(5.0, True), (30.0, False)])
def test_hover_thrust_is_learned_near_level_only(tilt_deg: float, learns: bool) -> None:
    attitude = frames.from_rpy(radians(tilt_deg), 0.0, 0.0)
    model = VehicleModel(hover_thrust=0.5)
    for i in range(200):  # thrust above hover, and yet it does not climb
        model = vehicle_model.observed(model, sample(i * DT, attitude=attitude), P)
        model = vehicle_model.commanded(model, i * DT, thrust(0.7))
    assert (model.hover_thrust > 0.52) is learns
    assert model.disturbance_ned_m_s2[2] > 0.5


def test_bias_of_the_velocity_is_not_taken_for_drag() -> None:
    p = replace(P, drag_1_s=(1.0, 1.0, 1.0))
    model = VehicleModel(hover_thrust=0.5)
    for i in range(500):  # the position stands still: the velocity is wrong
        model = vehicle_model.observed(model, sample(i * DT, (0.8, 0.0, 0.0)), p)
        model = vehicle_model.commanded(model, i * DT, thrust(0.5))
    assert model.velocity_bias_ned_m_s == pytest.approx((0.8, 0.0, 0.0), abs=0.01)
    assert model.disturbance_ned_m_s2 == pytest.approx(ZERO3, abs=0.02)


@pytest.mark.parametrize(("speed_m_s", "believed"), [(0.0, True), (2.0, False)])
def test_first_sample_of_a_leaning_vehicle_shows_the_wind_if_it_is_at_rest(speed_m_s: float, believed: bool) -> None:
    attitude = frames.from_rpy(0.0, 0.4, 0.0)
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0, (speed_m_s, 0.0, 0.0), attitude), P)
    assert (model.disturbance_ned_m_s2[0] > 2.0) is believed


def test_sample_that_is_not_newer_changes_nothing() -> None:
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(1.0), P)
    assert vehicle_model.observed(model, sample(1.0, (5.0, 0.0, 0.0)), P) is model


def test_old_commands_are_forgotten_and_overtaken_ones_dropped() -> None:
    model = VehicleModel(hover_thrust=0.5)
    for i in range(500):
        model = vehicle_model.commanded(model, i * DT, thrust(0.5))
    assert 25 <= len(model.commands) <= 31
    model = vehicle_model.commanded(model, 4.9, thrust(0.6))
    times = [acts_s for acts_s, _ in model.commands]
    assert times == sorted(times) and times[-1] == 4.9 and model.commands[-1][1].thrust == 0.6


@pytest.mark.parametrize(("pitch", "roll"), [(0.2, 0.0), (0.0, 0.2), (0.15, -0.1)])
def test_the_wind_against_which_a_vehicle_at_rest_leans_cancels_its_thrust_sideways(pitch: float, roll: float) -> None:
    attitude = frames.from_rpy(roll, pitch, 0.7)
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0, attitude=attitude), P)
    sideways = frames.scale(frames.down_axis(attitude), -G)
    assert model.disturbance_ned_m_s2 == pytest.approx((-sideways[0], -sideways[1], 0.0))
    assert model.acceleration_ned_m_s2[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(("speed_m_s", "believed"), [(0.45, True), (0.55, False)])
def test_half_a_metre_a_second_is_no_rest(speed_m_s: float, believed: bool) -> None:
    attitude = frames.from_rpy(0.0, 0.2, 0.0)
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0, (0.0, speed_m_s, 0.0), attitude), P)
    assert (model.disturbance_ned_m_s2 != ZERO3) is believed


def test_a_lean_shows_no_wind_while_the_estimate_of_it_is_off_or_later_on() -> None:
    attitude = frames.from_rpy(0.0, 0.2, 0.0)
    off = replace(P, disturbance_bandwidth_rad_s=0.0)
    unseen = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0, attitude=attitude), off)
    assert unseen.disturbance_ned_m_s2 == ZERO3
    slow = replace(P, disturbance_bandwidth_rad_s=0.5)
    first = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0, attitude=attitude), slow)
    assert first.disturbance_ned_m_s2[0] == pytest.approx(G * sin(0.2)), "a slow estimate begins with it too"
    begun = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0), P)
    later = vehicle_model.observed(begun, sample(DT, attitude=attitude), P)
    assert frames.norm(later.disturbance_ned_m_s2) < 0.5


def with_commands(*commands: tuple[float, float]) -> VehicleModel:
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0), P)
    for acts_s, thrust in commands:
        model = vehicle_model.commanded(model, acts_s, Setpoint(ZERO3, thrust))
    return model


def test_thrust_follows_the_command_that_acts_with_its_lag() -> None:
    model = with_commands((0.005, 0.6), (0.03, 0.9))
    model = vehicle_model.observed(model, sample(DT), P)
    assert model.thrust == pytest.approx(0.6 - 0.1 * exp(-DT / 0.06))
    again = vehicle_model.observed(model, sample(2 * DT), P)
    assert again.thrust == pytest.approx(0.6 - 0.1 * exp(-2.0 * DT / 0.06))


def test_a_command_acts_at_its_very_time() -> None:
    model = vehicle_model.observed(with_commands((0.0625, 0.7)), sample(0.0625), replace(P, thrust_lag_s=0.0))
    assert model.thrust == 0.7


@pytest.mark.parametrize(("gap_s", "lag_s"), [(0.01, 0.0), (0.15, 0.06), (0.15, 0.0)])
def test_without_a_lag_or_after_a_gap_the_command_is_the_thrust(gap_s: float, lag_s: float) -> None:
    model = vehicle_model.observed(with_commands((0.005, 0.8)), sample(gap_s), replace(P, thrust_lag_s=lag_s))
    assert model.thrust == 0.8


def test_an_older_sample_changes_nothing() -> None:
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(1.0), P)
    assert vehicle_model.observed(model, sample(0.5, (5.0, 0.0, 0.0)), P) is model


@pytest.mark.parametrize(("commanded", "edge"), [(0.05, 0.02), (0.98, 0.98)])
def test_hover_thrust_stays_that_of_a_vehicle_that_flies(commanded: float, edge: float) -> None:
    """It hangs in the air whatever is commanded; the range about the start would allow more."""
    p = replace(P, hover_thrust=commanded, hover_range=0.9, hover_time_constant_s=0.1, disturbance_max_m_s2=9.0)
    model = VehicleModel(hover_thrust=commanded)
    for i in range(400):
        model = vehicle_model.observed(model, sample(i * DT), p)
        model = vehicle_model.commanded(model, i * DT, thrust(0.01 if edge < 0.5 else 1.0))
    assert model.hover_thrust == pytest.approx(edge, abs=1e-9)


def test_memories_of_the_model_turn_and_shift_with_a_reset() -> None:
    model = VehicleModel(
        hover_thrust=0.5,
        by_velocity=Observer(1.0, (1.0, 2.0, 3.0), (0.5, 0.0, -1.0), (0.2, 0.0, 0.3)),
        by_position=Observer(1.0, (10.0, 20.0, 30.0), (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
        acceleration_ned_m_s2=(1.0, 0.0, 2.0),
    )
    reset = Reset(1.0, frozenset(), (3.0, -4.0, 5.0), (0.1, 0.2, 0.3), radians(90.0))
    after = vehicle_model.shifted(model, reset)
    assert after.by_velocity.quantity == pytest.approx((1.1, 2.2, 3.3))
    assert after.by_velocity.derivative == pytest.approx((0.0, 0.5, -1.0))
    assert after.by_velocity.unexplained == pytest.approx((0.0, 0.2, 0.3))
    assert after.by_position.quantity == pytest.approx((13.0, 16.0, 35.0))
    assert after.by_position.derivative == pytest.approx((1.1, 2.2, 3.3))
    assert after.by_position.unexplained == (0.1, 0.2, 0.3), "the bias is one of the sensors, not of the frame"
    assert after.acceleration_ned_m_s2 == pytest.approx((0.0, 1.0, 2.0))


@pytest.mark.parametrize(
    ("acts_s", "kept"),
    [
        (1.015, (1.0, 1.01, 1.015)),
        (1.02, (1.0, 1.01, 1.02)),
        (0.995, (0.995,)),
        (1.2, (1.0, 1.01, 1.02, 1.2)),
        (1.305, (1.01, 1.02, 1.305)),
        (9.0, (9.0,)),
    ],
)
def test_a_command_replaces_those_that_act_later_and_outlives_the_old(acts_s: float, kept: tuple[float, ...]) -> None:
    model = with_commands((1.0, 0.5), (1.01, 0.6), (1.02, 0.7))
    model = vehicle_model.commanded(model, acts_s, thrust(0.9))
    assert tuple(time_s for time_s, _ in model.commands) == kept
    assert model.commands[-1][1].thrust == 0.9


def weaving(p: ControlParameters, spacing_s: float = DT) -> VehicleModel:
    """Five metres a second to and fro over the ground, in a drag of 0.5 1/s that no model knows, level."""
    model = VehicleModel(hover_thrust=0.5)
    for i in range(round(12.0 / spacing_s)):
        t = i * spacing_s
        v = 5.0 * sin(1.5 * t)
        pitch = atan2(-(7.5 * cos(1.5 * t) + 0.5 * v), G)
        attitude = frames.from_rpy(0.0, pitch, 0.0)
        now = sample(t, (v, 0.0, 0.0), attitude, (-10.0 / 3.0 * cos(1.5 * t), 0.0, 0.0))
        model = vehicle_model.observed(model, now, p, (v, 0.0, 0.0))
        model = vehicle_model.commanded(model, t, thrust(0.5 / cos(pitch)))
    return model


def test_drag_is_learned_unless_it_is_switched_off() -> None:
    on = replace(P, drag_max_1_s=2.0, thrust_lag_s=0.0)
    assert weaving(on).drag.learned_1_s == pytest.approx(0.5, abs=0.15)
    assert weaving(replace(on, drag_max_1_s=0.0)).drag.learned_1_s == 0.0


@pytest.mark.parametrize(("spacing_s", "seen"), [(0.01, True), (0.09, True), (0.11, False)])
def test_lateness_is_seen_by_samples_that_follow_each_other(spacing_s: float, seen: bool) -> None:
    model = vehicle_model.observed(VehicleModel(hover_thrust=0.5), sample(0.0), P)
    assert model.lateness is VehicleModel(hover_thrust=0.5).lateness, "without a command nobody is late"
    model = vehicle_model.commanded(model, 0.0, Setpoint((1.0, 0.0, 0.0), 0.5))
    after = vehicle_model.observed(model, sample(spacing_s), P)
    assert (after.lateness.late_s > 0.0) is seen, "it should turn by now, and does not"


def turning(model: VehicleModel, p: ControlParameters, seconds: float = 12.0, drag_1_s: float = 0.6) -> VehicleModel:
    """Level circles at 4 m/s that the vehicle flies against a drag, leaning as it takes."""
    for i in range(round(seconds / DT)):
        t = i * DT
        c, s = cos(0.8 * t), sin(0.8 * t)
        velocity, acceleration = (4.0 * c, 4.0 * s, 0.0), (-3.2 * s, 3.2 * c, 0.0)
        thrust_vector = (acceleration[0] + drag_1_s * velocity[0], acceleration[1] + drag_1_s * velocity[1], -G)
        length = frames.norm(thrust_vector)
        down = frames.scale(thrust_vector, -1.0 / length)
        attitude = frames.exp(frames.scale((-down[1], down[0], 0.0), acos(down[2]) / hypot(down[0], down[1])))
        state = sample(t, velocity, attitude, (5.0 * s, 5.0 * (1.0 - c), 0.0))
        model = vehicle_model.observed(model, state, p, velocity)
        model = vehicle_model.commanded(model, t, thrust(0.5 * length / G))
    return model


def test_drag_is_learned_with_the_velocity_of_the_reference() -> None:
    model = turning(VehicleModel(hover_thrust=0.5), P)
    assert model.drag.learned_1_s == pytest.approx(0.6, abs=0.06)
    assert frames.norm(model.disturbance_ned_m_s2) < 0.5


def test_drag_is_not_learned_and_is_forgotten_where_nothing_may_be() -> None:
    off = replace(P, drag_max_1_s=0.0)
    model = turning(VehicleModel(hover_thrust=0.5), off, 2.0)
    assert model.drag.learned_1_s == 0.0
    known = turning(VehicleModel(hover_thrust=0.5), P)
    later = vehicle_model.observed(known, sample(20.0), off)
    assert later.drag.learned_1_s == 0.0


def test_a_pause_keeps_what_was_learned_of_the_vehicle_and_forgets_the_flight() -> None:
    known = turning(VehicleModel(hover_thrust=0.45), P)
    model = vehicle_model.restarted(known)
    assert (model.hover_thrust, model.drag.learned_1_s) == (known.hover_thrust, known.drag.learned_1_s)
    assert (model.commands, model.thrust, model.disturbance_ned_m_s2) == ((), None, ZERO3)


def test_a_reset_moves_the_memory_of_the_drag_too() -> None:
    known = turning(VehicleModel(hover_thrust=0.5), P)
    after = vehicle_model.shifted(known, Reset(1.0, frozenset({"velocity_ne"}), velocity_ned_m_s=(2.0, 3.0, 0.0)))
    before = known.drag.steady_velocity_ne_m_s or (0.0, 0.0)
    assert after.drag.steady_velocity_ne_m_s == pytest.approx((before[0] + 2.0, before[1] + 3.0))


def test_a_vehicle_that_turns_late_is_seen_to_be_late() -> None:
    """Rates follow the commands exactly as modelled, 40 ms later."""
    model, first, second = VehicleModel(hover_thrust=0.5), 0.0, 0.0
    for i in range(400):
        t = i * DT
        for k in range(10):
            acting = 3.0 if (t + k * 0.001 - 0.04) % 1.0 < 0.2 else 0.0
            first += (acting - first) * 0.001 / P.rate_lag_s[0]
            second += (first - second) * 0.001 / 0.03
        rates = (second, 0.0, 0.0)
        model = vehicle_model.commanded(model, t, Setpoint((3.0 if t % 1.0 < 0.2 else 0.0, 0.0, 0.0), 0.5))
        model = vehicle_model.observed(model, EstimatedState(t + DT, ZERO3, ZERO3, IDENTITY, rates), P)
    assert model.lateness.late_s == pytest.approx(0.045, abs=0.015)
    gap = vehicle_model.observed(model, EstimatedState(5.0, ZERO3, ZERO3, IDENTITY, (9.0, 0.0, 0.0)), P)
    assert gap.lateness is model.lateness


@pytest.mark.parametrize(("spacing_s", "learns"), [(0.01, True), (0.09, True), (0.11, False)])
def test_hover_thrust_is_learned_from_samples_that_follow_each_other(spacing_s: float, learns: bool) -> None:
    """A vehicle that is pulled down: what is known of it serves no learning over a gap."""
    pulled = Observer(0.0, unexplained=(0.0, 0.0, 2.0))
    model = replace(VehicleModel(hover_thrust=0.5), thrust=0.5, by_velocity=pulled)
    after = vehicle_model.observed(model, sample(spacing_s), P)
    assert (after.hover_thrust > 0.5) is learns


def test_a_gap_teaches_no_more_drag_than_the_longest_step_between_samples() -> None:
    """Drag changes by at most 0.5 1/s each second: 0.05 1/s in 0.1 s, whatever the gap."""
    against = Observer(0.0, unexplained=(-3.0, 0.0, 0.0))
    known = Drag(steady_velocity_ne_m_s=(0.0, 0.0))
    model = replace(VehicleModel(hover_thrust=0.5), thrust=0.5, by_velocity=against, drag=known)
    velocity = (2.0, 0.0, 0.0)
    after = vehicle_model.observed(model, sample(0.5, velocity), P, velocity)
    assert after.drag.learned_1_s == pytest.approx(0.05)
