"""The simulated vehicle against physics and against rotorpy."""

from dataclasses import replace
from math import exp, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from daemon.frames import rotate
from daemon.messages import IDENTITY
from daemon.sim import airframe_files
from daemon.sim.vehicle import SIM_GRAVITY_M_S2, Surroundings, VehicleState, step

DT = 0.004
SIH = airframe_files.load("sih")
X500 = airframe_files.load("x500")
BARE = replace(SIH, drag_n_s_m=(0.0, 0.0, 0.0), angular_damping_nm_s=0.0)
OPEN_SKY = Surroundings(has_ground=False)
OFF = (0.0, 0.0, 0.0, 0.0)
HIGH = VehicleState(position_ned_m=(0.0, 0.0, -100.0), on_ground=False)


def fly(state, commands, airframe, surroundings, seconds, dt=DT):
    for _ in range(round(seconds / dt)):
        state = step(state, commands, airframe, surroundings, dt)
    return state


def test_free_fall_without_air_is_half_g_t_squared():
    end = fly(HIGH, OFF, BARE, OPEN_SKY, 3.0)
    assert end.position_ned_m[2] + 100.0 == pytest.approx(0.5 * SIM_GRAVITY_M_S2 * 9.0, rel=1e-9)
    assert end.velocity_ned_m_s[2] == pytest.approx(SIM_GRAVITY_M_S2 * 3.0, rel=1e-9)
    assert end.specific_force_frd_m_s2 == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_fall_with_linear_drag_follows_the_exponential_to_terminal_velocity():
    """v = (m g / d) (1 - exp(-d t / m))."""
    end = fly(HIGH, OFF, SIH, OPEN_SKY, 2.0)
    assert end.velocity_ned_m_s[2] == pytest.approx(SIM_GRAVITY_M_S2 * (1.0 - exp(-2.0)), rel=1e-5)
    end = fly(HIGH, OFF, SIH, OPEN_SKY, 20.0)
    assert end.velocity_ned_m_s[2] == pytest.approx(SIM_GRAVITY_M_S2, rel=1e-6)


def test_wind_carries_a_falling_vehicle_to_its_own_speed():
    end = fly(HIGH, OFF, SIH, replace(OPEN_SKY, wind_ned_m_s=(4.0, -3.0, 0.0)), 20.0)
    assert end.velocity_ned_m_s[:2] == pytest.approx((4.0, -3.0), abs=1e-6)


def test_energy_is_kept_without_air_and_thrust():
    start = replace(HIGH, velocity_ned_m_s=(7.0, -2.0, -5.0), rates_frd_rad_s=(2.0, -1.0, 3.0))

    def energy(state):
        v, w = np.array(state.velocity_ned_m_s), np.array(state.rates_frd_rad_s)
        turning = 0.5 * np.dot(BARE.inertia_kg_m2, w**2)
        return 0.5 * v @ v - SIM_GRAVITY_M_S2 * state.position_ned_m[2] + turning

    end = fly(start, OFF, BARE, OPEN_SKY, 5.0)
    assert energy(end) == pytest.approx(energy(start), rel=1e-6)


def test_torque_free_rotation_follows_eulers_equation():
    """A tumbling body about its middle axis: rates against scipy, angular momentum fixed in space."""
    body = replace(BARE, inertia_kg_m2=(0.02, 0.03, 0.05))
    inertia = np.array(body.inertia_kg_m2)
    start = replace(HIGH, rates_frd_rad_s=(0.1, 5.0, 0.2))
    end = fly(start, OFF, body, OPEN_SKY, 3.0)
    wanted = solve_ivp(
        lambda _, w: -np.cross(w, inertia * w) / inertia, (0.0, 3.0), (0.1, 5.0, 0.2), rtol=1e-10, atol=1e-12
    ).y[:, -1]
    assert end.rates_frd_rad_s == pytest.approx(wanted, abs=0.02)
    before = inertia * start.rates_frd_rad_s
    after = rotate(end.attitude_wb, tuple(inertia * end.rates_frd_rad_s))
    assert after == pytest.approx(before, abs=0.003 * np.linalg.norm(before))


