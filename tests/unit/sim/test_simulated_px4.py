"""The vehicle as a whole: determinism, addressing, reboot, robustness."""

import pickle
from math import nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.px4_talk import command, fly, named

from daemon.messages import FlightMode, GlobalPosition, LandedState
from daemon.sim import airframe_files
from daemon.sim.faults import ClockStep, GpsLoss, Link, PilotTakesOver, Reboot, SteadyWind
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.sensors import global_of, ned_of

SIH = airframe_files.load("sih")


def vehicle(height_m=0.0, **arguments):
    px4 = SimulatedPx4(airframe=arguments.pop("airframe", SIH), noise=arguments.pop("noise", False), **arguments)
    if height_m:
        px4.start_in_air(height_m)
    return px4


def event_id(name):
    """libevents: FNV-1a of the name, 24 bits of it, component 1."""
    value = 0x811C9DC5
    for byte in name.encode():
        value = (value ^ byte) * 0x01000193 % 2**32
    return value % 2**24 | 1 << 24


def flown(seed, noise=True):
    px4 = vehicle(10.0, seed=seed, noise=noise)
    px4.inject(SteadyWind(north_m_s=3.0, turbulence_m_s=1.0))
    px4.inject(Link(direction="down", loss=0.1, jitter_s=0.05))
    messages = fly(px4, 2.0)
    px4.inject(GpsLoss(duration_s=1.0))
    return pickle.dumps(messages + fly(px4, 3.0))


def test_noise_is_the_same_whatever_is_asked_when():
    """Over UDP requests arrive at other steps in every run."""

    def estimates(request_s):
        px4 = vehicle(10.0, seed=3, noise=True)
        fly(px4, request_s)
        command(px4, 511, 105.0, 10000.0)
        fly(px4, 2.0 - request_s)
        return px4.present.estimate.position_ned_m, px4.present.rates_frd_rad_s, px4.truth.position_ned_m

    assert estimates(0.2) == estimates(0.7)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    assert flown(7) == flown(7)
    assert flown(7) != flown(8)


def test_it_takes_off_to_an_altitude_above_sea_level_and_lands_disarmed():
    px4 = vehicle()
    fly(px4, 0.5)
    command(px4, 400, 1.0)
    fly(px4, 0.1)
    command(px4, 22, nan, nan, nan, nan, nan, nan, 489.4 + 6.0)
    fly(px4, 15.0)
    assert px4.mode is FlightMode.HOLD
    assert px4.height_m == pytest.approx(6.0, abs=0.1)
    command(px4, 21)
    fly(px4, 25.0)
    assert not px4.armed
    assert px4.commander.landed_state is LandedState.ON_GROUND


def test_a_take_off_in_the_air_climbs_without_a_drop():
    px4 = vehicle(5.0)
    fly(px4, 0.5)
    command(px4, 22, nan, nan, nan, nan, nan, nan, 489.4 + 9.0)
    lowest = 5.0
    for _ in range(100):
        fly(px4, 0.1)
        lowest = min(lowest, px4.height_m)
    assert lowest > 4.9
    assert px4.height_m == pytest.approx(9.0, abs=0.2)


@pytest.mark.parametrize("mode", [(4.0, 3.0), (3.0, 0.0), (2.0, 0.0)])
def test_an_armed_vehicle_stays_down_in_modes_that_do_not_lift(mode):
    px4 = vehicle(parameters={"COM_RC_IN_MODE": 1})
    for index in range(60):
        px4.receive("MANUAL_CONTROL", {"x": 0, "y": 0, "z": 500, "r": 0})
        if index == 10:
            command(px4, 176, 1.0, *mode)
        if index == 20:
            command(px4, 400, 1.0)
        fly(px4, 0.1)
    assert px4.armed
    assert px4.truth.on_ground
    assert px4.signals == pytest.approx((0.0,) * 4, abs=0.15)


def test_gimbal_commands_come_at_a_landing():
    px4 = vehicle(5.0)
    command(px4, 21)
    numbers = [fields["command"] for fields in named(fly(px4, 0.2), "COMMAND_LONG")]
    assert numbers == [1001, 1000]


@pytest.mark.parametrize(
    ("place", "top_m"),
    [((30.0, -20.0, -10.0), 30.0), ((6.0, 0.0, -3.0), 6.0), ((2.5, 0.0, -2.0), 4.0), ((6.0, 0.0, -20.0), 20.0)],
)
def test_return_climbs_flies_home_and_lands_there(place, top_m):
    """RTL::computeReturnAltitude: RTL_RETURN_ALT far off, within RTL_MIN_DIST a cone, never lower than it is."""
    px4 = vehicle(-place[2])
    px4.truth = type(px4.truth)(place, signals=(0.49,) * 4, on_ground=False)
    fly(px4, 0.1)
    command(px4, 20)
    highest = 0.0
    for _ in range(70):
        fly(px4, 1.0)
        highest = max(highest, px4.height_m)
    assert highest == pytest.approx(top_m, abs=0.9)  # NAV_MC_ALT_RAD
    assert px4.truth.on_ground
    assert px4.truth.position_ned_m == pytest.approx((0.0, 0.0, 0.0), abs=0.6)


