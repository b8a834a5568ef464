"""What a flight record holds: the channels, and how each tick, event and goal is written to them.

Inputs come before the tick that saw them first, so that reading in order gives each tick its inputs:
``/flightd/start`` (memory of the flow and held inputs), ``/flightd/odometry``, ``/flightd/imu``, ``/flightd/window``,
``/flightd/status``, ``/flightd/parameters``, ``/flightd/inputs`` (the rest), then ``/flightd/tick`` with all that came
out.
``/flightd/event``, ``/flightd/goal``, ``/flightd/plan`` and ``/flightd/about`` tell of the rest. For the eye there are
Foxglove's own messages, in east-north-up and forward-left-up as viewers expect: ``/tf``, ``/pose``,
``/reference/pose``, ``/path/flown``, ``/path/planned``, ``/location``, ``/log``.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any

from foxglove import Channel, Context, Schema

from daemon.messages import ZERO3, FrameShift, Imu, Odometry, Reference, ReferenceWindow
from daemon.pipeline import Inputs, PipelineState, Record
from daemon.recording import codec
from daemon.recording.layout import HEADER, Layout
from daemon.recording.scene import Scene

SAMPLE = ("time_s", "yaw_rad", "yaw_rate_rad_s")
SAMPLE_VECTORS = ("position_ned_m", "velocity_ned_m_s", "acceleration_ned_m_s2", "jerk_ned_m_s3")
SAMPLE_SIZE = len(SAMPLE) + 3 * len(SAMPLE_VECTORS)
_SCENE_EVERY = 5  # ticks: the eye does not need more than 20 Hz


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One tick as the control task saw it, memory afterwards. All immutable, so that handing over is free."""

    state: PipelineState
    inputs: Inputs
    record: Record


@dataclass(frozen=True, slots=True)
class Note:
    """Something besides ticks: an ``event``, a ``goal`` or a ``plan``, with the time as part of the payload."""

    kind: str
    time_s: float
    payload: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """From where a replay can begin: the flow's memory and the inputs that were held then."""

    state: PipelineState
    inputs: Inputs


@dataclass(frozen=True, slots=True, eq=False)
class WindowHead:
    """What a window has besides its samples."""

    shift: FrameShift
    goal_id: str | None


REST = tuple(
    field.name for field in fields(Inputs) if field.name not in ("odometry", "imu", "window", "status", "parameters")
)  # inputs that seldom change
_rest = attrgetter(*REST)
ODOMETRY = Layout(Odometry, "flightd/Odometry")
IMU = Layout(Imu, "flightd/Imu")
TICK = Layout(Record, "flightd/Tick")
WINDOW = Layout(WindowHead, "flightd/Window")
_SAMPLES = f"# samples: {', '.join((*SAMPLE, *SAMPLE_VECTORS))}\nfloat64[] samples\n"
_scalars = attrgetter(*SAMPLE)
_vectors = attrgetter(*SAMPLE_VECTORS)


_WITHDRAWN = ReferenceWindow(None, (), FrameShift())


def pack_window(window: ReferenceWindow) -> bytes:
    """The head, then all samples as one sequence of numbers."""
    head = WINDOW.pack(WindowHead(window.shift, window.goal_id))
    values: list[float] = []
    for sample in window.samples:
        values += _scalars(sample)
        for vector in _vectors(sample):
            values += vector
    head += bytes(-(len(head) - len(HEADER)) % 4) + struct.pack("<I", len(values))
    return head + bytes(-(len(head) - len(HEADER)) % 8) + struct.pack(f"<{len(values)}d", *values)


def unpack_window(head: dict[str, Any], data: bytes, offset: int) -> ReferenceWindow | None:
    """The window whose head was read already, up to ``offset``; the samples end the message. None: it was withdrawn."""
    (count,) = struct.unpack_from("<I", data, offset - (offset - len(HEADER)) % -4)
    numbers = struct.unpack_from(f"<{count}d", data, len(data) - 8 * count)
    if not numbers:
        return None
    samples = []
    for i in range(0, len(numbers), SAMPLE_SIZE):
        time_s, yaw, yaw_rate, *xyz = numbers[i : i + SAMPLE_SIZE]
        p, v, a, j = ((xyz[k], xyz[k + 1], xyz[k + 2]) for k in (0, 3, 6, 9))
        samples.append(Reference(time_s, p, v, a, j, yaw, yaw_rate))
    shift = FrameShift(
        head["shift_count"],
        head["shift_time_s"],
        head["shift_position_ned_m"],
        head["shift_velocity_ned_m_s"],
        head["shift_yaw_rad"],
        head.get("shift_origin_ned_m", ZERO3),  # older records have none
    )
    return ReferenceWindow(head["goal_id"] if head["has_goal_id"] else None, tuple(samples), shift)


def _binary(context: Context, topic: str, layout: Layout, more: str = "") -> Channel:
    schema = Schema(name=layout.name, encoding="ros2msg", data=(layout.definition + more).encode())
    return Channel(topic, message_encoding="cdr", schema=schema, context=context)


