"""Fly lanes over a rectangle that begins where the local frame does: survey_grid.py [LENGTH WIDTH SPACING HEIGHT]."""

import sys

from daemon.goals.blocking import BlockingFlightClient


def lanes(length_m: float, width_m: float, spacing_m: float, height_m: float) -> list[list[float]]:
    """Corners of the lanes, local NED, each lane the other way than the one before."""
    corners = []
    for lane in range(int(width_m // spacing_m) + 1):
        ends = [0.0, length_m] if lane % 2 == 0 else [length_m, 0.0]
        corners += [[north, lane * spacing_m, -height_m] for north in ends]
    return corners


def main(arguments: list[str]) -> int:
    length_m, width_m, spacing_m, height_m = map(float, arguments or ["20", "12", "4", "5"])
    with BlockingFlightClient() as flight:
        goal = flight.path(lanes(length_m, width_m, spacing_m, height_m), limits={"speed_m_s": 3.0})
        for feedback in goal:
            print(f"{feedback.progress:.0%}")
        result = goal.wait()
    print(result.outcome, result.reason or "")
    return 0 if result.succeeded else 1


if __name__ == "__main__":
    if len(sys.argv) - 1 not in (0, 4):
        sys.exit("usage: survey_grid.py [LENGTH WIDTH SPACING HEIGHT]")
    sys.exit(main(sys.argv[1:]))
