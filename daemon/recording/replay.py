"""Feeds a flight's recorded inputs through the flow again and compares what comes out, field by field."""

import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daemon import pipeline
from daemon.messages import AutopilotStatus, Imu, Odometry
from daemon.pipeline import Inputs, Parameters, Record
from daemon.recording import flight
from daemon.recording.codec import Decoder, RecordError
from daemon.recording.flight import Form, Part, Table
from daemon.recording.topics import REST, TICK, Start, unpack_window

Change = Callable[[Parameters], Parameters]


@dataclass(frozen=True, slots=True)
class Difference:
    """A field that came out differently: in how many ticks, when first (record's clock), and by how much at most."""

    field: str
    ticks: int
    first_s: float
    largest: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """What a replay gave. ``skipped`` ticks had no beginning to replay from; ``unknown`` fields only one side has."""

    ticks: int
    skipped: int
    differences: list[Difference]
    unknown: list[str]

    @property
    def identical(self) -> bool:
        """Every bit of every tick."""
        return self.ticks > 0 and not self.differences and not self.unknown


class Replay:
    """One pass over a record; ``change`` gives each tick other parameters than the recorded ones."""

    def __init__(self, files: list[Path], change: Change | None = None) -> None:
        self.skipped = 0
        self._files = files
        self._change = change or (lambda parameters: parameters)
        self._decoder = Decoder()
        self._state: pipeline.PipelineState | None = None
        self._held: dict[str, Any] = {}
        self._changed: tuple[Parameters, Parameters] | None = None

    def steps(self) -> Iterator[tuple[Part, Record]]:
        """Each recorded tick and the record of its replay. Raises ``RecordError``."""
        for file in self._files:
            for part in flight.messages(file):
                if part.topic != "/flightd/tick":
                    self._take(part)
                elif self._state is None:
                    self.skipped += 1
                else:
                    yield part, self._step(part)

    def _step(self, part: Part) -> Record:
        assert self._state is not None and part.form is not None
        now_s, dt_s = part.form.numbers(part.data, ("now_s", "dt_s"))
        inputs = Inputs(**{**self._held, "parameters": self._parameters()})
        self._state, _, record = pipeline.step(self._state, inputs, now_s, dt_s)
        return record

    def _parameters(self) -> Parameters:
        recorded: Parameters = self._held["parameters"]
        if self._changed is None or self._changed[0] is not recorded:
            self._changed = (recorded, self._change(recorded))
        return self._changed[1]

    def _take(self, part: Part) -> None:
        """Hold what a message tells of the inputs."""
        decode, held = self._decoder.decode, self._held
        if part.topic == "/flightd/start":
            start = decode(Start, part.json)
            self._state = start.state
            self._held = {name: getattr(start.inputs, name) for name in _HINTS}
        elif part.topic == "/flightd/odometry":
            held["odometry"] = _message(Odometry, part)
        elif part.topic == "/flightd/imu":
            held["imu"] = _message(Imu, part)
        elif part.topic == "/flightd/window" and part.form is not None:
            offset = part.form.end_of_strings(part.data)
            held["window"] = unpack_window(part.form.values(part.data), part.data, offset)
        elif part.topic == "/flightd/status":
            held["status"] = decode(AutopilotStatus, part.json)
        elif part.topic == "/flightd/parameters":
            held["parameters"] = decode(Parameters, part.json)
        elif part.topic == "/flightd/inputs":
            found = part.json
            held.update({name: decode(_HINTS[name], found[name]) for name in REST if name in found})


def compare(files: list[Path], change: Change | None = None) -> Comparison:
    """Replay a flight and compare each field of each tick with the recorded one. Raises ``RecordError``."""
    replay = Replay(files, change)
    recorded: list[bytes] = []
    again: list[bytes] = []
    form: Form | None = None
    for part, record in replay.steps():
        form = part.form
        recorded.append(part.data)
        again.append(TICK.pack(record))
    if form is None:
        raise RecordError(f"{files[0]}: holds nothing that can be replayed")
    before, after = Table.of(form, recorded), Table.of(Form.of(TICK.definition), again)
    names, new_names = set(before.fields), set(after.fields)
    differences = [
        found for name in before.fields if name in new_names and (found := _difference(name, before, after)) is not None
    ]
    return Comparison(len(again), replay.skipped, differences, sorted(names ^ new_names))


def _difference(name: str, before: Table, after: Table) -> Difference | None:
    """How the field differs; None when every bit is the same (NaN is equal to NaN, 0.0 is not equal to -0.0)."""
    if name in before.form.texts:
        differs = np.array([a != b for a, b in zip(before.text(name), after.text(name), strict=True)])
        largest = 0.0
    else:
        a, b = before[name].reshape(len(before.rows), -1), after[name].reshape(len(after.rows), -1)
        if a.shape != b.shape or a.dtype != b.dtype:
            return Difference(name, len(a), float(before["now_s"][0]), float("nan"))
        differs = (_bits(a) != _bits(b)).any(axis=1)
        with np.errstate(invalid="ignore"):
            apart = np.abs(a.astype(float) - b.astype(float))[differs]
        known = apart[np.isfinite(apart)]
        largest = float(known.max()) if len(known) else float("nan") if differs.any() else 0.0
    if not differs.any():
        return None
    return Difference(name, int(differs.sum()), float(before["now_s"][differs.argmax()]), largest)


def _bits(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    values = np.ascontiguousarray(values)
    return values.view(np.int64) if values.dtype.itemsize == 8 else values.view(np.uint8)


def _message(kind: type, part: Part) -> Any:
    assert part.form is not None
    try:
        return kind(**part.form.values(part.data))
    except TypeError as error:
        raise RecordError(f"{part.topic}: {error}") from None


_HINTS = typing.get_type_hints(Inputs)
