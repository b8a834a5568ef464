"""The measuring flight on a live link, with the dead-man beside it."""

import asyncio
from collections.abc import Callable

from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.endpoint import claim
from daemon.loops.grid import live_alarm
from daemon.loops.vehicle import Vehicle
from daemon.parameters import control_parameters, dead_man_timing
from daemon.safety.dead_man import DeadMan
from daemon.settings import Config
from daemon.tuning.experiment import Recording, fly, gentle
from daemon.tuning.pulsed import PulsedAutopilot
from daemon.tuning.pulses import programme


async def record(connection: str, config: Config, *, takeoff_m: float | None, tell: Callable[[str], None]) -> Recording:
    """Fly the pulses on the autopilot at a MAVSDK URL; arguments and errors as ``experiment.fly``.

    Raises ``EndpointInUseError`` when a daemon has the vehicle.
    """
    with claim(connection):
        return await _recorded(connection, config, takeoff_m, tell)


async def _recorded(connection: str, config: Config, takeoff_m: float | None, tell: Callable[[str], None]) -> Recording:
    loop = asyncio.get_running_loop()
    config = gentle(config)
    parameters = control_parameters(config, None)
    link = MavsdkLink(connection, link_timeout_s=config.link.lost_s)
    pulsed = PulsedAutopilot(link, parameters, loop.time)
    vehicle = Vehicle(config, pulsed, lambda: live_alarm(loop))
    dead_man = DeadMan(vehicle.gate, dead_man_timing(config))
    tasks = asyncio.ensure_future(vehicle.run())
    dead_man.start()
    flight = asyncio.ensure_future(fly(vehicle, pulsed, programme(parameters), takeoff_m=takeoff_m, tell=tell))
    try:
        await asyncio.wait({tasks, flight}, return_when=asyncio.FIRST_COMPLETED)
        if tasks.done():
            tasks.result()
        return await flight
    finally:
        flight.cancel()
        await asyncio.gather(flight, return_exceptions=True)
        dead_man.stop()
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)
