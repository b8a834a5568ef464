"""Modes, commands, acknowledgements and failsafes, each scenario against the recording of the same commands."""

from dataclasses import replace
from itertools import pairwise

import pytest

HEARTBEAT_S = 1.02  # a change shows in the next of them


def same_sequence(recorded, simulated, tolerance_s):
    assert [value for _, value in simulated] == [value for _, value in recorded]
    late = [s[0] - r[0] for r, s in zip(recorded, simulated, strict=True)]
    assert max(map(abs, late)) < tolerance_s, late


def test_takeoff_hold_land_has_the_recorded_sequence(recording, flight):
    recorded = recording("takeoff_hold_land")
    simulated = flight(noise=True).replay(recorded, 43.0)
    assert simulated.acks() == recorded.acks()
    happenings = [event for _, event in recorded.happenings()]
    assert [event for _, event in simulated.happenings()] == happenings
    for (t, event), (t_sim, _) in zip(recorded.happenings(), simulated.happenings(), strict=True):
        # landing is detected between 1.3 and 7.4 s after contact; before it everything is within 50 ms
        assert abs(t_sim - t) < (0.05 if t < 30.0 else 7.0), event
    fields = ("base_mode", "custom_mode", "system_status")
    assert [v for _, v in simulated.changes("HEARTBEAT", *fields)] == [
        v for _, v in recorded.changes("HEARTBEAT", *fields)
    ]
    assert [v for _, v in simulated.changes("EXTENDED_SYS_STATE", "landed_state")] == [(1,), (3,), (2,), (4,), (1,)]
    hold = next(t for t, v in simulated.changes("HEARTBEAT", *fields) if t > 5.0 and v[1] == 50593792)
    assert hold == pytest.approx(11.13, abs=1.5)


def test_takeoff_and_landing_follow_the_recorded_profile(recording, flight):
    recorded = recording("takeoff_hold_land")
    simulated = flight()
    simulated.command(511, 331, 20000.0)
    simulated.replay(recorded, 43.0)
    rows = recorded.table("rx:ODOMETRY")[:, [0, 4, 7]]
    height, sunk = -rows[:, 1], rows[:, 2]
    mine = simulated.column("ODOMETRY", "z", "vz")
    mine_height, mine_sunk = -mine[:, 1], mine[:, 2]
    for level in (1.0, 2.0, 3.0, 4.0):
        climbed = rows[height > level, 0][0]
        assert mine[mine_height > level, 0][0] == pytest.approx(climbed, abs=0.6), level
    assert -mine_sunk.min() == pytest.approx(-sunk.min(), abs=0.25)
    falling, mine_falling = (rows[:, 0] > 23) & (rows[:, 0] < 26), (mine[:, 0] > 23) & (mine[:, 0] < 26)
    assert mine_sunk[mine_falling].mean() == pytest.approx(sunk[falling].mean(), abs=0.2)
    low = (rows[:, 0] > 20) & (height > 0.1) & (height < 0.8)
    mine_low = (mine[:, 0] > 20) & (mine_height > 0.1) & (mine_height < 0.8)
    assert mine_sunk[mine_low].mean() == pytest.approx(sunk[low].mean(), abs=0.15)


def test_commands_on_the_ground_are_refused_and_taken_as_recorded(recording, flight):
    recorded = recording("refused_on_ground")
    simulated = flight(booted_for_s=2.2).replay(recorded, 38.0)
    session = (511, 512)  # the client's own housekeeping at connect began before the recording
    assert simulated.acks(without=session) == recorded.acks(without=session)
    assert [e for _, e in simulated.happenings()] == [e for _, e in recorded.happenings()]
    disarmed, mine = recorded.happenings()[-1], simulated.happenings()[-1]
    assert mine[0] == pytest.approx(disarmed[0], abs=0.3)  # COM_DISARM_PRFLT
    fields = ("base_mode", "custom_mode", "system_status")
    mine = [change for change in simulated.changes("HEARTBEAT", *fields) if change[0] > 0.6]  # the first beat's phase
    same_sequence(recorded.changes("HEARTBEAT", *fields), mine, HEARTBEAT_S)


