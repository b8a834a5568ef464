"""From the configuration's numbers to the parameters of the flow: degrees to radians, names to types."""

from dataclasses import replace
from math import radians
from typing import Any

from daemon.control.parameters import AttitudeLaw, ControlParameters
from daemon.estimation import ekf, ukf
from daemon.estimation.clock import ClockParameters
from daemon.estimation.estimator import EstimatorParameters
from daemon.estimation.fusion import FusionParameters, flight_filter
from daemon.estimation.predictor import PredictorParameters
from daemon.estimation.reset_tracker import ResetParameters
from daemon.guidance.limits import MotionLimits
from daemon.guidance.parameters import GuidanceParameters, Profile
from daemon.messages import FlightMode, Vec3
from daemon.pipeline import Parameters
from daemon.safety.conditions import Bounds
from daemon.safety.dead_man import DeadManTiming
from daemon.safety.geofence import Geofence
from daemon.safety.supervision import Timing
from daemon.settings import DEFAULT_HOVER_THRUST, Config


def pipeline_parameters(config: Config, fence: Geofence, hover_thrust: float | None = None) -> Parameters:
    """Parameters of ``pipeline.step``; ``hover_thrust`` is what the autopilot flies with, where none is configured."""
    return Parameters(
        estimator=EstimatorParameters(
            clock=ClockParameters(telemetry_latency_s=config.estimator.telemetry_latency_s),
            reset=ResetParameters(
                reset_max_m=config.estimator.reset_max_m,
                variance_trusted_m2=config.estimator.position_variance_max_m2,
            ),
            fusion=fusion_parameters(config),
        ),
        predictor=PredictorParameters(),
        control=control_parameters(config, hover_thrust),
        limits=motion_limits(config),
        bounds=Bounds(
            coast_s=config.safety.coast_s,
            lost_s=config.safety.lost_s,
            position_variance_m2=config.estimator.position_variance_max_m2,
            attitude_disagreement_rad=radians(config.safety.attitude_disagreement_deg),
            tilt_rad=radians(config.safety.tilt_max_deg),
            speed_m_s=config.safety.speed_max_m_s,
            deviation_m=config.guidance.deviation_max_m,
            round_trip_s=config.link.round_trip_max_s,
            battery_fraction=config.safety.battery_min_pct / 100.0,
            fence=fence,
            fence_beyond=FlightMode(config.safety.fence.beyond),
        ),
        timing=Timing(),
        command_latency_s=config.loops.command_latency_s,
    )


def fusion_parameters(config: Config) -> FusionParameters | None:
    """The filter of our own, or None where the autopilot's estimate is flown as it is."""
    if config.estimator.kind == "autopilot":
        return None
    fused = FusionParameters(filter=flight_filter(ekf.predict if config.estimator.kind == "ekf" else ukf.Unscented()))
    if config.estimator.external_pose == "alone":
        return replace(fused, odometry_axes=(False,) * 3 + (True,) * 9)
    return fused


def control_parameters(config: Config, hover_thrust: float | None) -> ControlParameters:
    """Parameters of the control law: keys of the same name as they are, degrees converted."""
    values: dict[str, Any] = config.control.model_dump(exclude={"velocity_yaw"})  # which is guidance's
    for name in ("tilt_max", "rate_max", "yaw_rate_max", "rate_slew_max"):
        unit = "_rad_s2" if name == "rate_slew_max" else "_rad" if name == "tilt_max" else "_rad_s"
        degrees_key = name + unit.replace("rad", "deg")
        values[name + unit] = radians(values.pop(degrees_key))
    values["attitude_law"] = AttitudeLaw(values["attitude_law"])
    if values["hover_thrust"] is None:
        values["hover_thrust"] = DEFAULT_HOVER_THRUST if hover_thrust is None else hover_thrust
    return ControlParameters(**values)


def motion_limits(config: Config) -> MotionLimits:
    """Limits of the reference."""
    values: dict[str, float] = config.guidance.limits.model_dump()
    values["yaw_rate_rad_s"] = radians(values.pop("yaw_rate_deg_s"))
    values["yaw_acceleration_rad_s2"] = radians(values.pop("yaw_acceleration_deg_s2"))
    return MotionLimits(**values)


def geofence(config: Config, anchor_ned_m: Vec3) -> Geofence:
    """The fence about where its anchor is now."""
    fence = config.safety.fence
    return Geofence(
        anchor_ned_m=anchor_ned_m,
        radius_m=fence.radius_m,
        polygon_ne_m=fence.polygon_ne_m,
        floor_m=fence.floor_m,
        ceiling_m=fence.ceiling_m,
        hard_margin_m=fence.hard_margin_m,
    )


def dead_man_timing(config: Config) -> DeadManTiming:
    """Timing of the dead-man."""
    return DeadManTiming(
        level_after_s=config.safety.dead_man_level_s,
        latch_after_s=config.safety.dead_man_latch_s,
        clock_gap_s=config.safety.clock_gap_s,
    )


def guidance_parameters(config: Config) -> GuidanceParameters:
    """How references are made."""
    return GuidanceParameters(
        profile=Profile(config.guidance.profile),
        omega_rad_s=config.guidance.natural_frequency_rad_s,
        zeta=config.guidance.damping,
        omega_yaw_rad_s=config.guidance.natural_frequency_rad_s,
        deviation_max_m=config.guidance.deviation_max_m,
        velocity_yaw=config.control.velocity_yaw,
    )
