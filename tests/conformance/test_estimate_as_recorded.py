"""Resets, the loss of GPS and the estimator's noise against recordings."""

import numpy as np
import pytest

from daemon.messages import GlobalPosition
from daemon.sim.faults import EkfReset, GpsLoss
from daemon.sim.sensors import global_of


def jumps(rows, step):
    """(t, change of the columns) where the last column, the reset counter, steps."""
    found = []
    for index in np.flatnonzero(np.diff(rows[:, -1])):
        found.append((rows[index + 1, 0], rows[index + 1] - rows[index]))
    return [jump for jump in found if jump[0] > step]


AFTER_S = (0.06, 0.45, 0.95)


def claimed(simulated, since_s):
    """The variance of x that ODOMETRY claims after a reset, m2."""
    rows = simulated.column("ODOMETRY", "pose_covariance")
    return [rows[np.searchsorted(rows[:, 0], since_s + after_s), 1] for after_s in AFTER_S]


def error_m(simulated, at_s):
    """How far north of the truth the vehicle believes to be."""
    believed, true = simulated.column("ODOMETRY", "x"), simulated.column("HIL_STATE_QUATERNION", "lat")
    north_m = (true[:, 1] * 1e-7 - simulated.px4.home.latitude_deg) * 111195.0
    return np.interp(at_s, believed[:, 0], believed[:, 1]) - np.interp(at_s, true[:, 0], north_m)


def test_origin_resets_move_the_recorded_fields_only(recording, flight):
    recorded = recording("ekf_resets")
    rows = recorded.table("rx:ODOMETRY")  # t x y z vx vy vz q0..q3 counter
    simulated = flight(10.0)
    simulated.command(511, 331.0, 20000.0)
    home = simulated.px4.home

    def origin(north_m, up_m):
        place = global_of((north_m, 0.0, -up_m), home)
        simulated.send(
            "SET_GPS_GLOBAL_ORIGIN",
            {
                "latitude": round(place.latitude_deg * 1e7),
                "longitude": round(place.longitude_deg * 1e7),
                "altitude": round(place.altitude_amsl_m * 1e3),
            },
        )

    at = {
        2.007: lambda: origin(3.0, 0.0),
        7.011: lambda: origin(0.0, 0.0),
        12.016: lambda: origin(11.12, 0.0),
        17.021: lambda: origin(0.0, 0.0),
        22.026: lambda: origin(0.0, 2.0),
        27.033: lambda: origin(0.0, 0.0),
        32.037: lambda: simulated.px4.inject(EkfReset(kind="heading", size_deg=30.0)),
    }
    for t, action in at.items():
        simulated.run(t)
        action()
    simulated.run(36.0)
    mine = simulated.column("ODOMETRY", "x", "y", "z", "vx", "vy", "vz", "q", "reset_counter")
    wanted = [jump for jump in jumps(rows, 0.0) if jump[0] < 36.0]
    got = jumps(mine, 0.0)
    assert len(wanted) == len(got) == 7
    for (t, change), (t_mine, change_mine) in zip(wanted, got, strict=True):
        assert t_mine == pytest.approx(t, abs=0.05)
        assert change_mine[-1] == change[-1]  # the counter's step: 2 for origins, 1 for the heading
        assert change_mine[1:4] == pytest.approx(change[1:4], abs=0.2)  # the recorded origin is a few dm off
        assert change_mine[4:7] == pytest.approx(change[4:7], abs=0.15)
    heading = 2.0 * np.degrees(np.arcsin(np.linalg.norm(got[-1][1][7:11]) / 2.0)) * 2.0
    assert heading == pytest.approx(30.0, abs=1.0)
    drift = np.linalg.norm(np.array(simulated.px4.truth.position_ned_m) - (0.0, 0.0, -10.0))
    assert drift < 1.5  # Hold moves its target with each reset
    assert simulated.select("GPS_GLOBAL_ORIGIN")


