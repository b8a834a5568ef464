from dataclasses import replace
from math import exp, radians

import pytest

from daemon import frames
from daemon.control import vehicle_model
from daemon.control.parameters import ControlParameters
from daemon.control.vehicle_model import VehicleModel
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Vec3

P = ControlParameters(hover_thrust=0.5, thrust_lag_s=0.06)
G = P.gravity_m_s2
DT = 0.01


def sample(time_s: float, velocity: Vec3 = ZERO3, attitude: Quat = IDENTITY, position: Vec3 = ZERO3) -> EstimatedState:
    return EstimatedState(time_s, position, velocity, attitude, ZERO3)


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
        model = vehicle_model.commanded(model, t + 0.03, 0.6 if t + 0.03 >= 0.5 - 1e-9 else 0.5)
        largest = max(largest, abs(model.disturbance_ned_m_s2[2]))
    assert largest < 0.12


@pytest.mark.parametrize(("tilt_deg", "learns"), [(5.0, True), (30.0, False)])
def test_hover_thrust_is_learned_near_level_only(tilt_deg: float, learns: bool) -> None:
    attitude = frames.from_rpy(radians(tilt_deg), 0.0, 0.0)
    model = VehicleModel(hover_thrust=0.5)
    for i in range(200):  # thrust above hover, and yet it does not climb
        model = vehicle_model.observed(model, sample(i * DT, attitude=attitude), P)
        model = vehicle_model.commanded(model, i * DT, 0.7)
    assert (model.hover_thrust > 0.52) is learns
    assert model.disturbance_ned_m_s2[2] > 0.5


def test_bias_of_the_velocity_is_not_taken_for_drag() -> None:
    p = replace(P, drag_1_s=(1.0, 1.0, 1.0))
    model = VehicleModel(hover_thrust=0.5)
    for i in range(500):  # the position stands still: the velocity is wrong
        model = vehicle_model.observed(model, sample(i * DT, (0.8, 0.0, 0.0)), p)
        model = vehicle_model.commanded(model, i * DT, 0.5)
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
        model = vehicle_model.commanded(model, i * DT, 0.5)
    assert 25 <= len(model.commands) <= 31
    model = vehicle_model.commanded(model, 4.9, 0.6)
    times = [acts_s for acts_s, _ in model.commands]
    assert times == sorted(times) and times[-1] == 4.9 and model.commands[-1][1] == 0.6
