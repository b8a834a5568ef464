"""What the controller learns and remembers in flight, and what resets and pauses do to it."""

from dataclasses import replace
from math import atan2, cos, nan, sin

import pytest
from support.controller_rig import DT, HERE, P, at, flown

from daemon import frames
from daemon.control import controller
from daemon.messages import ZERO3, Reference, Reset


def test_heading_reset_does_not_change_the_command_in_the_body() -> None:
    turn = 0.5
    wind = (0.5, 0.2, 0.0)  # velocity grows by it, unexplained
    state, t = controller.initial(P), 0.0
    for i in range(100):
        t = i * DT
        x, v = frames.add(HERE, frames.scale(wind, 0.5 * t * t)), frames.scale(wind, t)
        now = at(t, x, v)
        state, before, record = controller.step(state, now, now, Reference(t, x, v), DT, parameters=P)
    assert record.disturbance_ned_m_s2[0] > 0.4
    state = controller.shifted(state, Reset(t, frozenset({"heading"}), yaw_rad=turn))
    t += DT
    now = at(t, x, v, frames.from_yaw(turn))
    kept = replace(P, disturbance_bandwidth_rad_s=1e-6, velocity_bias_bandwidth_rad_s=1e-6)
    state, after, record = controller.step(state, now, now, Reference(t, x, v, yaw_rad=turn), DT, parameters=kept)
    assert after.thrust == pytest.approx(before.thrust, abs=2e-3)
    down = frames.down_axis(frames.multiply(frames.conjugate(now.attitude_wb), record.desired_wb))
    expected = frames.rotate_inverse(frames.from_yaw(turn), frames.rotate_about_down(wind, turn))
    # leans into the wind, as seen from the body
    assert down[0] * expected[1] == pytest.approx(down[1] * expected[0], abs=2e-3)


def test_velocity_reset_is_no_disturbance() -> None:
    state, _ = flown(controller.initial(P), 100)
    jump = (2.0, -1.0, 0.5)
    reset = Reset(state.time_s, frozenset({"velocity_ne", "velocity_d"}), velocity_ned_m_s=jump)
    state = controller.shifted(state, reset)
    t = state.time_s + DT
    now = at(t, position=frames.add(HERE, frames.scale(jump, DT)), velocity=jump)
    _, _, record = controller.step(state, now, now, Reference(t, HERE, jump), DT, parameters=P)
    assert frames.norm(record.disturbance_ned_m_s2) < 0.02


def test_position_reset_is_no_velocity_bias() -> None:
    state, _ = flown(controller.initial(P), 100)
    jump = (3.0, -1.0, 0.5)
    state = controller.shifted(state, Reset(state.time_s, frozenset({"position_ne"}), position_ned_m=jump))
    t = state.time_s + DT
    now = at(t, position=frames.add(HERE, jump))
    _, _, record = controller.step(state, now, now, Reference(t, HERE), DT, parameters=P)
    assert frames.norm(record.velocity_bias_ned_m_s) < 1e-9


def test_bias_of_the_velocity_is_learned_and_taken_off() -> None:
    bias = (0.3, -0.2, 0.1)
    state, _ = flown(controller.initial(P), 400, velocity=bias)
    t = state.time_s + DT
    now = at(t, velocity=bias)
    _, _, record = controller.step(state, now, now, Reference(t, HERE), DT, parameters=P)
    assert record.velocity_bias_ned_m_s == pytest.approx(bias, abs=1e-3)
    assert record.velocity_error_ned_m_s == pytest.approx(ZERO3, abs=1e-3)


def test_predicted_position_is_freed_of_the_bias_over_the_time_of_prediction() -> None:
    bias = (0.3, -0.2, 0.1)
    state, _ = flown(controller.initial(P), 400, velocity=bias)
    t = state.time_s + DT
    ahead = at(t + 0.05, frames.add(HERE, frames.scale(bias, 0.05)), bias)
    _, _, record = controller.step(state, at(t, velocity=bias), ahead, Reference(t + 0.05, HERE), DT, parameters=P)
    assert record.position_error_ned_m == pytest.approx(ZERO3, abs=1e-3)


def test_pause_forgets_the_flow_but_keeps_the_hover_thrust() -> None:
    state, _ = flown(controller.initial(P), 300, velocity=ZERO3, position=(3.0, -2.0, -9.7))
    learned = state.hover_thrust
    assert learned != P.hover_thrust
    t = state.time_s + 10.0
    state, setpoint, record = controller.step(state, at(t), at(t), Reference(t, HERE), DT, parameters=P)
    assert record.disturbance_ned_m_s2 == ZERO3 and state.hover_thrust == learned
    assert setpoint.thrust == pytest.approx(learned)


@pytest.mark.parametrize(("pause_s", "forgotten"), [(0.45, False), (0.55, True)])
def test_a_pause_of_half_a_second_is_forgotten_after(pause_s: float, forgotten: bool) -> None:
    state, _ = flown(controller.initial(P), 30, position=(3.0, -2.0, -9.0))  # climbs: thrust is high
    t = state.time_s + pause_s
    slow = replace(P, thrust_slew_max_1_s=0.01)
    _, setpoint, _ = controller.step(state, at(t), at(t), Reference(t, HERE), DT, parameters=slow)
    assert state.setpoint is not None
    assert (setpoint.thrust < state.setpoint.thrust - 0.01) is forgotten


def test_a_state_that_is_predicted_for_a_moment_before_its_own_is_not_moved_back() -> None:
    state, _ = flown(controller.initial(P), 400, velocity=(0.3, -0.2, 0.1))
    t = state.time_s + DT
    now = at(t, velocity=(0.3, -0.2, 0.1))
    before = at(t - 0.3, velocity=(0.3, -0.2, 0.1))
    _, _, record = controller.step(state, now, before, Reference(t, HERE), DT, parameters=P)
    assert record.position_error_ned_m == pytest.approx(ZERO3, abs=1e-12)


@pytest.mark.parametrize("bad", [False, True])
def test_drag_is_learned_with_the_velocity_of_the_reference_and_not_without_one(bad: bool) -> None:
    """Five metres a second to and fro in a drag of 0.5 1/s that was not configured; the vehicle follows exactly."""
    p = replace(P, drag_max_1_s=2.0, thrust_lag_s=0.0)
    state = controller.initial(p)
    for i in range(1200):
        t = i * DT
        x, v, a = -10.0 / 3.0 * cos(1.5 * t), 5.0 * sin(1.5 * t), 7.5 * cos(1.5 * t)
        pitch = atan2(-(a + 0.5 * v), P.gravity_m_s2)
        now = at(t, (x, 0.0, -5.0), (v, 0.0, 0.0), frames.from_rpy(0.0, pitch, 0.0))
        reference = Reference(t, (x, 0.0, -5.0), (v, 0.0, 0.0), (a, 0.0, 0.0), yaw_rad=nan if bad else 0.0)
        state, _, record = controller.step(state, now, now, reference, DT, parameters=p)
    assert (record.drag_learned_1_s > 0.1) is not bad
