"""Write where the vehicle is and where it is wanted to a CSV file: log_telemetry.py FILE ROWS."""

import asyncio
import csv
import sys
from pathlib import Path

from daemon.goals.client import FlightClient

RATE_HZ = 20.0
AXES = ("north_m", "east_m", "down_m")


async def main(file: Path, rows: int) -> None:
    wanted = ["", "", ""]
    with file.open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["time_s", *AXES, *(f"reference_{axis}" for axis in AXES)])
        async with FlightClient() as flight:
            async for message in flight.telemetry("state", "reference", rate_hz=RATE_HZ):
                if message.topic == "reference":
                    wanted = message.data["position_ned_m"]
                    continue
                table.writerow([message.data["time_s"], *message.data["position_ned_m"], *wanted])
                rows -= 1
                if rows <= 0:
                    return


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: log_telemetry.py FILE ROWS")
    asyncio.run(main(Path(sys.argv[1]), int(sys.argv[2])))
