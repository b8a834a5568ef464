"""Rates, thrust, wind and drag: the recorded setpoints flown by the simulated vehicle without noise."""

from dataclasses import replace

import numpy as np
import pytest

AXES = {"roll": 2, "pitch": 3, "yaw": 4}
STALLS = (11.9, 56.3, 59.4, 63.3, 67.4)  # the recording machine's own


@pytest.fixture(scope="module")
def steps(request):
    """The recording of rate and thrust pulses, and the same setpoints flown: both as [t, vz, p, q, r]."""
    load, make = request.getfixturevalue("recording"), request.getfixturevalue("flight")
    recorded = load("offboard_hover_rate_steps")
    simulated = make(10.0)
    simulated.command(511, 115.0, 20000.0)
    simulated.replay(recorded, 68.4, {2.1: lambda: simulated.command(176, 129.0, 6.0, 0.0)})
    table = recorded.table("rx:HIL_STATE_QUATERNION")
    table[:, 1] *= 0.01
    mine = simulated.column("HIL_STATE_QUATERNION", "vz", "rollspeed", "pitchspeed", "yawspeed")
    mine[:, 1] *= 0.01
    return recorded, table, mine


def pulses(recorded, axis):
    """(time, amplitude in rad/s or share of hover, duration) of the pulses that no stall hit."""
    found = []
    for t, who, text, _ in recorded.slow:
        words = text.split()
        stalled = any(-0.3 < stall - t < 0.9 for stall in STALLS)
        if who == "note" and words[:2] == ["pulse", axis] and not stalled:
            number = words.index("s") - 1
            found.append((t, float(words[2]), float(words[number])))
    return found


def mean_response(rows, column, chosen):
    grid = np.arange(0.0, 0.62, 0.005)
    return grid, np.mean(
        [np.interp(t + grid, rows[:, 0], rows[:, column]) / np.radians(a) for t, a, _ in chosen], axis=0
    )


def crossing(grid, response, level):
    return grid[np.argmax(response >= level)]


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize("size", [40.0, 90.0])
def test_roll_and_pitch_rates_rise_and_overshoot_as_recorded(steps, axis, size):
    recorded, table, mine = steps
    chosen = [p for p in pulses(recorded, axis) if abs(p[1]) == size]
    assert len(chosen) >= 2
    inside = slice(0, int(chosen[0][2] / 0.005))
    grid, wanted = mean_response(table, AXES[axis], chosen)
    _, got = mean_response(mine, AXES[axis], chosen)
    for level in (0.2, 0.5, 0.9):
        assert crossing(grid, got, level) == pytest.approx(crossing(grid, wanted, level), abs=0.015), level
    assert got[inside].max() == pytest.approx(wanted[inside].max(), abs=0.05)


@pytest.mark.parametrize("size", [40.0, 90.0])
def test_yaw_rate_is_slow_as_recorded(steps, size):
    recorded, table, mine = steps
    chosen = [p for p in pulses(recorded, "yaw") if abs(p[1]) == size]
    grid, wanted = mean_response(table, 4, chosen)
    _, got = mean_response(mine, 4, chosen)
    for level in (0.2, 0.5, 0.7):
        assert crossing(grid, got, level) == pytest.approx(crossing(grid, wanted, level), abs=0.02), level
    assert got.max() == pytest.approx(wanted.max(), abs=0.03)
    assert got.max() < 0.85


@pytest.mark.parametrize(("axis", "rms"), [("roll", 0.040), ("pitch", 0.025), ("yaw", 0.010)])
def test_rates_stay_within_the_recorded_jitter_for_40_s(steps, axis, rms):
    """Residual of the truth's rates in rad/s; the recorded vehicle's own jitter is 0.063, 0.025, 0.010."""
    _, table, mine = steps
    chosen = table[(table[:, 0] > 9.0) & (table[:, 0] < 49.0)]
    error = chosen[:, AXES[axis]] - np.interp(chosen[:, 0], mine[:, 0], mine[:, AXES[axis]])
    assert np.sqrt(np.mean(error**2)) < rms


def test_thrust_pulses_change_the_vertical_speed_as_recorded(steps):
    recorded, table, mine = steps
    chosen = pulses(recorded, "thrust")
    assert len(chosen) >= 5
    after = np.array([0.1, 0.2, 0.3, 0.4])
    errors = []
    for t, share, _ in chosen:
        wanted = np.interp(t + after, table[:, 0], table[:, 1]) - np.interp(t, table[:, 0], table[:, 1])
        got = np.interp(t + after, mine[:, 0], mine[:, 1]) - np.interp(t, mine[:, 0], mine[:, 1])
        errors.append((got - wanted) / (share / 10.0))
    # per 10 % of hover thrust the speed changes by 0.26 m/s in 0.4 s; speeds are quantized to 1 cm/s
    assert np.abs(np.mean(errors, axis=0)).max() < 0.02
    assert np.abs(errors).max() < 0.07


def test_wind_tilts_the_hovering_vehicle_as_recorded(recording, flight):
    """5 m/s against linear drag of 1 N/(m/s) on 1 kg: 27 degrees."""
    recorded = recording("offboard_wind")
    rows = recorded.table("rx:HIL_STATE_QUATERNION")
    blown = rows[(rows[:, 0] > 15.0) & (rows[:, 0] < 24.0), 1:5]
    tilt = np.degrees(2.0 * np.arctan2(np.hypot(blown[:, 1], blown[:, 2]), np.hypot(blown[:, 0], blown[:, 3]))).mean()
    simulated = flight(10.0)
    simulated.px4.wind.steady_ned_m_s = (5.0, 0.0, 0.0)
    simulated.command(511, 115.0, 20000.0)
    simulated.run(15.0)
    q = simulated.column("HIL_STATE_QUATERNION", "attitude_quaternion")[-1, 1:5]
    mine = np.degrees(2.0 * np.arctan2(np.hypot(q[1], q[2]), np.hypot(q[0], q[3])))
    assert mine == pytest.approx(tilt, abs=1.0)
    assert simulated.px4.navigator.setpoint.thrust == pytest.approx(0.4905 / np.cos(np.radians(27.0)), abs=0.02)


def test_a_lemniscate_is_flown_as_recorded_from_the_same_setpoints(recording, flight):
    """Open loop, so the vehicle starts from the recorded attitude and velocity every five seconds, and flies one."""
    recorded = recording("offboard_lemniscate")
    rows = recorded.table("rx:HIL_STATE_QUATERNION")
    errors = []
    for begin in np.arange(20.0, 70.0, 5.0):
        first = rows[np.searchsorted(rows[:, 0], begin)]
        last = rows[np.searchsorted(rows[:, 0], begin + 1.0)]
        simulated = flight(50.0)

        def start_anew(px4=simulated.px4, first=first):
            px4.truth = replace(
                px4.truth,
                velocity_ned_m_s=tuple(first[5:8] / 100.0),
                attitude_wb=tuple(first[1:5] / np.linalg.norm(first[1:5])),
                rates_frd_rad_s=tuple(first[8:11]),
            )

        at = {first[0] - 0.4: lambda s=simulated: s.command(176, 1.0, 6.0), first[0]: start_anew}
        simulated.replay(recorded, last[0], at, first[0] - 0.5)
        assert simulated.acks() == [(176, 0), (176, 0)]
        errors.append(np.linalg.norm(np.array(simulated.px4.truth.velocity_ned_m_s) - last[5:8] / 100.0))
    # m/s after a second at 3 to 5 m/s; what is left is the drift of the open loop and the recorded vehicle's gyro noise
    assert np.median(errors) < 0.3
