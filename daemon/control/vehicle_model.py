"""What the vehicle does with our commands, learned in flight: disturbance, velocity bias, hover thrust."""

from dataclasses import replace
from math import exp

from daemon.control import drag, hover_thrust, lateness, observer, thrust_map
from daemon.control.drag import UNKNOWN, Drag
from daemon.control.flatness import rotor_drag
from daemon.control.lateness import IN_TIME, Lateness
from daemon.control.observer import START, Observer
from daemon.control.parameters import ControlParameters
from daemon.frames import add, clamp, down_axis, norm, normalized, rotate_about_down, scale, tilt_of
from daemon.messages import ZERO3, EstimatedState, Quat, Reset, Setpoint, Vec3
from daemon.values import value

_MEMORY_S = 0.3  # commands that acted longer ago than this are forgotten
_AT_REST_M_S = 0.5  # below it a vehicle that we take over is believed to hover
_HOVER_RANGE = (0.02, 0.98)  # hover thrust of any vehicle that flies


@value
class VehicleModel:
    """Memory of the model.

    ``commands``: (time at which it acts, thrust), oldest first. ``thrust``: the command after the lag, at the
    observers' time; None before the first. ``acceleration_ned_m_s2``: expected of the vehicle at that time.
    """

    hover_thrust: float
    commands: tuple[tuple[float, Setpoint], ...] = ()
    thrust: float | None = None
    by_velocity: Observer = START
    by_position: Observer = START
    acceleration_ned_m_s2: Vec3 = ZERO3
    drag: Drag = UNKNOWN
    lateness: Lateness = IN_TIME

    @property
    def disturbance_ned_m_s2(self) -> Vec3:
        """What accelerates the vehicle besides gravity, thrust and modelled drag."""
        return self.by_velocity.unexplained

    @property
    def velocity_bias_ned_m_s(self) -> Vec3:
        """Measured velocity minus the one with which the measured position moves."""
        return scale(self.by_position.unexplained, -1.0)


def commanded(model: VehicleModel, acts_s: float, setpoint: Setpoint) -> VehicleModel:
    """The model after a thrust command that acts at ``acts_s``."""
    commands = model.commands
    first, end = 0, len(commands)
    while first < end and commands[first][0] <= acts_s - _MEMORY_S:
        first += 1
    while first < end and commands[end - 1][0] >= acts_s:
        end -= 1
    commands = (*commands[first:end], (acts_s, setpoint))
    return VehicleModel(
        model.hover_thrust,
        commands,
        model.thrust,
        model.by_velocity,
        model.by_position,
        model.acceleration_ned_m_s2,
        model.drag,
        model.lateness,
    )


def observed(
    model: VehicleModel, estimate: EstimatedState, p: ControlParameters, reference_velocity_ned_m_s: Vec3 = ZERO3
) -> VehicleModel:
    """The model after a sound sample of the state; one that is not newer changes nothing.

    The thrust that acts is the command after the vehicle's delay and lag, limits included: nothing winds up. At the
    first sample a vehicle at rest is taken to lean against the wind, so that it is taken over as it is. The velocity of
    the reference is what the drag is learned with.
    """
    time_s, dt_s = estimate.time_s, estimate.time_s - model.by_velocity.time_s
    if not dt_s > 0.0:
        return model
    by_position = observer.update(
        model.by_position,
        time_s,
        estimate.position_ned_m,
        estimate.velocity_ned_m_s,
        bandwidth_rad_s=p.velocity_bias_bandwidth_rad_s,
        maximum=p.velocity_bias_max_m_s,
    )
    velocity_ned_m_s = add(estimate.velocity_ned_m_s, by_position.unexplained)
    attitude_wb = normalized(estimate.attitude_wb)
    acting = _acting(model, time_s)
    thrust = _lagged_thrust(model, acting, dt_s, p)
    drag_1_s = drag.total(model.drag, p.drag_1_s)
    modelled = _acceleration(thrust, model.hover_thrust, attitude_wb, velocity_ned_m_s, drag_1_s, p)
    by_velocity = observer.update(
        model.by_velocity,
        time_s,
        velocity_ned_m_s,
        modelled,
        bandwidth_rad_s=p.disturbance_bandwidth_rad_s,
        maximum=p.disturbance_max_m_s2,
    )
    if model.thrust is None and p.disturbance_bandwidth_rad_s > 0.0 and norm(velocity_ned_m_s) < _AT_REST_M_S:
        leaning = (-modelled[0], -modelled[1], 0.0)
        by_velocity = replace(by_velocity, unexplained=observer.bounded(leaning, p.disturbance_max_m_s2))
    hover = model.hover_thrust
    if dt_s <= observer.STEP_MAX_S and tilt_of(attitude_wb) < p.hover_tilt_max_rad:
        hover, by_velocity = _with_hover_learned(hover, by_velocity, dt_s, p)
    expected = add(modelled, by_velocity.unexplained)
    learned = _drag(model.drag, reference_velocity_ned_m_s, velocity_ned_m_s, by_velocity.unexplained, dt_s, p)
    late = _lateness(model.lateness, acting, estimate.rates_frd_rad_s, dt_s, p)
    return VehicleModel(hover, model.commands, thrust, by_velocity, by_position, expected, learned, late)