def test_motors_lag_by_their_time_constant_and_saturate():
    state = fly(HIGH, (1.0, 0.5, 2.0, -1.0), SIH, OPEN_SKY, 0.052)
    share = 1.0 - exp(-0.052 / 0.05)
    assert state.signals == pytest.approx((share, 0.5 * share, share, 0.0), rel=1e-9)


@pytest.mark.parametrize(("curve", "thrust"), [(0.0, 0.6), (1.0, 0.36), (0.5, 0.48)])
def test_thrust_over_signal_has_the_curve_of_thr_mdl_fac(curve, thrust):
    body = replace(BARE, thrust_curve=curve, motor_time_constant_s=0.0)
    state = step(HIGH, (0.6, 0.6, 0.6, 0.6), body, OPEN_SKY, DT)
    assert -state.specific_force_frd_m_s2[2] == pytest.approx(thrust * 4 * 5.0 / 1.0, rel=1e-9)


def test_each_rotor_turns_the_body_to_its_side():
    body = replace(BARE, motor_time_constant_s=0.0)
    for rotor, commands in enumerate(np.eye(4)):
        x, y = body.rotors[rotor].x_m, body.rotors[rotor].y_m
        p, q, r = step(HIGH, tuple(commands), body, OPEN_SKY, DT).rates_frd_rad_s
        assert (p, q) == pytest.approx((-y * 5.0 / 0.025 * DT, x * 5.0 / 0.025 * DT), rel=1e-3)
        assert r * body.rotors[rotor].torque_nm_per_n > 0.0


def test_hover_thrust_holds_the_height():
    hover = SIH.hover_thrust
    start = replace(HIGH, signals=(hover,) * 4)
    assert fly(start, (hover,) * 4, SIH, OPEN_SKY, 5.0).position_ned_m == pytest.approx((0.0, 0.0, -100.0), abs=1e-9)
    assert hover == pytest.approx(0.4905, rel=1e-6)


def test_the_ground_carries_and_lets_go():
    fallen = fly(replace(HIGH, position_ned_m=(0.0, 0.0, -5.0)), OFF, SIH, Surroundings(), 5.0)
    assert fallen.on_ground
    assert fallen.position_ned_m == (0.0, 0.0, 0.0)
    assert fallen.velocity_ned_m_s == fallen.rates_frd_rad_s == (0.0, 0.0, 0.0)
    assert fallen.specific_force_frd_m_s2 == pytest.approx((0.0, 0.0, -SIM_GRAVITY_M_S2))
    pressed = fly(fallen, (0.4,) * 4, SIH, Surroundings(wind_ned_m_s=(9.0, 0.0, 0.0)), 2.0)
    assert pressed.on_ground
    assert pressed.position_ned_m == (0.0, 0.0, 0.0)
    assert not fly(fallen, (0.6,) * 4, SIH, Surroundings(), 1.0).on_ground


def test_payload_and_a_weak_rotor_change_the_forces():
    body = replace(BARE, motor_time_constant_s=0.0)
    heavy = step(HIGH, (0.5,) * 4, body, replace(OPEN_SKY, payload_kg=0.25), DT)
    assert -heavy.specific_force_frd_m_s2[2] == pytest.approx(10.0 / 1.25)
    weak = step(HIGH, (0.5,) * 4, body, replace(OPEN_SKY, rotor_efficiency=(0.8, 1.0, 1.0, 1.0)), DT)
    assert -weak.specific_force_frd_m_s2[2] == pytest.approx(9.5)
    assert weak.rates_frd_rad_s[0] > 0.0  # rotor 0 is front right: the right side sinks


