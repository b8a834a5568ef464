"""Rigid-body physics of a multirotor: state in, state out.

Rotor thrust and air drag act on a rigid body above flat ground. World: local NED about the place where the vehicle
started, body: FRD. One step is the explicit midpoint method for velocity and body rates (second order), the exact
exponential for the attitude and for the motors' first-order lag.
"""

from dataclasses import dataclass
from math import exp, isfinite

from daemon.frames import integrate, rotate_inverse, subtract
from daemon.messages import IDENTITY, ZERO3, Quat, Vec3
from daemon.sim.airframe import Airframe

SIM_GRAVITY_M_S2 = 9.81  # PX4's SIH has it by latitude, 9.807 at its home (``Sih::computeGravity``)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleState:
    """Truth. ``signals``: rotor speeds, 0 to 1. ``specific_force_frd_m_s2`` is what an accelerometer reads."""

    position_ned_m: Vec3 = ZERO3
    velocity_ned_m_s: Vec3 = ZERO3
    attitude_wb: Quat = IDENTITY
    rates_frd_rad_s: Vec3 = ZERO3
    signals: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    specific_force_frd_m_s2: Vec3 = (0.0, 0.0, -SIM_GRAVITY_M_S2)
    on_ground: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What acts on the vehicle besides its commands; ``rotor_efficiency`` scales each rotor's thrust."""

    wind_ned_m_s: Vec3 = ZERO3
    payload_kg: float = 0.0
    rotor_efficiency: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    ground_down_m: float = 0.0
    has_ground: bool = True


def step(
    state: VehicleState, commands: tuple[float, ...], airframe: Airframe, surroundings: Surroundings, dt_s: float
) -> VehicleState:
    """The vehicle ``dt_s`` later under constant rotor commands (0 to 1; clipped, NaN counts as 0)."""
    constant_s = airframe.motor_time_constant_s
    half_rest = exp(-0.5 * dt_s / constant_s) if constant_s > 0.0 else 0.0
    targets = [c if 0.0 <= c <= 1.0 else _clipped(c) for c in commands]
    middle = [t + (s - t) * half_rest for s, t in zip(state.signals, targets, strict=True)]
    signals = tuple([t + (m - t) * half_rest for m, t in zip(middle, targets, strict=True)])
    thrust_n, torque_nm, speed_sum = _rotor_wrench(middle, airframe, surroundings)
    if airframe.rotor_drag_n_s_m != ZERO3:
        torque_nm = _add_scaled(torque_nm, _hub_drag_torque(state, middle, airframe, surroundings), 1.0)
    rates_middle, rates = _turn(state.rates_frd_rad_s, torque_nm, airframe, dt_s)
    attitude_middle = _turned_a_little(state.attitude_wb, state.rates_frd_rad_s, 0.5 * dt_s)

    velocity = state.velocity_ned_m_s
    h = 0.5 * dt_s
    ax, ay, az, _ = _acceleration(velocity, state.attitude_wb, thrust_n, speed_sum, airframe, surroundings)
    velocity_middle = (velocity[0] + ax * h, velocity[1] + ay * h, velocity[2] + az * h)
    ax, ay, az, force = _acceleration(velocity_middle, attitude_middle, thrust_n, speed_sum, airframe, surroundings)
    new_velocity = (velocity[0] + ax * dt_s, velocity[1] + ay * dt_s, velocity[2] + az * dt_s)
    position = state.position_ned_m
    if surroundings.has_ground and position[2] >= surroundings.ground_down_m and new_velocity[2] >= 0.0:
        return _resting(state, signals, surroundings)
    return VehicleState(
        (
            position[0] + velocity_middle[0] * dt_s,
            position[1] + velocity_middle[1] * dt_s,
            position[2] + velocity_middle[2] * dt_s,
        ),
        new_velocity,
        integrate(state.attitude_wb, rates_middle, dt_s),
        rates,
        signals,
        force,
        False,
    )


def _clipped(command: float) -> float:
    return min(max(command, 0.0), 1.0) if isfinite(command) else 0.0


def _resting(state: VehicleState, signals: tuple[float, ...], surroundings: Surroundings) -> VehicleState:
    """On the ground nothing moves or turns (PX4's SIH stops motion only); a hard landing stays as tilted as it came."""
    w, x, y, z = state.attitude_wb
    g = SIM_GRAVITY_M_S2
    force = (-2.0 * (x * z - w * y) * g, -2.0 * (y * z + w * x) * g, -(1.0 - 2.0 * (x * x + y * y)) * g)
    position = (state.position_ned_m[0], state.position_ned_m[1], surroundings.ground_down_m)
    return VehicleState(position, ZERO3, state.attitude_wb, ZERO3, signals, force, True)


