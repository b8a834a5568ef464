"""The table of methods: parameters, result, who may call; and the table of notifications."""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from daemon.goals import results
from daemon.goals.schema import (
    Limits,
    NotNegative,
    Number,
    Params,
    Path,
    Positive,
    Quaternion,
    Stream,
    Text,
    Trajectory,
    Vector3,
    Waypoint,
    check_unit,
    missing,
    refuse,
)

PROTOCOL_VERSION = 1
MIN_RATE_HZ = 1.0
MAX_RATE_HZ = 50.0
GOAL_KINDS = ("waypoint", "path", "trajectory", "stream")

Topic = Literal["state", "reference", "setpoint", "goal", "plan", "health", "loops", "events"]


class NoParams(Params):
    """No parameters."""


class Takeoff(Params):
    """Take off to ``altitude_m`` above the take-off point."""

    altitude_m: Positive


class GoalSubmit(Params):
    """A goal: exactly one of waypoint, path, trajectory and stream; ``timeout_s`` counts from acceptance."""

    waypoint: Waypoint | None = None
    path: Path | None = None
    trajectory: Trajectory | None = None
    stream: Stream | None = None
    limits: Limits | None = None
    timeout_s: Positive | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        given = [kind for kind in GOAL_KINDS if getattr(self, kind) is not None]
        if not given:
            raise missing("waypoint", "is missing: give one of waypoint, path, trajectory and stream")
        if len(given) > 1:
            raise missing(given[1], f"give either {given[0]} or {given[1]}, not both")
        return self

    @property
    def goal(self) -> Waypoint | Path | Trajectory | Stream:
        """The goal that was given."""
        goal = self.waypoint or self.path or self.trajectory or self.stream
        assert goal is not None
        return goal


class GoalUpdate(Params):
    """Move the reference of the active goal without ending it."""

    goal_id: Text
    waypoint: Waypoint


class GoalCancel(Params):
    """Cancel a goal; without ``goal_id`` the active one."""

    goal_id: Text | None = None


class GoalGet(Params):
    """Ask how a goal is or how it ended."""

    goal_id: Text


class Subscribe(Params):
    """Topics to get from now on, each at most ``rate_hz`` times a second."""

    topics: Annotated[list[Topic], Field(min_length=1, max_length=32)]
    rate_hz: Number = 10.0

    @model_validator(mode="after")
    def _rate(self) -> Self:
        if not MIN_RATE_HZ <= self.rate_hz <= MAX_RATE_HZ:
            raise refuse("rate_hz", f"{self.rate_hz:g} is not within {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz")
        return self


class Unsubscribe(Params):
    """Topics to get no longer; without ``topics`` all of them."""

    topics: Annotated[list[Topic], Field(min_length=1, max_length=32)] | None = None


class ConfigGet(Params):
    """Read the setting at a dotted path."""

    path: Text


def _kind_of_value(value: object) -> str | None:
    kinds = {bool: "switch", int: "number", float: "number", str: "text", list: "list"}
    return kinds.get(type(value))


Value = Annotated[
    Annotated[bool, Tag("switch")]
    | Annotated[Number, Tag("number")]
    | Annotated[Text, Tag("text")]
    | Annotated[list[Number], Field(max_length=64), Tag("list")],
    Discriminator(
        _kind_of_value,
        custom_error_type="shape",
        custom_error_message="wrong type",
        custom_error_context={"field": "", "reason": "must be a number, true or false, a string or a list of numbers"},
    ),
]


class ConfigSet(Params):
    """Change the setting at a dotted path, in flight, until the daemon restarts."""

    path: Text
    value: Value


class ReferenceSet(Params):
    """One reference of a stream goal, local NED; ``stamp_s`` is CLOCK_MONOTONIC, else the time of arrival counts."""

    goal_id: Text
    position: Vector3
    velocity: Vector3
    acceleration: Vector3 | None = None
    jerk: Vector3 | None = None
    yaw_deg: Number | None = None
    yaw_rate_deg_s: Number | None = None
    stamp_s: Number | None = None


class EstimatorPose(Params):
    """A pose from outside, local NED; ``covariance`` is the diagonal: x, y, z in m2, roll, pitch, yaw in rad2."""

    position: Vector3
    orientation: Quaternion
    covariance: Annotated[list[NotNegative], Field(min_length=6, max_length=6)] | None = None
    stamp_s: Number | None = None

    @model_validator(mode="after")
    def _unit(self) -> Self:
        check_unit(self.orientation)
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One method: ``operator`` only operators may call it; ``notification`` it comes without an id and has no reply."""

    name: str
    params: type[Params]
    result: type | None
    summary: str
    operator: bool = True
    notification: bool = False


def _vehicle(name: str, summary: str, params: type[Params] = NoParams) -> Method:
    return Method(name=f"vehicle.{name}", params=params, result=results.VehicleDone, summary=summary)


def _read(name: str, summary: str, params: type[Params], result: type) -> Method:
    return Method(name=name, params=params, result=result, summary=summary, operator=False)


def _act(name: str, summary: str, params: type[Params], result: type) -> Method:
    return Method(name=name, params=params, result=result, summary=summary)


def _notification(name: str, summary: str, params: type[Params]) -> Method:
    return Method(name=name, params=params, result=None, summary=summary, notification=True)


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        _read("system.info", "What this daemon is and what it answers.", NoParams, results.SystemInfo),
        _read("status.get", "How the vehicle, the goal and the loops are.", NoParams, results.Status),
        _vehicle("arm", "Arm; done when telemetry shows it."),
        _vehicle("disarm", "Disarm; refused unless landed."),
        _vehicle("takeoff", "Arm if needed and climb; done when in the air and in Hold.", Takeoff),
        _vehicle("engage", "Take the vehicle from Hold under the daemon's control."),
        _vehicle("hold", "Release the vehicle to the autopilot's Hold."),
        _vehicle("land", "Land here; done when disarmed."),
        _vehicle("return", "Return to launch; done when disarmed."),
        _act("goal.submit", "Submit a goal; it preempts the one being flown.", GoalSubmit, results.GoalAccepted),
        _act("goal.update", "Move the reference of the active goal.", GoalUpdate, results.GoalRef),
        _act("goal.cancel", "Cancel a goal; the vehicle brakes and holds.", GoalCancel, results.GoalRef),
        _read("goal.get", "How a goal is or how it ended; the last 100 are kept.", GoalGet, results.GoalRecord),
        _read("telemetry.subscribe", "Get telemetry on this connection.", Subscribe, results.Subscription),
        _read("telemetry.unsubscribe", "Get less telemetry.", Unsubscribe, results.Subscription),
        _read("config.get", "Read a setting.", ConfigGet, results.Setting),
        _act("config.set", "Change a setting until the restart.", ConfigSet, results.Setting),
        _notification("reference.set", "The next reference of a stream goal.", ReferenceSet),
        _notification("estimator.pose", "A pose from outside for the estimator.", EstimatorPose),
    )
}

NOTIFICATIONS: dict[str, type] = {
    "goal.feedback": results.GoalFeedback,
    "goal.result": results.GoalRecord,
    "telemetry.state": results.StateTelemetry,
    "telemetry.reference": results.ReferenceTelemetry,
    "telemetry.setpoint": results.SetpointTelemetry,
    "telemetry.plan": results.PlanTelemetry,
    "telemetry.health": results.HealthTelemetry,
    "telemetry.loops": results.LoopReports,
    "telemetry.events": results.EventTelemetry,
}
