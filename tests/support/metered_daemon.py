"""``flightd run`` that notes each tick: ``python metered_daemon.py CONNECTION SOCKET OUT``.

OUT gets a JSON list of ticks: time (CLOCK_MONOTONIC), tracking error in metres or null, late and missed ticks so far.
"""

import json
import math
import sys
from pathlib import Path

from daemon import app
from daemon.loops.vehicle import Vehicle
from daemon.pipeline import Inputs, Record

ticks: list[tuple[float, float | None, int, int]] = []


def watch(vehicle: Vehicle) -> None:
    statistics = vehicle.control.grid.statistics

    def note(_inputs: Inputs, record: Record) -> None:
        here, there = record.predicted, record.reference
        known = here is not None and there is not None
        error_m = math.dist(here.position_ned_m, there.position_ned_m) if known else None  # type: ignore[union-attr]
        ticks.append((record.now_s, error_m, statistics.late, statistics.missed))

    vehicle.control.listeners.append(note)


if __name__ == "__main__":
    connection, path, out = sys.argv[1:]
    code = app.run([], connection, Path(path), watch=watch, recording={"enabled": False})
    Path(out).write_text(json.dumps(ticks))
    sys.exit(code)
