"""Fly a circle that looks at its centre, then a figure of eight that looks ahead: circle_and_lemniscate.py [HEIGHT]."""

import sys
from typing import Any

from daemon.goals.blocking import BlockingFlightClient


def shapes(height_m: float) -> list[dict[str, Any]]:
    """Both trajectories; the eight takes so long that the vehicle can turn its nose along it."""
    center = [0.0, 0.0, -height_m]
    circle = {"kind": "circle", "center": center, "radius_m": 5.0, "speed_m_s": 2.0, "heading": "target"}
    eight = {"kind": "lemniscate", "center": center, "size_m": [8.0, 4.0], "period_s": 25.0, "heading": "velocity"}
    return [circle, eight]


def main(height_m: float) -> int:
    with BlockingFlightClient() as flight:
        for shape in shapes(height_m):
            result = flight.fly(shape).wait()
            print(f"{shape['kind']}: {result.outcome} {result.reason or ''}")
            if not result.succeeded:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0))
