"""Recordings for the tests of the tuning: of a made-up vehicle, and of the simulated PX4 in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import TransferFunction, lsim

from daemon.config import load
from daemon.control.parameters import ControlParameters
from daemon.loops.grid import LoopAlarm
from daemon.loops.vehicle import Vehicle
from daemon.messages import GRAVITY_M_S2, EstimatedState, Setpoint
from daemon.parameters import control_parameters
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual
from daemon.tuning.experiment import Recording, Sample, fly, gentle
from daemon.tuning.pulsed import PulsedAutopilot, Sent
from daemon.tuning.pulses import Programme, programme, with_pulse

BEGUN_S = 1000.0


@dataclass(frozen=True)
class MadeUp:
    """Seconds; ``slope`` 1: thrust linear in the command; ``trim``: thrust beyond hover, so that it climbs."""

    dead_s: tuple[float, float, float] = (0.03, 0.03, 0.12)
    lag_s: tuple[float, float, float] = (0.055, 0.06, 0.3)
    gain: tuple[float, float, float] = (1.0, 1.0, 0.9)
    hover: float = 0.55
    trim: float = 0.0
    slope: float = 1.0
    thrust_lag_s: float = 0.05
    drag_1_s: float = 0.5
    rate_noise_rad_s: float = 0.02
    velocity_noise_m_s: float = 0.01
    age_s: float = 0.012


def _answer(
    time: np.ndarray, command: np.ndarray, system: tuple[list[float], list[float]], dead_s: float
) -> np.ndarray:
    delayed = np.interp(time - dead_s, time, command)
    return lsim(TransferFunction(*system), delayed, time, interp=False)[1]


@cache
def made_up(airframe: MadeUp) -> Recording:
    """What the pulses would record; the answers are scipy's continuous simulation of the setpoints."""
    pulses, draw = programme(ControlParameters(hover_thrust=airframe.hover)), np.random.default_rng(2)
    fine = np.arange(0.0, pulses[-1].end_s, 0.001)
    setpoints = []
    for t in np.floor(fine[::10] * 100 + 0.5) / 100:
        setpoint = Setpoint((0.0, 0.0, 0.0), airframe.hover + airframe.trim)
        for pulse in pulses:
            setpoint = with_pulse(setpoint, pulse, float(t))
        setpoints.append(setpoint)
    rows = np.repeat([(*s.rates_frd_rad_s, s.thrust) for s in setpoints], 10, axis=0)[: len(fine)]
    rates = [
        _answer(fine, rows[:, i], ([airframe.gain[i]], [airframe.lag_s[i], 1.0]), airframe.dead_s[i]) for i in range(3)
    ]
    full = airframe.slope * GRAVITY_M_S2 / airframe.hover
    lag, drag = airframe.thrust_lag_s, airframe.drag_1_s
    down = _answer(fine, rows[:, 3] - airframe.hover, ([-full], [lag, 1.0 + drag * lag, drag]), 0.02)
    samples = []
    for i in range(0, len(fine), 10):
        p, q, r = (float(rate[i] + draw.normal(0.0, airframe.rate_noise_rad_s)) for rate in rates)
        velocity = (0.0, 0.0, float(down[i] + draw.normal(0.0, airframe.velocity_noise_m_s)))
        state = EstimatedState(BEGUN_S + fine[i], (0.0, 0.0, -5.0), velocity, (1.0, 0.0, 0.0, 0.0), (p, q, r))
        samples.append(Sample(state, airframe.age_s))
    sent = [Sent(BEGUN_S + t, s) for t, s in zip(fine[::10], setpoints, strict=True)]
    return Recording(BEGUN_S, pulses, sent, samples)


def flown(
    airframe: str = "sih",
    *,
    noise: bool = True,
    seed: int = 1,
    pulses: Programme | None = None,
    takeoff_m: float | None = 5.0,
    meanwhile: Callable[[SimulatedPx4, Vehicle, PulsedAutopilot], Awaitable[None]] | None = None,
) -> Recording:
    """Fly the pulses on the simulated PX4 in virtual time; ``meanwhile`` runs beside the flight."""

    async def main() -> Recording:
        loop = asyncio.get_running_loop()
        px4 = SimulatedPx4(airframe=load_airframe(airframe), seed=seed, noise=noise)
        config = gentle(load([]))
        parameters = control_parameters(config, None)
        pulsed = PulsedAutopilot(InProcessAutopilot(px4), parameters, loop.time)
        vehicle = Vehicle(config, pulsed, lambda: LoopAlarm(loop), loop.time)
        tasks = [asyncio.ensure_future(vehicle.run())]
        if meanwhile is not None:
            tasks.append(asyncio.ensure_future(meanwhile(px4, vehicle, pulsed)))
        try:
            return await fly(vehicle, pulsed, pulses or programme(parameters), takeoff_m=takeoff_m)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    return run_virtual(main())