def _json(context: Context, topic: str, title: str, **properties: str) -> Channel:
    types = {name: {"type": kind.split("|")} if "|" in kind else {"type": kind} for name, kind in properties.items()}
    return Channel(topic, schema={"title": title, "type": "object", "properties": types}, context=context)


class Topics:
    """Writes to the sinks of a context. ``wall_s`` is wall time minus the loop's clock; viewers want wall time."""

    def __init__(self, context: Context, wall_s: float, path_poses: int) -> None:
        self.wall_s = wall_s
        self._context = context
        self._odometry = _binary(context, "/flightd/odometry", ODOMETRY)
        self._imu = _binary(context, "/flightd/imu", IMU)
        self._tick = _binary(context, "/flightd/tick", TICK)
        self._window = _binary(context, "/flightd/window", WINDOW, _SAMPLES)
        self._start = _json(context, "/flightd/start", "flightd.Start", state="object", inputs="object")
        self._status = _json(context, "/flightd/status", "flightd.AutopilotStatus", mode="string", armed="boolean")
        self._parameters = _json(context, "/flightd/parameters", "flightd.Parameters", control="object")
        self._rest = _json(context, "/flightd/inputs", "flightd.Inputs", latched="boolean", request="object|null")
        self._event = _json(
            context, "/flightd/event", "flightd.Event", code="string", text="string", goal_id="string|null"
        )
        self._goal = _json(context, "/flightd/goal", "flightd.Goal", what="string", goal_id="string|null")
        self._plan = _json(context, "/flightd/plan", "flightd.Plan", spacing_s="number", positions_ned_m="array")
        self._about = _json(context, "/flightd/about", "flightd.About", version="string", config_hash="string")
        self._scene = Scene(context, path_poses)
        self._last: Inputs | None = None
        self._count = 0

    def stamp_ns(self, time_s: float) -> int:
        """Wall time in nanoseconds of a time of the loop's clock."""
        return max(0, round((time_s + self.wall_s) * 1e9))

    def about(self, time_s: float, facts: Mapping[str, Any]) -> None:
        """What was flying: version, configuration and its hash, flight id."""
        self._about.log(dict(facts), log_time=self.stamp_ns(time_s))

    def begin(self, step: Step) -> bool:
        """Write the memory after a step: a replay begins with the next one. False while it cannot be written."""
        try:
            text = codec.text(Start(step.state, step.inputs))
        except codec.NotEncodableError:
            return False
        self._start.log(text.encode(), log_time=self.stamp_ns(step.record.now_s))
        self._last = step.inputs
        return True

    def tick(self, step: Step) -> None:
        """Write what is new in the inputs, and the record."""
        ns = self.stamp_ns(step.record.now_s)
        self._inputs(step.inputs, ns)
        if self._tick.has_sinks():  # a live view may look elsewhere
            self._tick.log(TICK.pack(step.record), log_time=ns)
        self._count += 1
        if self._count % _SCENE_EVERY == 0:
            self._scene.show(step.record, ns)

    def event(self, payload: Mapping[str, Any]) -> None:
        """An event: ``time_s``, ``code``, ``text``, ``goal_id``."""
        ns = self.stamp_ns(payload["time_s"])
        self._event.log(dict(payload), log_time=ns)
        self._scene.tell(str(payload["code"]), str(payload["text"]), ns)

    def note(self, note: Note) -> None:
        """An event, a goal or a plan, by its kind."""
        if note.kind == "goal":
            self._goal.log(dict(note.payload), log_time=self.stamp_ns(note.time_s))
        elif note.kind == "plan":
            self._planned(note.payload)
        else:
            self.event(note.payload)

    def _planned(self, payload: Mapping[str, Any]) -> None:
        ns = self.stamp_ns(payload["time_s"])
        self._plan.log(dict(payload), log_time=ns)
        self._scene.plan([tuple(p) for p in payload["positions_ned_m"]], ns)

    def _inputs(self, inputs: Inputs, ns: int) -> None:
        """The inputs that are not those of the tick before."""
        last, self._last = self._last, inputs
        if inputs.odometry is not None and (last is None or inputs.odometry is not last.odometry):
            self._odometry.log(ODOMETRY.pack(inputs.odometry), log_time=ns)
        if inputs.imu is not None and (last is None or inputs.imu is not last.imu):
            self._imu.log(IMU.pack(inputs.imu), log_time=ns)
        if inputs.window is not (None if last is None else last.window):
            self._window.log(pack_window(inputs.window or _WITHDRAWN), log_time=ns)
        if last is None or (inputs.status is not last.status and inputs.status != last.status):
            self._status.log(codec.text(inputs.status).encode(), log_time=ns)
            self._scene.locate(inputs.status.global_position, ns)
        if last is None or (inputs.parameters is not last.parameters and inputs.parameters != last.parameters):
            self._parameters.log(codec.text(inputs.parameters).encode(), log_time=ns)
        if last is None or _rest(inputs) != _rest(last):
            self._rest.log(dict(zip(REST, map(codec.encode, _rest(inputs)), strict=True)), log_time=ns)
