"""Follow a target that walks in a circle, by moving the active goal five times a second: follow_target.py SECONDS."""

import asyncio
import sys
from math import cos, sin

from daemon.goals.client import FlightClient

RADIUS_M = 6.0
HEIGHT_M = 5.0
RATE_RAD_S = 0.1
PERIOD_S = 0.2


def target(time_s: float) -> tuple[float, float]:
    """North and east of the target; put your own tracker here."""
    return RADIUS_M * cos(RATE_RAD_S * time_s), RADIUS_M * sin(RATE_RAD_S * time_s)


async def main(seconds: float) -> int:
    loop = asyncio.get_running_loop()
    async with FlightClient() as flight:
        goal = await flight.goto(*target(0.0), -HEIGHT_M, mode="forward_heading", hold_s=3600.0)
        begin_s = loop.time()
        while not goal.done and loop.time() - begin_s < seconds:
            await goal.move(*target(loop.time() - begin_s), -HEIGHT_M, mode="forward_heading", hold_s=3600.0)
            await asyncio.sleep(PERIOD_S)
        if not goal.done:
            await goal.cancel()
        result = await goal
    print(result.outcome, result.reason or "")
    return 0 if result.outcome == "canceled" else 1


if __name__ == "__main__":
    sys.exit(asyncio.run(main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)))
