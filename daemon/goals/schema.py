"""The goals that a client may submit, as they come over the socket: types and ranges, nothing that needs the vehicle.

Quaternions are ``[w, x, y, z]``, body FRD to the frame given; ``*_deg`` degrees; all else SI.
"""

from math import acos, degrees, sqrt
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Strict, Tag, model_validator
from pydantic_core import PydanticCustomError

from daemon import frames

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Vector3 = Annotated[tuple[Number, Number, Number], Strict(False)]
Quaternion = Annotated[tuple[Number, Number, Number, Number], Strict(False)]
Text = Annotated[str, Field(strict=True, min_length=1, max_length=256)]
Frame = Literal["local_ned", "local_enu", "body_frd", "global"]
WaypointMode = Literal[
    "full_pose", "only_position", "forward_heading", "only_orientation", "position_and_yaw", "xy_and_yaw"
]

MAX_TILT_DEG = 1.0
MAX_WAYPOINTS = 50
UNIT_TOLERANCE = 1e-3


class Params(BaseModel):
    """Base of all parameters: unknown keys are refused, nothing is converted, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def refuse(field: str, reason: str) -> PydanticCustomError:
    """An unacceptable value at ``field`` below the model that is being validated."""
    return PydanticCustomError("refused", "{reason}", {"field": field, "reason": reason})


def missing(field: str, reason: str = "is missing") -> PydanticCustomError:
    """A key that has to be there, at ``field`` below the model that is being validated."""
    return PydanticCustomError("shape", "{reason}", {"field": field, "reason": reason})


class Convergence(Params):
    """When a waypoint counts as reached: position, heading and speed errors kept for the dwell time."""

    position_m: Positive = 0.3
    angle_deg: Positive = 5.0
    speed_m_s: Positive = 0.3
    dwell_s: NotNegative = 0.5


class Limits(Params):
    """Limits of one goal; they may only tighten the configuration's."""

    speed_m_s: Positive | None = None
    acceleration_m_s2: Positive | None = None
    jerk_m_s3: Positive | None = None
    yaw_rate_deg_s: Positive | None = None


class Waypoint(Params):
    """A pose to go to and to hold for ``hold_s`` after it was reached.

    ``position`` is in ``frame``: metres, or latitude deg, longitude deg and altitude m above mean sea level in
    ``global``. Without ``yaw_deg`` and ``orientation`` the reference keeps its heading.
    """

    position: Vector3 | None = None
    frame: Frame = "local_ned"
    yaw_deg: Number | None = None
    orientation: Quaternion | None = None
    mode: WaypointMode = "full_pose"
    convergence: Convergence | None = None
    threshold: Positive | None = None
    hold_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.position is None and self.mode != "only_orientation":
            raise missing("position")
        if self.yaw_deg is not None and self.orientation is not None:
            raise refuse("orientation", "give either yaw_deg or orientation, not both")
        if self.convergence is not None and self.threshold is not None:
            raise refuse("threshold", "give either convergence or threshold, not both")
        _check_global(self.frame, "position", self.position)
        _check_orientation(self.frame, self.orientation)
        return self


class Path(Params):
    """Waypoints one after the other: stopping at each, or one minimum-snap path through them."""

    waypoints: Annotated[list[Waypoint], Field(min_length=1)]
    through: Literal["stop", "fly_by"] = "stop"

    @model_validator(mode="before")
    @classmethod
    def _few(cls, given: object) -> object:
        waypoints = given.get("waypoints") if isinstance(given, dict) else None
        if isinstance(waypoints, list) and len(waypoints) > MAX_WAYPOINTS:
            raise refuse("waypoints", f"{len(waypoints)} waypoints are not within 1 to {MAX_WAYPOINTS}")
        return given


UNIONS = frozenset({"trajectory", "heading"})  # in pydantic's locations a tag follows these names


class HeadingPoint(Params):
    """The heading looks at a point, in the frame of the trajectory."""

    point: Vector3


Heading = Annotated[
    Annotated[Literal["fixed", "target", "velocity"], Tag("name")] | Annotated[HeadingPoint, Tag("point")],
    Discriminator(lambda value: "point" if isinstance(value, dict | HeadingPoint) else "name"),
]


class Shape(Params):
    """What circle and lemniscate share: a centre, an axis, a speed or a period, turns, a sense, a heading."""

    center: Vector3
    frame: Frame = "local_ned"
    axis: Vector3 = (0.0, 0.0, 1.0)
    speed_m_s: Positive | None = None
    period_s: Positive | None = None
    turns: Positive = 1.0
    direction: Literal["cw", "ccw"] = "cw"
    heading: Heading = "fixed"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.speed_m_s is None and self.period_s is None:
            raise missing("speed_m_s", "is missing: give speed_m_s or period_s")
        if self.speed_m_s is not None and self.period_s is not None:
            raise refuse("period_s", "give either speed_m_s or period_s, not both")
        if frames.norm(self.axis) < UNIT_TOLERANCE:
            raise refuse("axis", "must have a length")
        _check_global(self.frame, "center", self.center)
        if isinstance(self.heading, HeadingPoint):
            _check_global(self.frame, "heading.point", self.heading.point)
        return self


class Circle(Shape):
    """A circle about ``center``; ``speed_m_s`` along it."""

    kind: Literal["circle"]
    radius_m: Positive


class Lemniscate(Shape):
    """A figure of eight: x = a sin, y = b sin 2 with ``size_m`` = [a, b]; ``speed_m_s`` is the peak."""

    kind: Literal["lemniscate"]
    size_m: Annotated[tuple[Positive, Positive], Strict(False)]


class Polynomial(Params):
    """A constant jerk (local NED) for a time, from the reference being flown."""

    kind: Literal["polynomial"]
    jerk_m_s3: Vector3
    duration_s: Positive
    heading: Heading = "fixed"


class HoldFor(Params):
    """Stay for a time."""

    kind: Literal["hold"]
    duration_s: Positive


Trajectory = Annotated[Circle | Lemniscate | Polynomial | HoldFor, Field(discriminator="kind")]


class Stream(Params):
    """The client is the planner: it sends reference.set; silence beyond ``timeout_s`` brakes and aborts."""

    timeout_s: Positive = 0.5


def _check_global(frame: str, field: str, position: tuple[float, float, float] | None) -> None:
    if frame != "global" or position is None:
        return
    for index, (name, bound) in enumerate((("latitude", 90.0), ("longitude", 180.0))):
        if abs(position[index]) > bound:
            raise refuse(f"{field}[{index}]", f"{name} {position[index]:g} deg is not within {-bound:g} to {bound:g}")


def check_unit(orientation: tuple[float, float, float, float]) -> None:
    """Raise unless it is a unit quaternion."""
    length = sqrt(sum(x * x for x in orientation)) if max(map(abs, orientation)) < 1e6 else float("inf")
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise refuse("orientation", f"must be a unit quaternion [w, x, y, z]; its length is {length:g}")


def _check_orientation(frame: str, orientation: tuple[float, float, float, float] | None) -> None:
    if orientation is None:
        return
    check_unit(orientation)
    down = frames.down_axis(frames.normalized(orientation))[2] * (-1.0 if frame == "local_enu" else 1.0)
    tilt_deg = degrees(acos(frames.clamp(down, -1.0, 1.0)))
    if tilt_deg > MAX_TILT_DEG:
        reason = f"tilts by {tilt_deg:.1f} deg (at most {MAX_TILT_DEG:g}): a hovering vehicle holds only a heading"
        raise refuse("orientation", reason)
