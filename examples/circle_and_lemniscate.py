"""Fly a circle that looks at its centre, then a figure of eight that looks ahead: circle_and_lemniscate.py [HEIGHT]."""

import sys

from daemon.goals.blocking import BlockingFlightClient


def main(height_m: float) -> int:
    center = [0.0, 0.0, -height_m]
    circle = {"kind": "circle", "center": center, "radius_m": 5.0, "speed_m_s": 2.0, "heading": "target"}
    eight = {"kind": "lemniscate", "center": center, "size_m": [8.0, 4.0], "period_s": 20.0, "heading": "velocity"}
    with BlockingFlightClient() as flight:
        for shape in (circle, eight):
            result = flight.fly(shape).wait()
            print(f"{shape['kind']}: {result.outcome} {result.reason or ''}")
            if not result.succeeded:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0))
