"""Plays the commands of a recording of PX4 1.17 SITL into the simulated PX4 and lays the two traffics side by side."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.sim import airframe_files
from daemon.sim.px4 import STEP_S, SimulatedPx4

RECORDINGS = Path(__file__).parent / "recordings"
# Lists of standing failures repeat with each change of health; they are not part of a sequence of happenings.
CHECKS = {27825120, 30612409, 26788467, 17154777, 19865031, 17231145, 23579003, 18691879, 33420013, 18648929, 23035260}
PILOT = (255, 190)
CLIENT = (1, 195)


class Traffic:
    """Rare messages as ``[t, who, name, fields]`` (who: rx, tx, rx_gcs, tx_gcs, note), frequent ones as tables."""

    def __init__(self, slow: list[Any], dense: dict[str, Any], rates: dict[str, float] | None = None) -> None:
        self.slow, self.dense, self.rates = slow, dense, rates or {}

    def table(self, name: str) -> np.ndarray:
        """Rows ``[t, fields ...]``."""
        return np.array(self.dense[name]["rows"], dtype=float)

    def select(self, name: str, who: str = "rx") -> list[tuple[float, dict[str, Any]]]:
        return [(t, f) for t, w, n, f in self.slow if n == name and w == who]

    def acks(self, who: str = "rx", without: tuple[int, ...] = ()) -> list[tuple[int, int]]:
        """(command, result) in order."""
        acks = [(f["command"], f["result"]) for _, f in self.select("COMMAND_ACK", who)]
        return [ack for ack in acks if ack[0] not in without]

    def happenings(self) -> list[tuple[float, int]]:
        """(t, id) of EVENT messages without the health lists."""
        return [(t, f["id"]) for t, f in self.select("EVENT") if f["id"] not in CHECKS]

    def changes(self, name: str, *fields: str) -> list[tuple[float, tuple[Any, ...]]]:
        """(t, values) whenever the fields of a message change."""
        out: list[tuple[float, tuple[Any, ...]]] = []
        for t, f in self.select(name):
            if name == "HEARTBEAT" and f.get("type", 2) != 2:
                continue
            values = tuple(f[field] for field in fields)
            if not out or out[-1][1] != values:
                out.append((t, values))
        return out

    def note(self, beginning: str) -> float:
        """When the recording's script said so."""
        return next(t for t, who, text, _ in self.slow if who == "note" and text.startswith(beginning))


class Flight(Traffic):
    """A simulated flight whose messages are kept with the time of their arrival."""

    def __init__(self, px4: SimulatedPx4) -> None:
        super().__init__([], {})
        self.px4, self.t, self.messages = px4, 0.0, []
        self._start_us = px4.simulated_us

    def send(self, name: str, fields: dict[str, Any], sender: tuple[int, int] = CLIENT) -> None:
        full = {"target_system": self.px4.system_id, "target_component": 1, **fields}
        self.px4.receive(name, full, sender_system=sender[0], sender_component=sender[1])

    def command(self, number: int, *parameters: float) -> None:
        values = (*parameters, *[float("nan")] * (7 - len(parameters)))
        self.send("COMMAND_LONG", {"command": number, **{f"param{i + 1}": v for i, v in enumerate(values)}})

    def step(self) -> None:
        self.px4.step()
        self.t = (self.px4.simulated_us - self._start_us) * 1e-6
        for name, fields in self.px4.take_outgoing():
            self.messages.append((self.t, name, fields))
            who = "rx_gcs" if fields.get("target_system") == PILOT[0] else "rx"
            self.slow.append([self.t, who, name, fields])

    def run(self, until_s: float) -> None:
        while self.t < until_s - 0.5 * STEP_S:
            self.step()

    def column(self, name: str, *fields: str) -> np.ndarray:
        """Rows ``[t, fields ...]`` of a message; lists are unrolled."""
        rows = []
        for t, n, f in self.messages:
            if n == name:
                row = [t]
                for field in fields:
                    row.extend(f[field] if isinstance(f[field], list) else [f[field]])
                rows.append(row)
        return np.array(rows, dtype=float)

    def replay(
        self,
        recording: Traffic,
        until_s: float,
        at: dict[float, Callable[[], None]] | None = None,
        since_s: float = 0.0,
    ) -> "Flight":
        """Send what the recording sent, when it did; ``at``: what else to do at which time."""
        self._start_us -= round(since_s * 1e6)
        self.t += since_s
        queue: list[tuple[float, Callable[[], None]]] = list((at or {}).items())
        for t, who, name, fields in recording.slow:
            if who in ("tx", "tx_gcs"):
                sender = PILOT if who == "tx_gcs" else CLIENT
                queue.append((t, lambda n=name, f=fields, s=sender: self.send(n, f, s)))
        if "tx:SET_ATTITUDE_TARGET" in recording.dense:
            for t, p, q, r, thrust in recording.table("tx:SET_ATTITUDE_TARGET"):
                queue.append((t, lambda a=(p, q, r, thrust): self.send("SET_ATTITUDE_TARGET", rate_setpoint(*a))))
        for t, action in sorted(queue, key=lambda item: item[0]):
            if t < since_s:
                continue
            if t >= until_s:
                break
            self.run(t)
            action()
        self.run(until_s)
        return self


def rate_setpoint(p: float, q: float, r: float, thrust: float) -> dict[str, Any]:
    rates = {"body_roll_rate": p, "body_pitch_rate": q, "body_yaw_rate": r}
    return {"type_mask": 128, "q": [0.0] * 4, **rates, "thrust": thrust}


@pytest.fixture(scope="session")
def recording() -> Callable[[str], Traffic]:
    def load(name: str) -> Traffic:
        with gzip.open(RECORDINGS / f"{name}.json.gz", "rt") as file:
            data = json.load(file)
        return Traffic(data["slow"], data["dense"], data.get("rates"))

    return load


@pytest.fixture(scope="session")
def flight() -> Callable[..., Flight]:
    """A vehicle on the ground, or in the air when a height is given."""

    def make(height_m: float = 0.0, *, noise: bool = False, seed: int = 1, **arguments: Any) -> Flight:
        px4 = SimulatedPx4(airframe=airframe_files.load("sih"), seed=seed, noise=noise, **arguments)
        if height_m > 0.0:
            px4.start_in_air(height_m)
        return Flight(px4)

    return make
