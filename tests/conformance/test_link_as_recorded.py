"""Streams, intervals, stamps, parameters, time synchronisation and the client's start-up, against recordings."""

import numpy as np
import pytest

SIMULATED_SECOND = 0.984  # of wall time in the recordings: everything there is this much slower


def test_default_rates_are_those_of_the_onboard_link(recording, flight):
    recorded = recording("connect_idle")
    with_rates = recorded.dense  # the fixture holds the mean rates of a vehicle that nobody asked for anything
    assert with_rates == {}
    simulated = flight()
    simulated.run(12.0)
    counts = {}
    for t, name, _ in simulated.messages:
        if t > 2.0:
            counts[name] = counts.get(name, 0) + 1
    for name, rate in recorded.rates.items():
        assert counts.get(name, 0) / 10.0 * SIMULATED_SECOND == pytest.approx(rate, rel=0.1, abs=0.1), name


def test_the_start_up_of_mavsdk_is_answered_as_recorded(recording, flight):
    recorded = recording("connect_idle")
    simulated = flight().replay(recorded, 24.0)
    assert simulated.acks() == recorded.acks()
    assert len(simulated.select("AUTOPILOT_VERSION")) == 1
    (version,) = simulated.select("AUTOPILOT_VERSION")
    assert version[0] == pytest.approx(recorded.select("AUTOPILOT_VERSION")[0][0], abs=0.02)
    assert [f["result"] for _, f in simulated.select("COMMAND_ACK")] == [0, 0, 0]
    assert all(f["target_component"] == 195 for _, f in simulated.select("COMMAND_ACK"))
    answers = [f for _, f in simulated.select("TIMESYNC") if f["tc1"] != 0]
    assert len(answers) == len([f for _, f in recorded.select("TIMESYNC") if f["tc1"] != 0])
    assert answers[0]["tc1"] == pytest.approx(simulated.px4.time_us * 1e3, abs=15e9)
    rates = [t for t, n, _ in simulated.messages if n == "EXTENDED_SYS_STATE" and t > 5.0]
    assert np.diff(rates) == pytest.approx(1.0, abs=0.02)  # asked for 1 Hz by the client


def steps_of(table, begin, end, scale=1.0):
    rows = table[(table[:, 0] > begin) & (table[:, 0] < end)]
    rate = (len(rows) - 1) / (rows[-1, 0] - rows[0, 0])
    steps = np.round(np.diff(rows[:, 1]) * scale).astype(int)
    values, counts = np.unique(steps, return_counts=True)
    return rate, dict(zip(values.tolist(), (counts / len(steps)).tolist(), strict=True))


@pytest.mark.parametrize(
    ("name", "field", "scale", "begin", "end", "tolerance"),
    [
        ("ODOMETRY", "time_usec", 1e-3, 2.6, 4.3, 0.1),
        ("ODOMETRY", "time_usec", 1e-3, 4.9, 6.6, 0.1),
        ("ODOMETRY", "time_usec", 1e-3, 7.2, 8.9, 0.1),
        (
            "ATTITUDE",
            "time_boot_ms",
            1.0,
            9.5,
            11.2,
            0.3,
        ),  # asked for 250 Hz PX4 misses a quarter of them, the simulation none
        ("HIGHRES_IMU", "time_usec", 1e-3, 11.8, 13.5, 0.1),
        ("LOCAL_POSITION_NED", "time_boot_ms", 1.0, 14.1, 15.8, 0.1),
    ],
)
def test_intervals_give_the_recorded_rates_and_stamp_grid(recording, flight, name, field, scale, begin, end, tolerance):
    recorded = recording("params")
    simulated = flight().replay(recorded, end + 0.1)
    rate, steps = steps_of(recorded.table(f"rx:{name}"), begin, end, scale)
    mine_rate, mine_steps = steps_of(simulated.column(name, field), begin, end, scale)
    assert mine_rate * SIMULATED_SECOND == pytest.approx(rate, rel=tolerance)
    assert mine_rate <= 250.1
    usual = {step for step, share in steps.items() if share > 0.15}
    assert {step for step, share in mine_steps.items() if share > 0.15} <= usual | {4}
    assert all(step % 4 == 0 for step in mine_steps)


def test_odometry_at_100_hz_mixes_8_and_16_ms_three_to_one(recording, flight):
    simulated = flight().replay(recording("params"), 4.4)
    _, steps = steps_of(simulated.column("ODOMETRY", "time_usec"), 2.6, 4.3, 1e-3)
    assert set(steps) == {8, 16}
    assert steps[8] / steps[16] == pytest.approx(3.0, rel=0.15)


def test_odometry_is_as_old_as_recorded_on_arrival(flight):
    """Recorded: 13 to 14 ms, p95 17 to 18 ms."""
    simulated = flight()
    simulated.command(511, 331.0, 10000.0)
    simulated.run(3.0)
    offset = simulated.px4.time_us * 1e-6 - simulated.t
    ages = [t + offset - f["time_usec"] * 1e-6 for t, n, f in simulated.messages if n == "ODOMETRY" and t > 0.5]
    assert np.mean(ages) == pytest.approx(0.0137, abs=0.001)
    assert np.quantile(ages, 0.95) == pytest.approx(0.0175, abs=0.002)


def test_intervals_and_parameters_are_answered_as_recorded(recording, flight):
    recorded = recording("params")
    simulated = flight().replay(recorded, 34.9)
    assert simulated.acks() == recorded.acks()
    intervals = [(f["message_id"], f["interval_us"]) for _, f in recorded.select("MESSAGE_INTERVAL")]
    assert [(f["message_id"], f["interval_us"]) for _, f in simulated.select("MESSAGE_INTERVAL")] == intervals
    unasked = "CAL_BARO0_OFF"
    fields = ("param_id", "param_value", "param_type", "param_count", "param_index")

    def values(traffic):
        return [tuple(f[key] for key in fields) for _, f in traffic.select("PARAM_VALUE") if f["param_id"] != unasked]

    # the second copy of a value that was set comes about 20 ms later; PX4 gathers two quick ones into one
    mine, wanted = values(simulated), values(recorded)
    assert set(mine) == set(wanted)
    assert [m for i, m in enumerate(mine) if m not in mine[:i]] == [
        w for i, w in enumerate(wanted) if w not in wanted[:i]
    ]
    errors = [f["error"] for _, f in recorded.select("PARAM_ERROR")]
    assert [f["error"] for _, f in simulated.select("PARAM_ERROR")] == errors == [1]
