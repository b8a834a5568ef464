"""What the vehicle does with our commands: thrust after its delay, drag, disturbance, hover thrust."""

from dataclasses import dataclass, replace
from math import exp

from daemon.control import disturbance, hover_thrust, thrust_map
from daemon.control.disturbance import START, Observer
from daemon.control.flatness import rotor_drag
from daemon.control.parameters import ControlParameters
from daemon.frames import add, clamp, down_axis, normalized, scale, tilt_of
from daemon.messages import ZERO3, EstimatedState, Vec3

_MEMORY_S = 0.5  # commands that acted longer ago than this are forgotten
_SPAN_MAX_S = 0.1  # the lag of thrust is followed over at most this time at once
_HOVER_RANGE = (0.02, 0.98)  # hover thrust of any vehicle that flies


@dataclass(frozen=True, slots=True, eq=False)
class VehicleModel:
    """Memory of the model.

    ``commands``: (time at which it acts, thrust), oldest first. ``thrust``: the command after the lag, at the
    observer's time; None before the first. ``acceleration_ned_m_s2``: expected of the vehicle at that time.
    """

    hover_thrust: float
    commands: tuple[tuple[float, float], ...] = ()
    thrust: float | None = None
    observer: Observer = START
    acceleration_ned_m_s2: Vec3 = ZERO3


def commanded(model: VehicleModel, acts_s: float, thrust: float) -> VehicleModel:
    """The model after a thrust command that acts at ``acts_s``."""
    kept = tuple(c for c in model.commands if acts_s - _MEMORY_S < c[0] < acts_s)
    return replace(model, commands=(*kept, (acts_s, thrust)))


def observed(model: VehicleModel, estimate: EstimatedState, p: ControlParameters) -> VehicleModel:
    """The model after a sound sample of the state; one that is not newer changes nothing."""
    before = model.observer
    if estimate.time_s <= before.time_s:
        return model
    dt_s = estimate.time_s - before.time_s
    thrust = _lagged_thrust(model, estimate.time_s, dt_s, p)
    attitude_wb = normalized(estimate.attitude_wb)
    force_m_s2 = thrust_map.acceleration_from_command(thrust, model.hover_thrust, p.thrust_curve, p.gravity_m_s2)
    modelled = add(
        scale(down_axis(attitude_wb), -force_m_s2), rotor_drag(attitude_wb, estimate.velocity_ned_m_s, p.drag_1_s)
    )
    modelled = (modelled[0], modelled[1], modelled[2] + p.gravity_m_s2)
    observer = disturbance.update(
        before,
        estimate.time_s,
        estimate.velocity_ned_m_s,
        modelled,
        bandwidth_rad_s=p.disturbance_bandwidth_rad_s,
        maximum_m_s2=p.disturbance_max_m_s2,
    )
    hover = model.hover_thrust
    if dt_s <= disturbance.STEP_MAX_S and tilt_of(attitude_wb) < p.hover_tilt_max_rad:
        hover, observer = _with_hover_learned(hover, observer, dt_s, p)
    return VehicleModel(hover, model.commands, thrust, observer, add(modelled, observer.disturbance_ned_m_s2))


def _lagged_thrust(model: VehicleModel, time_s: float, dt_s: float, p: ControlParameters) -> float:
    """The thrust command as the rotors have followed it until ``time_s``; hover thrust before the first command."""
    acting = model.hover_thrust
    for acts_s, thrust in model.commands:
        if acts_s > time_s:
            break
        acting = thrust
    if model.thrust is None or dt_s > _SPAN_MAX_S or p.thrust_lag_s <= 0.0:
        return acting
    return acting + (model.thrust - acting) * exp(-dt_s / p.thrust_lag_s)


def _with_hover_learned(hover: float, observer: Observer, dt_s: float, p: ControlParameters) -> tuple[float, Observer]:
    """Move a share of the standing vertical disturbance into the hover thrust."""
    x, y, z = observer.disturbance_ned_m_s2
    force, left = hover_thrust.learn(
        thrust_map.force_of(hover, p.thrust_curve),
        z,
        dt_s,
        start=thrust_map.force_of(p.hover_thrust, p.thrust_curve),
        relative_range=p.hover_range,
        time_constant_s=p.hover_time_constant_s,
        gravity_m_s2=p.gravity_m_s2,
    )
    learned = clamp(thrust_map.command_of(force, p.thrust_curve), *_HOVER_RANGE)
    return learned, replace(observer, disturbance_ned_m_s2=(x, y, left))
