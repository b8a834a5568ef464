"""mavsdk-grpc (the API of before version 4, with its server process) as its documentation teaches it."""

import asyncio
import os
from pathlib import Path
from typing import Any

from mavsdk_grpc import System  # type: ignore[import-not-found,unused-ignore]
from mavsdk_grpc.offboard import AttitudeRate  # type: ignore[import-not-found,unused-ignore]

from daemon.bench.contestants.common import PERIOD_S, PORT, SECONDS, WARM_UP_S, Meter, thrust_of
from daemon.bench.memory import peak_mb


async def main() -> None:
    """Connect, echo, measure."""
    drone = System()
    await drone.connect(system_address=f"udpin://127.0.0.1:{PORT}")
    async for state in drone.core.connection_state():
        if state.is_connected:
            break
    newest: Any = None

    async def follow() -> None:
        nonlocal newest
        async for odometry in drone.telemetry.odometry():
            newest = odometry

    following = asyncio.create_task(follow())
    while newest is None:  # noqa: ASYNC110 - as users write it
        await asyncio.sleep(PERIOD_S)
    await drone.offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, 0.5))
    await drone.offboard.start()
    loop = asyncio.get_running_loop()
    due_s, meter, server_s = loop.time(), None, 0.0
    warm_s = due_s + WARM_UP_S
    while loop.time() < warm_s + SECONDS:
        if meter is None and loop.time() >= warm_s:
            meter, server_s = Meter(), _server()[0]
        await drone.offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, thrust_of(newest.position_body.x_m)))
        due_s += PERIOD_S
        await asyncio.sleep(due_s - loop.time())
    if meter is not None:
        cpu_s, memory_mb = _server()
        meter.done(cpu_s - server_s, memory_mb)
    following.cancel()


def _server() -> tuple[float, float]:
    """CPU seconds and peak memory (MB) of the running server process, which this process started."""
    ticks, memory_mb = 0, 0.0
    for process in Path("/proc").glob("[0-9]*"):
        try:
            fields = (process / "stat").read_text().rpartition(")")[2].split()
            if int(fields[1]) == os.getpid():
                ticks += int(fields[11]) + int(fields[12])
                memory_mb += peak_mb(process.name)
        except OSError:  # it ended meanwhile
            continue
    return ticks / os.sysconf("SC_CLK_TCK"), memory_mb


asyncio.run(main())
