"""Reads flight records, whole or cut off: as arrays for the report, in order for the replay."""

import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from daemon.recording import layout
from daemon.recording.codec import RecordError
from daemon.recording.layout import HEADER, Leaf


@dataclass(frozen=True, slots=True)
class Form:
    """How the messages of a binary channel are read: from the schema in the file, so that any version can be."""

    leaves: list[Leaf]
    dtype: np.dtype[Any]
    texts: list[str]

    @classmethod
    def of(cls, definition: str) -> "Form":
        """The form that a schema's text describes; what follows the strings (a sequence) is left to its reader."""
        lines = [line for line in definition.splitlines() if not line.startswith(("#", "float64[] "))]
        leaves = layout.parse_definition("\n".join(lines))
        fixed = [leaf for leaf in leaves if leaf.kind != "string"]
        return cls(fixed, layout.numpy_type(fixed), [leaf.name for leaf in leaves if leaf.kind == "string"])

    def values(self, data: bytes) -> dict[str, Any]:
        """One message as Python values: floats, ints, bools, tuples, names of enumerations, texts."""
        row = np.frombuffer(data, self.dtype, 1, len(HEADER))[0]
        found: dict[str, Any] = {}
        for leaf in self.leaves:
            value = row[leaf.name]
            found[leaf.name] = tuple(value.tolist()) if leaf.count > 1 else value.item()
            if leaf.members:
                found[leaf.name] = leaf.members[found[leaf.name]]
        return found | dict(zip(self.texts, self.strings(data), strict=True))

    def numbers(self, data: bytes, names: Sequence[str]) -> list[float]:
        """Some single numbers of a message."""
        row = np.frombuffer(data, self.dtype, 1, len(HEADER))[0]
        return [row[name].item() for name in names]

    def strings(self, data: bytes) -> list[str]:
        """The texts of a message."""
        return layout.read_strings(data, len(HEADER) + self.dtype.itemsize, len(self.texts))[0]

    def end_of_strings(self, data: bytes) -> int:
        """Where a sequence begins that follows the texts."""
        return layout.read_strings(data, len(HEADER) + self.dtype.itemsize, len(self.texts))[1]


@dataclass(slots=True)
class Part:
    """One message: its topic, its data, and how it is read (None: JSON)."""

    topic: str
    data: bytes
    form: Form | None

    @property
    def json(self) -> dict[str, Any]:
        """The message of a JSON channel."""
        found: dict[str, Any] = json.loads(self.data)
        return found


def messages(file: Path) -> Iterator[Part]:
    """The ``/flightd`` messages of a record in the order in which they were written; a record cut off just ends.

    Raises ``RecordError`` when it is no flight record.
    """
    forms: dict[int, Form | None] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    try:
        with file.open("rb") as stream:
            for record in StreamReader(stream).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                    schema = schemas.get(record.schema_id)
                    binary = record.topic.startswith("/flightd/") and schema and schema.encoding == "ros2msg"
                    forms[record.id] = Form.of(schema.data.decode()) if binary and schema else None
                elif isinstance(record, Message) and channels[record.channel_id].topic.startswith("/flightd/"):
                    topic = channels[record.channel_id].topic
                    yield Part(topic, record.data, forms[record.channel_id])
    except (EndOfFile, struct.error):
        return
    except OSError as error:
        raise RecordError(f"{file}: {error.strerror}") from None
    except (McapError, ZstdError, KeyError, UnicodeDecodeError):
        if channels:  # what power loss leaves of the last blocks need not be a record
            return
        raise RecordError(f"{file}: is not a flight record") from None


@dataclass(slots=True)
class Table:
    """A binary channel of a whole flight: ``rows`` is a structured array, ``texts`` the strings of each row."""

    form: Form
    rows: np.ndarray[Any, Any]
    texts: list[list[str]]

    @classmethod
    def of(cls, form: Form, data: list[bytes]) -> "Table":
        """The table of messages."""
        begin, end = len(HEADER), len(HEADER) + form.dtype.itemsize
        rows = np.frombuffer(b"".join(message[begin:end] for message in data), form.dtype)
        return cls(form, rows, [form.strings(message) for message in data])

    @property
    def fields(self) -> list[str]:
        """Names of all columns."""
        return [*(leaf.name for leaf in self.form.leaves), *self.form.texts]

    def __getitem__(self, name: str) -> np.ndarray[Any, Any]:
        return np.asarray(self.rows[name])

    def text(self, name: str) -> list[str]:
        """One string of each row."""
        index = self.form.texts.index(name)
        return [row[index] for row in self.texts]

    def names(self, name: str) -> list[str]:
        """An enumeration of each row by name."""
        members = next(leaf.members for leaf in self.form.leaves if leaf.name == name)
        return [members[i] for i in self.rows[name]]


@dataclass(slots=True)
class Flight:
    """A record in memory; events, goals and the rest as they were written, in order."""

    ticks: Table
    about: dict[str, Any]
    parameters: dict[str, Any]
    events: list[dict[str, Any]] = field(default_factory=list)
    goals: list[dict[str, Any]] = field(default_factory=list)
    plans: list[dict[str, Any]] = field(default_factory=list)
    status: list[dict[str, Any]] = field(default_factory=list)

    @property
    def control_rate_hz(self) -> float:
        """Ticks a second, as configured. Raises ``RecordError``."""
        try:
            return float(self.about["config"]["loops"]["control_rate_hz"])
        except KeyError:
            raise RecordError("the record does not hold the configuration that flew") from None


def load(files: list[Path]) -> Flight:
    """A flight from its parts. Raises ``RecordError``."""
    packed: dict[str, tuple[Form, list[bytes]]] = {}
    notes: dict[str, list[dict[str, Any]]] = {}
    for file in files:
        for part in messages(file):
            if part.form is None:
                notes.setdefault(part.topic, []).append(part.json)
            else:
                packed.setdefault(part.topic, (part.form, []))[1].append(part.data)
    if "/flightd/tick" not in packed:
        raise RecordError(f"{files[0]}: holds no tick")
    start = notes.get("/flightd/start", [{"inputs": {"parameters": {}, "status": {}}}])[0]["inputs"]
    about = notes.get("/flightd/about", [{}])[0]
    return Flight(
        Table.of(*packed["/flightd/tick"]),
        about,
        start["parameters"],
        notes.get("/flightd/event", []),
        notes.get("/flightd/goal", []),
        notes.get("/flightd/plan", []),
        [start["status"], *notes.get("/flightd/status", [])],
    )