def test_the_step_is_of_second_order():
    """Half the step, a quarter of the error."""
    start = replace(HIGH, velocity_ned_m_s=(3.0, 0.0, 0.0), rates_frd_rad_s=(1.0, 2.0, 0.5), signals=(0.5,) * 4)
    commands = (0.52, 0.5, 0.49, 0.51)
    ends = [np.array(fly(start, commands, SIH, OPEN_SKY, 0.512, dt).position_ned_m) for dt in (0.008, 0.004, 0.0005)]
    coarse, fine = np.linalg.norm(ends[0] - ends[2]), np.linalg.norm(ends[1] - ends[2])
    assert 3.0 < coarse / fine < 5.5


def test_x500_flies_as_rotorpy_does():
    """Same airframe (quadratic thrust, rotor drag, no body drag), same changing commands, two seconds."""
    from rotorpy.vehicles.multirotor import Multirotor

    body = replace(X500, drag_n_s_m=(0.0, 0.0, 0.0), angular_damping_nm_s=0.0)
    fastest = 1000.0
    k_eta = body.rotor_max_thrust_n / fastest**2
    hover = sqrt(body.hover_thrust)
    parameters = {
        "mass": body.mass_kg,
        **dict(zip(("Ixx", "Iyy", "Izz"), body.inertia_kg_m2, strict=True)),
        **dict.fromkeys(("Ixy", "Ixz", "Iyz"), 0.0),
        "num_rotors": 4,
        "rotor_pos": {f"r{i}": np.array([rotor.x_m, -rotor.y_m, 0.0]) for i, rotor in enumerate(body.rotors)},
        "rotor_directions": np.array([-np.sign(rotor.torque_nm_per_n) for rotor in body.rotors]),
        "rotor_speed_min": 0.0,
        "rotor_speed_max": fastest,
        "k_eta": k_eta,
        "k_m": 0.016 * k_eta,
        "k_d": body.rotor_drag_n_s_m[0] / fastest,
        "k_z": body.rotor_drag_n_s_m[2] / fastest,
        "tau_m": body.motor_time_constant_s,
    }
    other = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, hover * fastest),
    }
    reference = Multirotor(parameters, other, integrator_kwargs={"method": "RK45", "rtol": 1e-7, "atol": 1e-9})
    mine = replace(HIGH, position_ned_m=(0.0, 0.0, 0.0), signals=(hover,) * 4)
    for index in range(500):
        t = index * DT
        turn = 0.004 * np.sin(2.0 * np.pi * t)
        commands = np.clip(hover * (1.0 + 0.05 * np.sin(3.0 * t)) + turn * np.array([1.0, -1.0, -0.5, 0.5]), 0.0, 1.0)
        other = reference.step(other, {"cmd_motor_speeds": commands * fastest}, DT)
        mine = step(mine, tuple(commands.tolist()), body, OPEN_SKY, DT)
    x, y, z = other["x"]
    travelled = np.linalg.norm(other["x"])
    assert travelled > 0.3
    assert mine.position_ned_m == pytest.approx((x, -y, -z), abs=0.01 * travelled)
    vx, vy, vz = other["v"]
    assert mine.velocity_ned_m_s == pytest.approx((vx, -vy, -vz), abs=0.01 * max(1.0, np.linalg.norm(other["v"])))
    i, j, k, w = other["q"]
    alignment = abs(np.dot(mine.attitude_wb, (w, i, -j, -k)))
    assert np.degrees(2.0 * np.arccos(min(1.0, alignment))) < 0.3


numbers = st.floats(allow_nan=True, allow_infinity=True)


@settings(deadline=None, max_examples=60)
@given(st.tuples(numbers, numbers, numbers, numbers))
def test_any_command_gives_a_finite_state(commands):
    state = fly(HIGH, commands, SIH, Surroundings(), 0.2)
    values = (*state.position_ned_m, *state.velocity_ned_m_s, *state.attitude_wb, *state.rates_frd_rad_s)
    assert np.isfinite(values).all()
    assert sum(q * q for q in state.attitude_wb) == pytest.approx(1.0, abs=1e-9)
    assert HIGH.attitude_wb == IDENTITY
