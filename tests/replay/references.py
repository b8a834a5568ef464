"""Makes the reference recordings. `make replay-update`: on purpose only, when the flow is to answer differently."""

import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from support.flight import Flight, fly

from daemon import pipeline
from daemon.autopilot.session import Px4Session
from daemon.config import load
from daemon.messages import RequestKind, VehicleRequest
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, Record
from daemon.recording.recorder import RecordingSettings
from daemon.recording.topics import Step
from daemon.recording.writer import RecordWriter

HERE = Path(__file__).parent
TRAFFIC = HERE.parent / "fixtures" / "traffic" / "offboard_lemniscate.jsonl.gz"
TICK_S = 0.01
WALL_S = 1.75e9
TRAFFIC_S, ENGAGE_S = 6.0, 0.5
SIMULATED_S = 7.0


def traffic(until_s: float) -> Iterator[tuple[float, str, dict[str, Any]]]:
    """Time, name and fields of each recorded message of a real PX4."""
    with gzip.open(TRAFFIC, "rt") as lines:
        for line in lines:
            message = json.loads(line)
            if message["t"] > until_s:
                return
            yield message["t"], message["msg"], message["f"]


def from_px4(writer: RecordWriter) -> None:
    """Real traffic of a PX4 that goes from Hold to offboard, as the daemon would have seen it when it engaged then."""
    session = Px4Session()
    config = load([])
    parameters = pipeline_parameters(config, geofence(config, (0.0, 0.0, 0.0)))
    state = pipeline.initial(parameters)
    messages = list(traffic(TRAFFIC_S))
    for tick in range(1, round(TRAFFIC_S / TICK_S)):
        now_s = tick * TICK_S
        while messages and messages[0][0] <= now_s:
            time_s, name, fields = messages.pop(0)
            session.receive(name, fields, time_s)
        session.poll(now_s)
        inputs = Inputs(
            odometry=session.odometry.value,
            imu=session.imu.value,
            status=session.status.value,
            window=None,
            request=VehicleRequest(1, RequestKind.ENGAGE) if now_s >= ENGAGE_S else None,
            latched=False,
            parameters=parameters,
        )
        state, _, record = pipeline.step(state, inputs, now_s, TICK_S)
        writer.tick(Step(state, inputs, record))


def from_simulation(writer: RecordWriter) -> None:
    """Two goals with a preemption, a turn of heading, and the sensors' noise; engaging included."""

    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        until_s = flight.now_s + SIMULATED_S

        def tick(inputs: Inputs, record: Record) -> None:
            if record.now_s < until_s:
                writer.tick(Step(flight.vehicle.control.state, inputs, record))

        flight.vehicle.control.listeners.append(tick)
        await flight.vehicle.commander.engage()
        await flight.goto(4.0, 0.0, -5.0)
        await flight.until(lambda: flight.now_s > until_s - 4.5)
        await flight.goto(3.0, 3.0, -5.5, yaw_deg=60.0)
        await flight.until(lambda: flight.now_s > until_s)

    fly(scenario, seed=5, noise=True)


REFERENCES = {"px4_traffic": from_px4, "simulated_goals": from_simulation}


def make(directory: Path) -> None:
    """Write all references."""
    for name, flown in REFERENCES.items():
        writer = RecordWriter(RecordingSettings(directory=directory, when="always", path_poses=2), {}, lambda: WALL_S)
        flown(writer)
        assert writer.file is not None
        file = writer.file
        writer.close()
        file.rename(directory / f"{name}.mcap")


if __name__ == "__main__":
    make(HERE)
