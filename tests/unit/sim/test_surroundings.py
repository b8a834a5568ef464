"""Wind and battery."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.messages import ZERO3
from daemon.sim import airframe_files
from daemon.sim.battery import BatteryState
from daemon.sim.noise import Coloured, normals
from daemon.sim.wind import Gust, Wind


def test_steady_wind_blows_all_the_time():
    wind = Wind(normals(1))
    assert wind.step(0.004, 5.0) == ZERO3
    wind.steady_ned_m_s = (3.0, 1.0, 0.0)
    assert wind.step(0.004, 5.0) == (3.0, 1.0, 0.0)


def test_a_gust_rises_to_its_peak_and_is_gone():
    wind = Wind(normals(1))
    wind.gust(Gust((8.0, 0.0, 0.0), 2.0))
    north = [wind.step(0.004, 5.0)[0] for _ in range(600)]
    assert max(north) == pytest.approx(8.0, rel=1e-3)
    assert np.argmax(north) * 0.004 == pytest.approx(1.0, abs=0.01)
    assert north[250:252] == pytest.approx([8.0, 8.0], rel=1e-3)
    assert north[520:] == [0.0] * 80


def test_turbulence_has_drydens_intensity_and_length():
    """MIL-F-8785C at 6 m: horizontal length h / (0.177 + 0.000823 h)^1.2 (h in feet), vertical the height."""
    wind = Wind(normals(3))
    wind.steady_ned_m_s, wind.turbulence_m_s = (6.0, 0.0, 0.0), 1.5
    values = np.array([wind.step(0.02, 6.096) for _ in range(200_000)]) - (6.0, 0.0, 0.0)
    assert values.std(axis=0)[:2] == pytest.approx(1.5, rel=0.1)
    assert values.std(axis=0)[2] == pytest.approx(1.5 * (0.177 + 0.000823 * 20.0) ** 0.4, rel=0.1)
    length_m = 0.3048 * 20.0 / (0.177 + 0.000823 * 20.0) ** 1.2
    lag = round(length_m / 6.0 / 0.02)
    north = values[:, 0]
    correlation = np.mean(north[:-lag] * north[lag:]) / np.mean(north**2)
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.1)


def test_coloured_noise_has_unit_spread_and_its_time_constant():
    draw, noise = normals(5), Coloured(0.5, 0.01)
    values = np.array([noise.update(next(draw)) for _ in range(100_000)])
    assert values.std() == pytest.approx(1.0, rel=0.05)
    assert np.mean(values[:-50] * values[50:]) == pytest.approx(np.exp(-1.0), abs=0.06)


def test_the_battery_empties_at_the_simulated_pace_and_only_while_armed():
    battery = BatteryState(airframe_files.load("sih").battery)
    for _ in range(1000):
        battery.step(0.01, False, 1.0, 30.0, 0.02)
    assert (battery.fraction, battery.voltage_v) == pytest.approx((1.0, 16.2))
    for _ in range(2000):
        battery.step(0.01, True, 1.0, 30.0, 0.02)
    assert battery.fraction == pytest.approx(1.0 - (20.0 - 1.3) / 30.0, abs=0.005)
    for _ in range(3000):
        battery.step(0.01, True, 1.0, 30.0, 0.02)
    assert battery.fraction == pytest.approx(0.02, abs=1e-3)
    assert battery.voltage_v == pytest.approx(4 * (3.6 + 0.02 * 0.45), abs=0.01)


def test_the_voltage_sags_under_load_and_takes_thrust_with_it():
    x500 = airframe_files.load("x500").battery
    battery = BatteryState(replace(x500, resistance_ohm=0.05))
    fresh = battery.voltage_v
    assert battery.thrust_share == pytest.approx(1.0)
    for _ in range(100):
        battery.step(0.01, True, 1.0, 0.0, 0.0)
    assert fresh - battery.voltage_v == pytest.approx(18.0 * 0.05, rel=0.01)
    assert battery.thrust_share == pytest.approx((battery.voltage_v / 16.2) ** 2)
    assert BatteryState(airframe_files.load("sih").battery).thrust_share == 1.0
