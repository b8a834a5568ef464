"""MAVSDK's synchronous plugins, called from an asyncio loop that sleeps: the newest ODOMETRY is echoed at 100 Hz."""

import asyncio
from typing import Any

from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.offboard import AttitudeRate, Offboard
from mavsdk.plugins.telemetry import Telemetry

from daemon.bench.contestants.common import PERIOD_S, PORT, SECONDS, WARM_UP_S, Meter, thrust_of


async def main() -> None:
    """Connect, echo, measure."""
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    sdk.add_any_connection(f"udpin://127.0.0.1:{PORT}")
    system = sdk.first_autopilot(10.0)
    telemetry, offboard = Telemetry(system), Offboard(system)
    newest: Any = None

    def take(odometry: Any, _user_data: Any) -> None:
        nonlocal newest
        newest = odometry

    telemetry.subscribe_odometry(take)
    loop = asyncio.get_running_loop()
    while newest is None:  # noqa: ASYNC110 - as users write it
        await asyncio.sleep(PERIOD_S)
    offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, 0.5))
    offboard.start()
    due_s, meter = loop.time(), None
    warm_s = due_s + WARM_UP_S
    while loop.time() < warm_s + SECONDS:
        if meter is None and loop.time() >= warm_s:
            meter = Meter()
        offboard.set_attitude_rate(AttitudeRate(0.0, 0.0, 0.0, thrust_of(newest.position_body.x_m)))
        due_s += PERIOD_S
        await asyncio.sleep(due_s - loop.time())
    if meter is not None:
        meter.done()


asyncio.run(main())
