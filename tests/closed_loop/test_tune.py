"""Tuning on the simulated PX4: what it finds, what its gains are worth, and that it stops when it should."""

import asyncio
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import dist

import numpy as np
import pytest
from support.flight import Flight
from support.flight import fly as fly_daemon
from support.tuning import flown

from daemon.config import load
from daemon.loops.turns import NotPossibleError
from daemon.loops.vehicle import Vehicle
from daemon.messages import FlightMode
from daemon.pipeline import Inputs, Record
from daemon.safety.supervisor import State
from daemon.sim.px4 import SimulatedPx4
from daemon.tuning.experiment import Recording, StoppedError
from daemon.tuning.measurement import Measured, measure
from daemon.tuning.proposal import overrides, propose
from daemon.tuning.pulsed import PulsedAutopilot
from daemon.tuning.pulses import Axis, Pulse

ROLL = tuple(Pulse(Axis.ROLL, 0.3 + 2.0 * i, 0.6, 0.2, 1.2) for i in range(3))


@cache
def recorded(airframe: str) -> Recording:
    return flown(airframe)


@cache
def measured(airframe: str) -> Measured:
    return measure(recorded(airframe))


def test_figures_of_the_simulated_px4_are_near_those_of_the_real_one() -> None:
    """A real PX4 with the same vehicle, to ODOMETRY's arrival: roll and pitch 93 ms, yaw 430 ms; hover 0.4905."""
    found = measured("sih")
    for loop in (found.roll, found.pitch):
        assert loop.total_s.value + found.age_s == pytest.approx(0.093, abs=0.025)  # by the phase of its stream
        assert loop.lag_s.value == pytest.approx(0.055, abs=0.006)
    assert found.yaw.total_s.value + found.age_s == pytest.approx(0.430, abs=0.030)
    assert found.thrust.hover_thrust.value == pytest.approx(0.4905, abs=0.005)
    assert found.thrust.full_thrust_m_s2.value == pytest.approx(20.0, rel=0.1)
    assert found.thrust.total_s.value == pytest.approx(0.056, abs=0.015)


def test_the_vehicle_hardly_moves_while_it_is_measured() -> None:
    samples = recorded("sih").samples
    middle = np.mean([s.state.position_ned_m for s in samples], axis=0)
    assert max(dist(s.state.position_ned_m, middle) for s in samples) < 1.0
    assert min(s.upright for s in samples) > np.cos(np.radians(17.0))


def test_setpoints_with_pulses_keep_the_limits() -> None:
    limits = load([]).control
    for before, after in pairwise(recorded("sih").sent):
        roll, pitch, yaw = np.degrees(after.setpoint.rates_frd_rad_s)
        assert np.hypot(roll, pitch) <= limits.rate_max_deg_s and abs(yaw) <= limits.yaw_rate_max_deg_s
        assert limits.thrust_min <= after.setpoint.thrust <= limits.thrust_max
        step = np.degrees(np.subtract(after.setpoint.rates_frd_rad_s, before.setpoint.rates_frd_rad_s))
        assert np.abs(step).max() <= limits.rate_slew_max_deg_s2 * (after.time_s - before.time_s) * 1.01


def rms_on_a_lemniscate(airframe: str, control: dict[str, object]) -> float:
    async def scenario(flight: Flight) -> float:
        await flight.airborne()
        shape = {"kind": "lemniscate", "center": [0, 0, -5], "size_m": [10, 5], "speed_m_s": 4.0, "turns": 1.2}
        goal = await flight.submit(trajectory=shape)
        await flight.until(lambda: flight.state is State.TRACKING)
        begun = len(flight.records)
        await flight.result(goal)
        now_s = [r.now_s for r in flight.records[begun:]]
        wanted = [(r.reference.time_s, *r.reference.position_ned_m) for r in flight.records[begun:] if r.reference]
        off = [
            np.interp(now_s, [row[0] for row in wanted], [row[1 + axis] for row in wanted])
            - [truth[axis] for truth in flight.truths[begun:]]
            for axis in range(3)
        ]
        return float(np.sqrt(np.mean(np.sum(np.square(off), axis=0)[400:])))

    limits = {"acceleration_m_s2": 5.4, "jerk_m_s3": 30.0}
    return fly_daemon(scenario, airframe=airframe, config={"control": control, "guidance": {"limits": limits}})


@pytest.mark.parametrize("airframe", ["sih", "x500"])
def test_proposed_gains_track_at_least_as_well_as_the_defaults(airframe: str) -> None:
    """To a centimetre: far less than the estimate of a real vehicle wanders."""
    proposed = overrides(propose(measured(airframe), load([])))["control"]
    assert rms_on_a_lemniscate(airframe, proposed) <= rms_on_a_lemniscate(airframe, {}) + 0.01


class Watched:
    """Does something after the first pulse; keeps the vehicle for afterwards, and when its last setpoint left."""

    def __init__(self, do: Callable[[SimulatedPx4], None]) -> None:
        self.do = do
        self.vehicle: Vehicle | None = None
        self.pulsed: PulsedAutopilot | None = None
        self.done_s = 0.0

    async def __call__(self, px4: SimulatedPx4, vehicle: Vehicle, pulsed: PulsedAutopilot) -> None:
        self.vehicle, self.pulsed = vehicle, pulsed
        begun = asyncio.Event()

        def on_tick(_inputs: Inputs, _record: Record) -> None:
            if pulsed.sent and abs(pulsed.sent[-1].setpoint.rates_frd_rad_s[0]) > 0.4:
                begun.set()

        vehicle.control.listeners.append(on_tick)
        await begun.wait()
        await asyncio.sleep(1.9)
        self.done_s = asyncio.get_running_loop().time()
        self.do(px4)


def land(px4: SimulatedPx4) -> None:
    fields = {"command": 176, "param1": 129.0, "param2": 4.0, "param3": 6.0, "confirmation": 0}
    zeros = {f"param{i}": 0.0 for i in range(4, 8)}
    px4.receive("COMMAND_LONG", fields | zeros | {"target_system": 1, "target_component": 1}, sender_system=255)


def blow(px4: SimulatedPx4) -> None:
    px4.wind.steady_ned_m_s = (9.0, 0.0, 0.0)


def test_a_pilot_who_takes_the_vehicle_ends_it_and_no_setpoint_follows() -> None:
    watched = Watched(land)
    with pytest.raises(StoppedError, match="pulses on roll: the supervisor went to pilot"):
        flown(noise=False, pulses=ROLL, meanwhile=watched)
    assert watched.pulsed is not None
    assert abs(watched.pulsed.sent[-1].time_s - watched.done_s) < 0.15


def test_a_vehicle_that_is_blown_away_is_handed_back() -> None:
    watched = Watched(blow)
    with pytest.raises(StoppedError, match=r"tilts by|m off"):
        flown(noise=False, pulses=ROLL, meanwhile=watched)
    assert watched.vehicle is not None
    assert watched.vehicle.commander.state is State.READY
    assert watched.vehicle.autopilot.status.value.mode is FlightMode.HOLD


def test_a_vehicle_on_the_ground_stays_there_unless_it_may_take_off() -> None:
    with pytest.raises(NotPossibleError, match="--takeoff"):
        flown(noise=False, takeoff_m=None)