def test_offboard_loss_runs_through_the_recorded_failsafe(recording, flight):
    recorded = recording("offboard_loss")
    simulated = flight(9.4, noise=True)

    def over_home():  # as recorded: 0.4 m off; flown by rates alone the two vehicles drift apart
        simulated.px4.truth = replace(simulated.px4.truth, position_ned_m=(0.1, 0.4, -9.9))

    simulated.replay(recorded, 40.0, {16.7: over_home})
    assert simulated.acks() == [ack for ack in recorded.acks() if ack[0] != 21]
    until = [entry for entry in recorded.happenings() if entry[0] < 40.0]
    same_sequence(until, simulated.happenings(), 0.2)
    fields = ("base_mode", "custom_mode", "system_status")
    beats = [b for b in recorded.changes("HEARTBEAT", *fields) if b[0] < 40.0]
    same_sequence(beats, simulated.changes("HEARTBEAT", *fields), HEARTBEAT_S)
    modes = [c for c in recorded.changes("CURRENT_MODE", "custom_mode", "intended_custom_mode") if c[0] < 40.0]
    mine = simulated.changes("CURRENT_MODE", "custom_mode", "intended_custom_mode")
    assert [v for _, v in mine] == [v for _, v in modes]
    landed = [c for c in recorded.changes("EXTENDED_SYS_STATE", "landed_state") if c[0] < 40.0]
    same_sequence(landed, simulated.changes("EXTENDED_SYS_STATE", "landed_state"), 0.35)


def test_rates_are_held_in_a_gap_until_the_failsafe(recording, flight):
    recorded = recording("offboard_loss")
    simulated = flight(3.0)
    simulated.command(511, 115.0, 20000.0)
    hold = {39.9: lambda: simulated.command(176, 1.0, 6.0)}
    simulated.replay(recorded, 43.0, hold, since_s=39.5)
    stop = recorded.note("pitch-down") + 0.6
    rows = recorded.table("rx:HIL_STATE_QUATERNION")
    pitch_rate = rows[(rows[:, 0] > stop + 0.4) & (rows[:, 0] < stop + 0.9), 4]
    mine = simulated.column("HIL_STATE_QUATERNION", "pitchspeed")
    held = mine[(mine[:, 0] > stop + 0.4) & (mine[:, 0] < stop + 0.9), 1]
    assert pitch_rate.mean() == pytest.approx(held.mean(), abs=0.04)


def test_texts_come_only_to_a_ground_station(recording, flight):
    recorded = recording("offboard_loss_gcs_type")
    simulated = flight(10.8)
    simulated.send("HEARTBEAT", {"type": 6})
    simulated.replay(recorded, 22.0)
    texts = [f["text"] for _, f in simulated.select("STATUSTEXT")]
    assert [t for t in texts if "start return" not in t] == ["Failsafe activated\t", "RTL: land at destination\t"]
    assert all(text.endswith("\t") for text in texts)
    silent = flight(10.8).replay(recorded, 22.0)
    assert silent.select("STATUSTEXT") == []
    assert len(silent.happenings()) == len(simulated.happenings())


def test_a_pilot_takes_the_mode_as_recorded(recording, flight):
    recorded = recording("mode_change_by_pilot")

    def sticks(simulated, until_s):
        if simulated.t < until_s:
            centred = {"x": 0, "y": 0, "z": 500, "r": 0, "buttons": 0, "target": 1}
            simulated.send("MANUAL_CONTROL", centred, (255, 190))

    simulated = flight(10.0)
    change = recorded.note("COM_RC_IN_MODE = 1")
    at = {change: lambda: simulated.px4.parameters.set("COM_RC_IN_MODE", 1)}
    end = recorded.note("pilot moves the stick") + 3.08  # the joystick's last message in the recording
    step = change
    while step < end:
        at[step + 0.001] = lambda: sticks(simulated, end)
        step += 0.1
    simulated.replay(recorded, 45.9, at)
    assert simulated.acks() == recorded.acks()
    assert simulated.acks("rx_gcs") == recorded.acks("rx_gcs")
    fields = ("base_mode", "custom_mode", "system_status")
    same_sequence(recorded.changes("HEARTBEAT", *fields), simulated.changes("HEARTBEAT", *fields), HEARTBEAT_S)
    same_sequence(recorded.happenings(), simulated.happenings(), 0.3)