def test_messages_for_other_systems_are_not_obeyed():
    px4 = vehicle(system_id=3)
    fly(px4, 0.1)
    command(px4, 400, 1.0, system=1)
    assert not named(fly(px4, 0.1), "COMMAND_ACK")
    command(px4, 400, 1.0, system=0)
    assert named(fly(px4, 0.1), "COMMAND_ACK")
    assert px4.armed
    assert px4.parameters["MAV_SYS_ID"] == 3


def test_acks_go_to_whoever_asked():
    px4 = vehicle()
    fields = {"target_system": 1, "command": 31999, **{f"param{i}": 0.0 for i in range(1, 8)}}
    px4.receive("COMMAND_LONG", fields, sender_system=255, sender_component=190)
    (ack,) = named(fly(px4, 0.1), "COMMAND_ACK")
    assert (ack["target_system"], ack["target_component"], ack["result"]) == (255, 190, 3)


def test_a_reboot_starts_the_clock_the_streams_and_the_resets_anew():
    px4 = vehicle(10.0)
    command(px4, 511, 331, 10000.0)
    fly(px4, 1.0)
    assert px4.time_us > 15_000_000
    px4.inject(Reboot())
    silent = fly(px4, 1.4)
    assert silent == [] or named(silent, "ODOMETRY") == named(silent[:50], "ODOMETRY")
    assert px4.time_us < 1_500_000
    assert not px4.armed
    messages = fly(px4, 1.0)
    assert len(named(messages, "ODOMETRY")) == pytest.approx(27, abs=4)  # 30 Hz again
    assert named(messages, "ODOMETRY")[0]["reset_counter"] == 8
    assert px4.commander.can_arm is False
    fly(px4, 4.0)
    assert named(fly(px4, 0.2), "ODOMETRY")[-1]["reset_counter"] == 11
    assert px4.commander.can_arm


def test_the_clock_can_step():
    px4 = vehicle()
    before = named(fly(px4, 0.1), "ODOMETRY")[-1]["time_usec"]
    px4.inject(ClockStep(step_s=-3.0))
    after = named(fly(px4, 0.1), "ODOMETRY")[-1]["time_usec"]
    assert after - before == pytest.approx(-2_900_000, abs=40_000)


def test_an_attitude_setpoint_is_flown_as_well_as_rates():
    px4 = vehicle(20.0)
    tilt = {"type_mask": 7, "q": [0.9962, 0.0872, 0.0, 0.0], "thrust": 0.5}
    rates = {"body_roll_rate": 0.0, "body_pitch_rate": 0.0, "body_yaw_rate": 0.0}
    for index in range(150):
        px4.receive("SET_ATTITUDE_TARGET", {"target_system": 1, **tilt, **rates})
        if index == 5:
            command(px4, 176, 1.0, 6.0)
        fly(px4, 0.012)
    assert px4.mode is FlightMode.OFFBOARD
    assert px4.truth.attitude_wb[1] == pytest.approx(0.0872, abs=0.01)


def test_killing_in_the_air_drops_says_so_and_disarms():
    px4 = vehicle(30.0)
    fly(px4, 0.1)
    px4.commander.kill(True)
    messages = fly(px4, 1.2)
    assert px4.truth.velocity_ned_m_s[2] > 5.0
    assert named(messages, "HEARTBEAT")[-1]["system_status"] == 8  # MAV_STATE_FLIGHT_TERMINATION
    assert px4.commander.can_arm is False
    messages += fly(px4, 5.0)
    assert not px4.armed
    events = [(event["id"], event["arguments"][0]) for event in named(messages, "EVENT")]
    killed, disarmed = event_id("commander_kill_sw_engaged"), event_id("commander_disarmed_by")
    assert [event for event in events if event[0] in (killed, disarmed)] == [(killed, 0), (disarmed, 8)]


@pytest.mark.parametrize("mode", ["hold", "position", "altitude", "stabilized", "acro", "manual"])
def test_disarming_in_the_air_needs_force(mode):
    px4 = vehicle(10.0)
    fly(px4, 0.2)
    px4.inject(PilotTakesOver(mode=mode))
    fly(px4, 0.1)
    assert px4.mode is FlightMode(mode)
    command(px4, 400, 0.0)
    fly(px4, 0.1)
    assert px4.armed
    command(px4, 400, 0.0, 21196.0)
    fly(px4, 0.1)
    assert not px4.armed