def _rotor_wrench(signals: list[float], airframe: Airframe, surroundings: Surroundings) -> tuple[float, Vec3, float]:
    """Collective thrust (N, along -z), torque (FRD, Nm), sum of the rotor speeds."""
    square = airframe.thrust_curve
    linear = 1.0 - square
    largest_n = airframe.rotor_max_thrust_n
    thrust_n = roll = pitch = yaw = 0.0
    for rotor, signal, efficiency in zip(airframe.rotors, signals, surroundings.rotor_efficiency, strict=True):
        force_n = efficiency * largest_n * signal * (linear + square * signal)
        thrust_n += force_n
        roll -= rotor.y_m * force_n
        pitch += rotor.x_m * force_n
        yaw += rotor.torque_nm_per_n * force_n
    return thrust_n, (roll, pitch, yaw), sum(signals)


def _hub_drag_torque(state: VehicleState, signals: list[float], airframe: Airframe, surroundings: Surroundings) -> Vec3:
    """Torque (FRD, Nm) of the rotors' drag, each with the air speed of its own hub."""
    ux, uy, uz = rotate_inverse(state.attitude_wb, subtract(state.velocity_ned_m_s, surroundings.wind_ned_m_s))
    p, q, r = state.rates_frd_rad_s
    hx, hy, hz = airframe.rotor_drag_n_s_m
    roll = pitch = yaw = 0.0
    for rotor, signal in zip(airframe.rotors, signals, strict=True):
        x, y = rotor.x_m, rotor.y_m
        down = -signal * hz * (uz + p * y - q * x)
        roll += y * down
        pitch -= x * down
        yaw -= signal * (x * hy * (uy + r * x) - y * hx * (ux - r * y))
    return (roll, pitch, yaw)


def _turn(rates: Vec3, torque_nm: Vec3, airframe: Airframe, dt_s: float) -> tuple[Vec3, Vec3]:
    """Body rates in the middle and at the end of the step, by Euler's equation."""
    half = _add_scaled(rates, _angular_acceleration(rates, torque_nm, airframe), 0.5 * dt_s)
    return half, _add_scaled(rates, _angular_acceleration(half, torque_nm, airframe), dt_s)


def _turned_a_little(q: Quat, rates: Vec3, dt_s: float) -> Quat:
    """Attitude after a small angle, to second order: a third of the price of the exponential."""
    w, x, y, z = q
    a, b, c = 0.5 * dt_s * rates[0], 0.5 * dt_s * rates[1], 0.5 * dt_s * rates[2]
    one = 1.0 - 0.5 * (a * a + b * b + c * c)
    return (
        one * w - x * a - y * b - z * c,
        one * x + w * a + y * c - z * b,
        one * y + w * b - x * c + z * a,
        one * z + w * c + x * b - y * a,
    )


def _angular_acceleration(rates: Vec3, torque_nm: Vec3, airframe: Airframe) -> Vec3:
    p, q, r = rates
    ix, iy, iz = airframe.inertia_kg_m2
    damping = airframe.angular_damping_nm_s
    return (
        (torque_nm[0] - damping * p + (iy - iz) * q * r) / ix,
        (torque_nm[1] - damping * q + (iz - ix) * r * p) / iy,
        (torque_nm[2] - damping * r + (ix - iy) * p * q) / iz,
    )


def _add_scaled(a: Vec3, b: Vec3, factor: float) -> Vec3:
    return (a[0] + b[0] * factor, a[1] + b[1] * factor, a[2] + b[2] * factor)


def _acceleration(
    velocity_ned_m_s: Vec3,
    attitude_wb: Quat,
    thrust_n: float,
    speed_sum: float,
    airframe: Airframe,
    surroundings: Surroundings,
) -> tuple[float, float, float, Vec3]:
    """Acceleration (NED) and specific force (FRD)."""
    wind = surroundings.wind_ned_m_s
    ux = velocity_ned_m_s[0] - wind[0]
    uy = velocity_ned_m_s[1] - wind[1]
    uz = velocity_ned_m_s[2] - wind[2]
    w, x, y, z = attitude_wb
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    r00, r01, r02 = 1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)
    r10, r11, r12 = 2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)
    r20, r21, r22 = 2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)
    dx, dy, dz = airframe.drag_n_s_m
    hx, hy, hz = airframe.rotor_drag_n_s_m
    inverse_mass = 1.0 / (airframe.mass_kg + surroundings.payload_kg)
    fx = -(dx + hx * speed_sum) * (r00 * ux + r10 * uy + r20 * uz) * inverse_mass
    fy = -(dy + hy * speed_sum) * (r01 * ux + r11 * uy + r21 * uz) * inverse_mass
    fz = (-thrust_n - (dz + hz * speed_sum) * (r02 * ux + r12 * uy + r22 * uz)) * inverse_mass
    return (
        r00 * fx + r01 * fy + r02 * fz,
        r10 * fx + r11 * fy + r12 * fz,
        r20 * fx + r21 * fy + r22 * fz + SIM_GRAVITY_M_S2,
        (fx, fy, fz),
    )