def test_a_low_battery_runs_through_the_recorded_steps(recording, flight):
    recorded = recording("battery_low")
    parameters = {"SIM_BAT_DRAIN": 30.0, "SIM_BAT_MIN_PCT": 2.0, "CBRK_SUPPLY_CHK": 0, "COM_LOW_BAT_ACT": 3}
    simulated = flight(noise=True, parameters=parameters).replay(recorded, 58.0)
    assert simulated.acks() == recorded.acks()
    shutdown, low = 22624381, 21826980  # "cannot shut down", and one more "low" while disarming
    wanted = [e for e in recorded.happenings() if e[1] != shutdown and (e[1] != low or e[0] < 50.0)]
    mine = simulated.happenings()
    assert [e for _, e in mine] == [e for _, e in wanted]
    for (t, event), (t_sim, _) in zip(wanted, mine, strict=True):
        assert abs(t_sim - t) < (2.0 if t < 40.0 else 6.0), event
    fields = ("base_mode", "custom_mode", "system_status")
    assert [v for _, v in simulated.changes("HEARTBEAT", *fields)] == [
        v for _, v in recorded.changes("HEARTBEAT", *fields)
    ]
    rows = recorded.table("rx:SYS_STATUS")
    mine_rows = simulated.column("SYS_STATUS", "voltage_battery", "battery_remaining")
    for t in (5.0, 15.0, 25.0):
        recorded_mv = rows[rows[:, 0] > t][0, 1]
        assert mine_rows[mine_rows[:, 0] > t][0, 1] == pytest.approx(recorded_mv, abs=60)


def test_heartbeats_are_one_second_apart_and_never_early(flight):
    simulated = flight(5.0)
    simulated.run(3.3)
    simulated.command(176, 1.0, 4.0, 6.0)
    simulated.run(8.0)
    times = [t for t, _ in simulated.select("HEARTBEAT")]
    assert all(b - a == pytest.approx(1.0, abs=0.0045) for a, b in pairwise(times))


def test_current_mode_at_20_hz_comes_at_2_hz_and_within_60_ms_of_a_change(flight):
    simulated = flight(5.0)
    simulated.command(511, 436.0, 50000.0)
    simulated.run(5.3)
    times = [t for t, _ in simulated.select("CURRENT_MODE") if t > 0.6]
    assert all(b - a == pytest.approx(0.5, abs=0.06) for a, b in pairwise(times))
    simulated.command(176, 1.0, 4.0, 6.0)
    simulated.run(5.5)
    change = next(t for t, f in simulated.select("CURRENT_MODE") if f["custom_mode"] == 100925440)
    assert change - 5.3 < 0.06


def test_offboard_needs_setpoints_first(flight):
    simulated = flight(5.0)
    simulated.run(1.0)
    simulated.command(176, 1.0, 6.0, 0.0)
    simulated.run(1.1)
    assert simulated.acks() == [(176, 0), (176, 1)]
    assert simulated.px4.mode.value == "hold"


def test_a_mode_is_told_on_news_alone_and_a_heartbeat_whenever_it_is_asked_for(flight):
    """PX4 in SITL: of 40 requests 1 and 40 were answered."""
    simulated = flight(5.0)
    simulated.command(511, 436.0, 10000.0)
    simulated.run(1.1)
    for i, message_id in enumerate((436.0, 0.0, 436.0, 0.0)):
        simulated.command(512, message_id)
        simulated.run(1.12 + 0.02 * i)
    assert [result for command, result in simulated.acks() if command == 512] == [2, 0, 2, 0]
