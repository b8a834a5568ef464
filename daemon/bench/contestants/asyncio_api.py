"""MAVSDK's asyncio API as its documentation teaches it: async for over telemetry, awaited offboard setpoints."""

import asyncio
from typing import Any

from mavsdk.asyncio.mavsdk import Configuration, Mavsdk
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.component_type import ComponentType
from mavsdk.plugins.offboard import AttitudeRate

from daemon.bench.contestants.common import PERIOD_S, PORT, SECONDS, WARM_UP_S, Meter, thrust_of


async def main() -> None:
    """Connect, echo, measure."""
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)) as sdk:
        await sdk.add_any_connection(f"udpin://127.0.0.1:{PORT}")
        system = await sdk.first_autopilot(timeout_s=10.0)
        telemetry, offboard = TelemetryAsync(system), OffboardAsync(system)
        newest: Any = None

        async def follow() -> None:
            nonlocal newest
            async for odometry in telemetry.subscribe_odometry():
                newest = odometry

        following = asyncio.create_task(follow())
        while newest is None:  # noqa: ASYNC110 - as users write it
            await asyncio.sleep(PERIOD_S)
        await offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, 0.5))
        await offboard.start()
        loop = asyncio.get_running_loop()
        due_s, meter = loop.time(), None
        warm_s = due_s + WARM_UP_S
        while loop.time() < warm_s + SECONDS:
            if meter is None and loop.time() >= warm_s:
                meter = Meter()
            await offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, thrust_of(newest.position_body.x_m)))
            due_s += PERIOD_S
            await asyncio.sleep(due_s - loop.time())
        if meter is not None:
            meter.done()
        following.cancel()


asyncio.run(main())