def shifted(model: VehicleModel, reset: Reset) -> VehicleModel:
    """The model after a jump of the estimate: NED memories of thrust turn by the heading, the others shift."""
    v, p = model.by_velocity, model.by_position
    return replace(
        model,
        by_velocity=replace(
            v,
            quantity=add(v.quantity, reset.velocity_ned_m_s),
            derivative=rotate_about_down(v.derivative, reset.yaw_rad),
            unexplained=rotate_about_down(v.unexplained, reset.yaw_rad),
        ),
        by_position=replace(
            p,
            quantity=add(p.quantity, reset.position_ned_m),
            derivative=add(p.derivative, reset.velocity_ned_m_s),
        ),
        acceleration_ned_m_s2=rotate_about_down(model.acceleration_ned_m_s2, reset.yaw_rad),
        drag=drag.shifted(model.drag, reset),
    )


def restarted(model: VehicleModel) -> VehicleModel:
    """The model after a pause: what was learned of the vehicle itself stays."""
    return VehicleModel(hover_thrust=model.hover_thrust, drag=drag.paused(model.drag))


def _acceleration(
    thrust: float, hover: float, attitude_wb: Quat, velocity: Vec3, drag_1_s: Vec3, p: ControlParameters
) -> Vec3:
    """Acceleration by thrust, modelled drag and gravity."""
    force_m_s2 = thrust_map.acceleration_from_command(thrust, hover, p.thrust_curve, p.gravity_m_s2)
    x, y, z = add(scale(down_axis(attitude_wb), -force_m_s2), rotor_drag(attitude_wb, velocity, drag_1_s))
    return (x, y, z + p.gravity_m_s2)


def _acting(model: VehicleModel, time_s: float) -> Setpoint | None:
    """The newest command that acts at a time; None before the first."""
    for acts_s, setpoint in reversed(model.commands):
        if acts_s <= time_s:
            return setpoint
    return None


def _lagged_thrust(model: VehicleModel, command: Setpoint | None, dt_s: float, p: ControlParameters) -> float:
    """The thrust command as the rotors have followed it until ``time_s``; hover thrust before the first command."""
    acting = model.hover_thrust if command is None else command.thrust
    if model.thrust is None or dt_s > observer.STEP_MAX_S or p.thrust_lag_s <= 0.0:
        return acting
    return acting + (model.thrust - acting) * exp(-dt_s / p.thrust_lag_s)


def _drag(
    known: Drag, reference_velocity: Vec3, velocity: Vec3, disturbance: Vec3, dt_s: float, p: ControlParameters
) -> Drag:
    """The drag with what this sample tells; nothing is known where nothing may be learned."""
    if p.drag_max_1_s <= 0.0:
        return UNKNOWN
    return drag.learn(
        known,
        reference_velocity,
        velocity,
        disturbance,
        min(dt_s, observer.STEP_MAX_S),
        configured_1_s=p.drag_1_s,
        maximum_1_s=p.drag_max_1_s,
    )


def _lateness(known: Lateness, acting: Setpoint | None, rates: Vec3, dt_s: float, p: ControlParameters) -> Lateness:
    """The lateness with what this sample tells; a gap tells nothing."""
    if acting is None or dt_s > observer.STEP_MAX_S:
        return known
    return lateness.learn(known, acting.rates_frd_rad_s[:2], rates[:2], dt_s, lag_s=p.rate_lag_s[0])


def _with_hover_learned(
    hover: float, by_velocity: Observer, dt_s: float, p: ControlParameters
) -> tuple[float, Observer]:
    """Move a share of the standing vertical disturbance into the hover thrust."""
    x, y, z = by_velocity.unexplained
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
    return learned, Observer(by_velocity.time_s, by_velocity.quantity, by_velocity.derivative, (x, y, left))