def offboard_without_gps(height_m):
    """Level in Offboard until PX4 has no position any more."""
    px4 = vehicle(height_m)
    px4.inject(GpsLoss())
    setpoint = {"target_system": 1, "type_mask": 128, "q": [0.0] * 4, "thrust": 0.4905}
    rates = {"body_roll_rate": 0.0, "body_pitch_rate": 0.0, "body_yaw_rate": 0.0}
    for index in range(300):
        px4.receive("SET_ATTITUDE_TARGET", {**setpoint, **rates})
        if index == 5:
            command(px4, 176, 1.0, 6.0)
        fly(px4, 0.02)
    assert px4.mode is FlightMode.OFFBOARD
    return px4


def acks(messages):
    return [(ack["command"], ack["result"]) for ack in named(messages, "COMMAND_ACK")]


@pytest.mark.parametrize("land", [(176, 1.0, 4.0, 6.0), (21,)])
def test_without_a_position_hold_is_refused_and_land_is_taken_and_descends(land):
    """As PX4 in SITL does: Land is forced (Commander::handle_command), the failsafe makes Descend of it."""
    px4 = offboard_without_gps(30.0)
    command(px4, 176, 1.0, 4.0, 3.0)
    assert acks(fly(px4, 0.1)) == [(176, 0), (176, 1)]
    assert px4.mode is FlightMode.OFFBOARD
    command(px4, *land)
    assert set(acks(fly(px4, 0.1))) == {(land[0], 0)}
    assert (px4.mode, px4.commander.intended, px4.commander.descending) == (FlightMode.LAND, FlightMode.LAND, True)
    assert px4.commander.status.name == "CRITICAL"
    fly(px4, 3.0)
    height = px4.height_m
    fly(px4, 3.0)
    assert (height - px4.height_m) / 3.0 == pytest.approx(0.7, abs=0.2)  # MPC_LAND_SPEED


def test_without_a_position_and_without_setpoints_it_shows_altitude_descends_and_disarms():
    """As PX4 in SITL does: nobody asks the failsafe's Altitude mode for a pilot, and without sticks it descends."""
    px4 = offboard_without_gps(5.0)
    fly(px4, 1.5)
    assert (px4.mode, px4.commander.intended) == (FlightMode.ALTITUDE, FlightMode.OFFBOARD)
    assert px4.commander.status.name == "CRITICAL"
    fly(px4, 25.0)
    assert not px4.armed


@pytest.mark.parametrize(
    ("main", "sub", "word"),
    [(3.0, 2.0, 0x02030000), (11.0, 0.0, 0x000B0000), (3.0, 9.0, 0x00030000), (4.0, 9.0, 0x03040000)],
)
def test_a_mode_that_is_asked_for_shows_by_its_word(main, sub, word):
    """Commander::handle_command: a sub mode that does not exist makes Position, and is refused in Auto."""
    px4 = vehicle()
    command(px4, 176, 1.0, main, sub)
    assert named(fly(px4, 1.1), "HEARTBEAT")[-1]["custom_mode"] == word


@pytest.mark.parametrize("airframe", airframe_files.names())
def test_every_airframe_hovers_with_noise(airframe):
    px4 = vehicle(10.0, airframe=airframe_files.load(airframe), noise=True, seed=2)
    fly(px4, 8.0)
    assert px4.truth.position_ned_m == pytest.approx((0.0, 0.0, -10.0), abs=1.0)
    assert px4.commander.status.name == "ACTIVE"


@pytest.mark.parametrize("position", [(0.0, 0.0, 0.0), (120.0, -340.0, -35.0)])
def test_global_positions_go_there_and_back(position):
    home = GlobalPosition(47.397742, 8.545594, 489.4)
    assert ned_of(global_of(position, home), home) == pytest.approx(position, abs=1e-6)


anything = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.integers(-(2**31), 2**31))


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from([20, 21, 22, 176, 400, 401, 510, 511, 512, 246, 31999]),
    st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=7, max_size=7),
)
def test_no_command_raises_and_each_is_answered(number, parameters):
    px4 = vehicle(5.0)
    fly(px4, 0.02)
    command(px4, number, *parameters)
    assert named(fly(px4, 0.05), "COMMAND_ACK")


@settings(deadline=None, max_examples=30)
@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=8, max_size=8))
def test_no_setpoint_raises_or_breaks_the_state(values):
    px4 = vehicle(5.0, noise=True)
    fields = dict(zip(("body_roll_rate", "body_pitch_rate", "body_yaw_rate", "thrust"), values[:4], strict=True))
    for index in range(12):
        mask = 128 if index % 2 else 0
        px4.receive("SET_ATTITUDE_TARGET", {"target_system": 1, "type_mask": mask, "q": values[4:], **fields})
        if index == 3:
            command(px4, 176, 1.0, 6.0)
        fly(px4, 0.02)
    state = px4.truth
    for value in (*state.position_ned_m, *state.velocity_ned_m_s, *state.attitude_wb, *state.rates_frd_rad_s):
        assert abs(value) < 1e4