def test_an_external_position_jumps_at_once_and_far_ones_are_undone(recording, flight):
    recorded = recording("ekf_resets")
    rows = recorded.table("rx:ODOMETRY")
    simulated = flight(10.0)
    simulated.command(511, 331.0, 20000.0)
    simulated.command(511, 115.0, 20000.0)
    simulated.run(1.0)

    def external(north_m):
        place = global_of((north_m, 0.0, 0.0), simulated.px4.home)
        fields = {"command": 43003, "frame": 0, "current": 0, "autocontinue": 0, "param1": 0.0, "param2": 0.0}
        fields |= {"x": round(place.latitude_deg * 1e7), "y": round(place.longitude_deg * 1e7), "z": float("nan")}
        simulated.send("COMMAND_INT", {**fields, "param3": 0.5, "param4": 0.0})

    external(3.0)
    simulated.run(12.0)
    near = jumps(simulated.column("ODOMETRY", "x", "y", "z", "reset_counter"), 0.0)
    wanted = [jump for jump in jumps(rows, 39.0) if jump[0] < 41.0]
    assert [jump[1][-1] for jump in near] == [jump[1][-1] for jump in wanted] == [2.0]
    assert near[0][1][1] == pytest.approx(wanted[0][1][1], abs=0.1)
    assert claimed(simulated, near[0][0]) == pytest.approx([0.191, 0.113, 0.080], rel=0.35)  # the same, 39.06 s
    off = [error_m(simulated, near[0][0] + after_s) for after_s in AFTER_S]
    assert off == pytest.approx([2.7, 1.75, 0.85], abs=0.25)  # of HIL_STATE_QUATERNION there
    assert simulated.acks() == [(511, 0), (511, 0), (43003, 0)]
    simulated.run(60.0)
    here = simulated.px4.estimator.estimate.position_ned_m[0]
    external(11.14 + here)
    simulated.run(62.5)
    far = jumps(simulated.column("ODOMETRY", "x", "y", "z", "reset_counter"), 60.0)
    wanted = [jump for jump in jumps(rows, 64.0) if jump[0] < 67.0]
    assert [jump[1][-1] for jump in far] == [jump[1][-1] for jump in wanted] == [2.0, 4.0]
    assert far[1][0] - far[0][0] == pytest.approx(wanted[1][0] - wanted[0][0], abs=0.1)
    assert [jump[1][1] for jump in far] == pytest.approx([jump[1][1] for jump in wanted], abs=0.3)
    assert claimed(simulated, far[0][0]) == pytest.approx([0.25, 0.251, 0.256], rel=0.1)  # 64.06 s: GPS is refused
    assert claimed(simulated, far[1][0]) == pytest.approx([1.62, 0.233, 0.118], rel=0.35)  # 65.13 s: GPS takes over


@pytest.mark.parametrize("kind", ["position_ne", "position_d", "velocity_ne", "velocity_d", "heading"])
def test_each_kind_of_reset_moves_only_its_own_numbers(flight, kind):
    simulated = flight(10.0)
    simulated.command(511, 331.0, 8000.0)
    simulated.run(1.0)
    simulated.px4.inject(EkfReset(kind=kind, size_m=2.0, size_m_s=0.7, size_deg=25.0))
    simulated.run(1.2)
    ((_, change),) = jumps(simulated.column("ODOMETRY", "x", "y", "z", "vx", "vy", "vz", "q", "reset_counter"), 0.5)
    moved = {"position_ne": {1}, "position_d": {3}, "velocity_ne": {4}, "velocity_d": {6}, "heading": {7, 10}}[kind]
    for column in range(1, 11):
        assert (abs(change[column]) > 0.02) == (column in moved), column


def test_gps_loss_and_return_follow_the_recording(recording, flight):
    recorded = recording("gps_loss")
    rows = recorded.table("rx:ODOMETRY")  # t x y z vx vy vz cov[21] counter
    simulated = flight(10.0)
    simulated.command(511, 331.0, 20000.0)
    loss = GpsLoss(duration_s=15.0)

    def hover():
        simulated.send(
            "SET_ATTITUDE_TARGET",
            {
                "type_mask": 128,
                "q": [0.0] * 4,
                "body_roll_rate": 0.0,
                "body_pitch_rate": 0.0,
                "body_yaw_rate": 0.0,
                "thrust": 0.4905,
            },
        )

    while simulated.t < 30.0:
        if round(simulated.t * 1e3) % 20 == 0:
            hover()
        if round(simulated.t, 3) == 1.2:
            simulated.command(176, 1.0, 6.0)
        if round(simulated.t, 3) == 7.008:
            simulated.px4.inject(loss)
        simulated.step()
    mine = simulated.column("ODOMETRY", "x", "y", "z", "vx", "vy", "vz", "pose_covariance", "reset_counter")
    for t in (8.0, 10.0, 12.0, 17.0, 21.5):
        wanted = np.interp(t, rows[:, 0], rows[:, 7])
        assert np.interp(t, mine[:, 0], mine[:, 7]) == pytest.approx(wanted, rel=0.25), t
    (t, change), *_ = jumps(rows, 20.0)
    (t_mine, change_mine), *more = jumps(mine, 20.0)
    assert not more
    assert t_mine == pytest.approx(t, abs=0.1)
    assert change_mine[-1] == change[-1] == 4.0
    assert np.hypot(*change_mine[1:3]) == pytest.approx(np.hypot(*change[1:3]), rel=0.1)
    assert np.hypot(*change_mine[4:6]) == pytest.approx(np.hypot(*change[4:6]), rel=0.2)
    calm = mine[(mine[:, 0] > 7.0) & (mine[:, 0] < 22.0)]
    assert np.abs(np.diff(calm[:, 1:3], axis=0)).max() < 0.5  # it looks calm all the while
    fix = recorded.table("rx:GPS_RAW_INT")
    mine_fix = simulated.column("GPS_RAW_INT", "fix_type", "satellites_visible")
    for table in (fix, mine_fix):
        lost = table[(table[:, 0] > 7.3) & (table[:, 0] < 21.9)]
        assert (lost[:, 1:] == 0).all()
    health = recorded.table("rx:SYS_STATUS")
    mine_health = simulated.column("SYS_STATUS", "onboard_control_sensors_health")

    def position_lost(table):
        return next(row[0] for row in table if row[0] > 7.0 and not int(row[1]) & 0x4000)

    assert position_lost(mine_health) == pytest.approx(position_lost(health), abs=0.3)
    events = [event for event in recorded.happenings() if 5.0 < event[0] < 30.0]
    assert [event for _, event in simulated.happenings() if event in (31476391, 32069699)] == [e for _, e in events]
    assert simulated.px4.mode.value == "offboard"


