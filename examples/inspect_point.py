"""Look at a point from its north, east, south and west: inspect_point.py NORTH EAST DOWN [DISTANCE]."""

import sys

from daemon.goals.blocking import BlockingFlightClient

SIDES = ((1.0, 0.0, 180.0), (0.0, 1.0, -90.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 90.0))
LOOK_S = 3.0


def main(north: float, east: float, down: float, distance_m: float = 4.0) -> int:
    with BlockingFlightClient() as flight:
        for toward_north, toward_east, yaw_deg in SIDES:
            side = north + distance_m * toward_north, east + distance_m * toward_east
            result = flight.goto(*side, down, yaw_deg=yaw_deg, hold_s=LOOK_S).wait()
            print(f"from {side}: {result.outcome} {result.reason or ''}")
            if not result.succeeded:
                return 1
    return 0


if __name__ == "__main__":
    if not 3 <= len(sys.argv) - 1 <= 4:
        sys.exit("usage: inspect_point.py NORTH EAST DOWN [DISTANCE]")
    sys.exit(main(*map(float, sys.argv[1:])))
