"""The settings: sections of typed values, each with its range and unit. Degrees here (``*_deg``), SI elsewhere."""

import hashlib
import json
import re
from math import atan2, degrees, hypot
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from daemon import demands, stability
from daemon.messages import GRAVITY_M_S2
from daemon.safety.geofence import polygon_fault


def _number(low: float, high: float, unit: str | None, settable: bool = False) -> Any:
    return Field(ge=low, le=high, json_schema_extra={"unit": unit, "settable": settable})


# What MAVSDK takes; others it refuses each time anew, at run time.
_CONNECTION = re.compile(r"(udp|tcp)://\S*:\d+|(udp|tcp)(in|out)://\S+:\d+|serial(_flowcontrol)?:///\S+:\d+")
_SPEED_MARGIN = 1.2  # of the supervisor's bound over the limits of motion: gusts and the way back to the reference
_TILT_MARGIN_DEG = 10.0  # of the supervisor's bound over the law's: a late vehicle in a gust
DEFAULT_HOVER_THRUST = 0.5  # until the autopilot tells its own


class Section(BaseModel):
    """Base of all sections: unknown keys are refused, nothing is converted, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _each_in_range(cls, value: Any, info: ValidationInfo) -> Any:
        extra = cls.model_fields[info.field_name or ""].json_schema_extra
        if isinstance(value, tuple) and isinstance(extra, dict) and "low" in extra:
            low, high = float(str(extra["low"])), float(str(extra["high"]))
            for number in value:
                if not low <= number <= high:
                    raise ValueError(f"{number:g} is not within {low:g} to {high:g} {extra['unit']}")
        return value


Pair = Annotated[tuple[float, float], Field(strict=False)]


Triple = Annotated[tuple[float, float, float], Field(strict=False)]


def _each(low: float, high: float, unit: str, settable: bool = False) -> Any:
    """Several numbers, each within the range."""
    return Field(json_schema_extra={"unit": unit, "settable": settable, "low": low, "high": high})


class Link(Section):
    """The link to the autopilot."""

    connection: str = "udpin://0.0.0.0:14540"
    lost_s: float = _number(1.4, 5.0, "s")
    round_trip_max_s: float = _number(0.02, 1.0, "s")

    @field_validator("connection")
    @classmethod
    def _is_url(cls, value: str) -> str:
        if not _CONNECTION.fullmatch(value):
            examples = "udpin://0.0.0.0:14540, tcpout://10.0.0.1:5760 or serial:///dev/ttyAMA0:921600"
            raise ValueError(f"{value!r} is no connection such as {examples}")
        port = int(value.rpartition(":")[2])
        if not value.startswith("serial") and not 1 <= port <= 65535:
            raise ValueError(f"{value!r}: port {port} is not within 1 to 65535")
        return value


class Loops(Section):
    """The two tasks."""

    control_rate_hz: float = _number(50.0, 250.0, "Hz")
    trajectory_rate_hz: float = _number(5.0, 50.0, "Hz")
    window_s: float = _number(0.6, 5.0, "s")
    command_latency_s: float = _number(0.0, 0.2, "s")
    cpu_affinity: Annotated[tuple[int, ...], Field(strict=False)] = ()
    realtime_priority: int = Field(ge=0, le=99)
    lock_memory: bool


class Limits(Section):
    """Limits of the reference."""

    speed_m_s: float = _number(0.1, 25.0, "m/s", settable=True)
    climb_m_s: float = _number(0.1, 10.0, "m/s", settable=True)
    descent_m_s: float = _number(0.1, 10.0, "m/s", settable=True)
    acceleration_m_s2: float = _number(0.1, 20.0, "m/s2", settable=True)
    vertical_acceleration_m_s2: float = _number(0.1, 10.0, "m/s2", settable=True)
    jerk_m_s3: float = _number(0.5, 200.0, "m/s3", settable=True)
    yaw_rate_deg_s: float = _number(1.0, 360.0, "deg/s", settable=True)
    yaw_acceleration_deg_s2: float = _number(1.0, 1000.0, "deg/s2", settable=True)


class Guidance(Section):
    """How goals become references."""

    profile: Literal["reference_filter", "jerk_limited"] = Field(json_schema_extra={"settable": True})
    natural_frequency_rad_s: float = _number(0.1, 5.0, "rad/s", settable=True)
    damping: float = _number(0.3, 2.0, None, settable=True)
    max_distance_m: float = _number(1.0, 100000.0, "m", settable=True)
    deviation_max_m: float = _number(0.5, 1000.0, "m", settable=True)
    limits: Limits


class Control(Section):
    """The control law."""

    attitude_law: Literal["quaternion", "geometric", "jerk"] = Field(json_schema_extra={"settable": True})
    position_gain_1_s2: Triple = _each(0.0, 50.0, "1/s2", settable=True)
    velocity_gain_1_s: Triple = _each(0.5, 30.0, "1/s", settable=True)
    feedback_max_m_s2: float = _number(0.5, 30.0, "m/s2", settable=True)
    approach_max_m_s: float = _number(0.1, 30.0, "m/s", settable=True)
    attitude_time_constant_s: Triple = _each(0.04, 5.0, "s", settable=True)
    hover_thrust: float | None = _number(0.05, 0.95, None)
    thrust_curve: float = _number(0.0, 1.0, None)
    thrust_lag_s: float = _number(0.0, 0.5, "s")
    rate_lag_s: Triple = _each(0.0, 2.0, "s")
    drag_1_s: Triple = _each(0.0, 5.0, "1/s", settable=True)
    drag_max_1_s: float = _number(0.0, 5.0, "1/s", settable=True)
    rate_feed_forward: bool
    lag_compensation: bool
    disturbance_bandwidth_rad_s: float = _number(0.0, 20.0, "rad/s", settable=True)
    disturbance_max_m_s2: float = _number(0.0, 15.0, "m/s2", settable=True)
    velocity_bias_bandwidth_rad_s: float = _number(0.0, 20.0, "rad/s", settable=True)
    velocity_bias_max_m_s: float = _number(0.0, 5.0, "m/s", settable=True)
    velocity_yaw: bool
    tilt_max_deg: float = _number(5.0, 80.0, "deg", settable=True)
    rate_max_deg_s: float = _number(20.0, 720.0, "deg/s", settable=True)
    yaw_rate_max_deg_s: float = _number(5.0, 360.0, "deg/s", settable=True)
    rate_slew_max_deg_s2: float = _number(1200.0, 50000.0, "deg/s2", settable=True)
    thrust_min: float = _number(0.0, 0.5, None, settable=True)
    thrust_max: float = _number(0.3, 1.0, None, settable=True)
    thrust_slew_max_1_s: float = _number(0.5, 100.0, "1/s", settable=True)

    @property
    def hover_thrust_at_start(self) -> float:
        """The configured one, or what is flown until the autopilot tells its own."""
        return DEFAULT_HOVER_THRUST if self.hover_thrust is None else self.hover_thrust

    @model_validator(mode="after")
    def _hovers(self) -> "Control":
        """`control.thrust_min` and `thrust_max` leave a tenth of `hover_thrust` below and above it."""
        demands.require(demands.hover(self, self.hover_thrust_at_start))
        return self

    @model_validator(mode="after")
    def _stable(self) -> "Control":
        """`control.attitude_time_constant_s` needs a phase margin of 35 deg with `rate_lag_s`; `position_gain_1_s2` and
        `velocity_gain_1_s` must not swing with both and `thrust_lag_s` ([why](control.md#limits-limitspy)).
        """
        stability.require_stable(self)
        return self


class Estimator(Section):
    """The estimate and its quality."""

    kind: Literal["autopilot", "ekf", "ukf"]
    external_pose: Literal["off", "fused", "alone"]
    position_variance_max_m2: float = _number(0.01, 100.0, "m2", settable=True)
    reset_max_m: float = _number(0.5, 1000.0, "m", settable=True)
    telemetry_latency_s: float = _number(0.0, 0.2, "s")

    @model_validator(mode="after")
    def _consistent(self) -> "Estimator":
        """`estimator.external_pose` other than off needs `kind` ekf or ukf."""
        if self.external_pose != "off" and self.kind == "autopilot":
            raise ValueError(f"external_pose {self.external_pose!r} needs kind ekf or ukf")
        return self


class Fence(Section):
    """The geofence about its anchor: home, or the local origin."""

    anchor: Literal["home", "origin"]
    radius_m: float = _number(1.0, 100000.0, "m")
    polygon_ne_m: Annotated[tuple[Pair, ...], Field(strict=False)] = ()
    floor_m: float = _number(-1000.0, 1000.0, "m")
    ceiling_m: float = _number(1.0, 10000.0, "m")
    hard_margin_m: float = _number(0.5, 1000.0, "m")
    beyond: Literal["hold", "land", "return"]

    @model_validator(mode="after")
    def _consistent(self) -> "Fence":
        """`safety.fence.floor_m` is below `ceiling_m`, and `polygon_ne_m` is empty or has three corners or more."""
        if self.floor_m >= self.ceiling_m:
            raise ValueError(f"floor_m {self.floor_m:g} is not below ceiling_m {self.ceiling_m:g}")
        if 0 < len(self.polygon_ne_m) < 3:
            raise ValueError("polygon_ne_m needs three corners or more")
        fault = polygon_fault(self.polygon_ne_m) if self.polygon_ne_m else None
        if fault is not None:
            raise ValueError(f"polygon_ne_m {fault}")
        return self


class Safety(Section):
    """Bounds of the supervisor and of the dead-man."""

    coast_s: float = _number(0.05, 0.5, "s")
    lost_s: float = _number(0.1, 1.0, "s")
    tilt_max_deg: float = _number(20.0, 120.0, "deg")
    speed_max_m_s: float = _number(1.0, 60.0, "m/s")
    attitude_disagreement_deg: float = _number(2.0, 90.0, "deg")
    battery_min_pct: float = _number(0.0, 90.0, "%")
    dead_man_level_s: float = _number(0.05, 0.5, "s")
    dead_man_latch_s: float = _number(0.1, 1.0, "s")
    clock_gap_s: float = _number(0.1, 1.0, "s")
    fence: Fence

    @model_validator(mode="after")
    def _ordered(self) -> "Safety":
        """`safety.coast_s` is below `lost_s`, `dead_man_level_s` below `dead_man_latch_s`."""
        if self.coast_s >= self.lost_s:
            raise ValueError(f"coast_s {self.coast_s:g} is not below lost_s {self.lost_s:g}")
        if self.dead_man_level_s >= self.dead_man_latch_s:
            raise ValueError("dead_man_level_s is not below dead_man_latch_s")
        return self


class Goals(Section):
    """The goal socket."""

    engage_on_submit: bool
    operator_uids: Annotated[tuple[int, ...], Field(strict=False)] = ()
    operator_gids: Annotated[tuple[int, ...], Field(strict=False)] = ()


class Recording(Section):
    """The flight record."""

    enabled: bool
    directory: str
    when: Literal["armed", "always"]
    before_s: float = _number(0.0, 60.0, "s")
    after_s: float = _number(0.0, 60.0, "s")
    max_file_mb: float = _number(1.0, 4096.0, "MB")
    keep_mb: float = _number(10.0, 1000000.0, "MB")
    path_poses: int = Field(ge=1, le=10000, json_schema_extra={"unit": "poses"})
    live: bool
    live_port: int = Field(ge=1, le=65535)

    @model_validator(mode="after")
    def _consistent(self) -> "Recording":
        """`recording.max_file_mb` is below `keep_mb`."""
        if self.max_file_mb >= self.keep_mb:
            raise ValueError(f"max_file_mb {self.max_file_mb:g} is not below keep_mb {self.keep_mb:g}")
        return self


class Log(Section):
    """Logs."""

    level: Literal["debug", "info", "warning", "error"]


class Config(Section):
    """The whole configuration."""

    link: Link
    loops: Loops
    guidance: Guidance
    control: Control
    estimator: Estimator
    safety: Safety
    goals: Goals
    recording: Recording
    log: Log

    @model_validator(mode="after")
    def _can_accelerate(self) -> "Config":
        """`guidance.limits.acceleration_m_s2` and `vertical_acceleration_m_s2`, both at once, need no more tilt than
        `control.tilt_max_deg` and a thrust between `control.thrust_min` and `thrust_max`, with a tenth to spare.
        """
        limits, tilt_deg = self.guidance.limits, self.control.tilt_max_deg
        demands.require(demands.motion(self.control, limits, self.control.hover_thrust_at_start))
        needed_deg = degrees(atan2(limits.acceleration_m_s2, GRAVITY_M_S2 - limits.vertical_acceleration_m_s2))
        if needed_deg > tilt_deg:
            raise ValueError(
                f"guidance.limits.acceleration_m_s2 {limits.acceleration_m_s2:g} with vertical_acceleration_m_s2 "
                f"{limits.vertical_acceleration_m_s2:g} down needs {needed_deg:.1f} deg of tilt: "
                f"control.tilt_max_deg is {tilt_deg:g}"
            )
        return self

    @model_validator(mode="after")
    def _within_safety(self) -> "Config":
        """`safety.speed_max_m_s` is a fifth above what `guidance.limits` allow, sideways and vertically together, and
        `safety.tilt_max_deg` 10 deg above `control.tilt_max_deg`.
        """
        limits, safety = self.guidance.limits, self.safety
        speed_m_s = hypot(limits.speed_m_s, max(limits.climb_m_s, limits.descent_m_s))
        if _SPEED_MARGIN * speed_m_s > safety.speed_max_m_s:
            raise ValueError(
                f"guidance.limits.speed_m_s {limits.speed_m_s:g} with climb_m_s or descent_m_s is {speed_m_s:.1f} m/s, "
                f"and a fifth more with a gust: safety.speed_max_m_s is {safety.speed_max_m_s:g}"
            )
        if self.control.tilt_max_deg + _TILT_MARGIN_DEG > safety.tilt_max_deg:
            raise ValueError(
                f"control.tilt_max_deg {self.control.tilt_max_deg:g} is less than {_TILT_MARGIN_DEG:g} deg below "
                f"safety.tilt_max_deg {safety.tilt_max_deg:g}"
            )
        return self

    def hash(self) -> str:
        """Twelve hexadecimal digits that change with any value."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]