def test_a_short_loss_slides_home_without_a_reset(flight):
    simulated = flight(10.0)
    simulated.command(511, 331.0, 8000.0)
    simulated.run(1.0)
    simulated.px4.inject(GpsLoss(duration_s=4.0))
    simulated.run(7.0)
    mine = simulated.column("ODOMETRY", "x", "y", "reset_counter")
    assert not jumps(mine, 0.0)
    back = mine[(mine[:, 0] > 4.9) & (mine[:, 0] < 5.3)]
    steps = np.hypot(*np.diff(back[:, 1:3], axis=0).T)
    assert 0.1 < steps.max() < 0.6
    assert np.count_nonzero(steps > 0.05) * 0.01 == pytest.approx(0.1, abs=0.05)


def noise_of(odometry, truth):
    """Differences between samples, and the errors' spread: columns x y z vx vy vz; rates' error."""
    dt = np.diff(odometry[:, 1])[:, None] * 1e-6
    mean_velocity = 0.5 * (odometry[1:, 5:8] + odometry[:-1, 5:8])
    innovation = np.diff(odometry[:, 2:5], axis=0) - mean_velocity * dt
    step = np.diff(odometry[:, 5:8], axis=0)
    rates = [np.interp(odometry[:, 0], truth[:, 0], truth[:, 11 + i]) for i in range(3)]
    rate_error = odometry[:, 12:15] - np.array(rates).T
    return innovation.std(0), step.std(0), rate_error.std(0)


def test_noise_of_odometry_in_hover_is_that_of_the_recording(recording, flight):
    recorded = recording("hover_noise")
    rows, truth = recorded.table("rx:ODOMETRY"), recorded.table("rx:HIL_STATE_QUATERNION")
    wanted = noise_of(rows, truth)
    spread = []
    for seed in range(4):
        simulated = flight(10.0, noise=True, seed=seed)
        simulated.command(511, 331.0, 10000.0)
        simulated.command(511, 115.0, 20000.0)
        simulated.run(9.0)
        fields = ("time_usec", "x", "y", "z", "vx", "vy", "vz", "q", "rollspeed", "pitchspeed", "yawspeed")
        mine = simulated.column("ODOMETRY", *fields)[50:]
        fields = ("attitude_quaternion", "lat", "lon", "alt", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed")
        spread.append(noise_of(mine, simulated.column("HIL_STATE_QUATERNION", *fields)))
    innovation, step, rates = (np.mean([s[i] for s in spread], axis=0) for i in range(3))
    assert innovation == pytest.approx(wanted[0], rel=0.4)  # 1 to 2 mm from sample to sample
    assert step == pytest.approx(wanted[1], rel=0.5)  # 3 to 10 mm/s
    assert rates == pytest.approx(wanted[2], rel=0.25)  # 0.09, 0.045, 0.018 rad/s


def test_the_estimate_errs_as_much_as_recorded(flight):
    """Recorded in hover: position spread 0.03-0.12 m, velocity 0.03-0.28 m/s, heading off by 2 to 14 degrees."""
    position, velocity, heading = [], [], []
    for seed in range(8):
        simulated = flight(10.0, noise=True, seed=seed)
        errors = []
        for _ in range(8 * 250):
            simulated.px4.step()
            simulated.px4.take_outgoing()
            px4, estimate = simulated.px4, simulated.px4.estimator.estimate
            offset = np.subtract(estimate.position_ned_m, px4.truth.position_ned_m)
            errors.append([*offset, *np.subtract(estimate.velocity_ned_m_s, px4.truth.velocity_ned_m_s)])
        q, e = px4.truth.attitude_wb, estimate.attitude_wb
        heading.append(np.degrees(2.0 * np.arcsin(min(1.0, abs(q[0] * e[3] - q[3] * e[0])))))
        position.append(np.std(errors, axis=0)[:3])
        velocity.append(np.std(errors, axis=0)[3:])
    assert 0.03 < np.mean(position) < 0.13
    assert 0.03 < np.mean(velocity) < 0.2
    assert 1.0 < np.mean(heading) < 10.0


def test_without_noise_the_estimate_is_the_truth(flight):
    simulated = flight(10.0)
    simulated.run(3.0)
    px4 = simulated.px4
    assert px4.estimator.estimate.position_ned_m == pytest.approx(px4.truth.position_ned_m, abs=1e-12)
    assert px4.home == GlobalPosition(47.397742, 8.545594, 489.4)
