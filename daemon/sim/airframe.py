"""What a vehicle is made of: masses, rotors, drag, battery, and the gains of its rate loop."""

from dataclasses import dataclass

from daemon.messages import Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotor:
    """One rotor: place in the body (FRD), reaction torque about body z per newton of thrust (positive: clockwise)."""

    x_m: float
    y_m: float
    torque_nm_per_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RateGains:
    """PX4's rate controller (MC_*RATE_P, _I, _D; MC_YAW_TQ_CUTOFF), in the units of PX4's parameters."""

    p: Vec3
    i: Vec3
    d: Vec3
    integral_limit: float = 0.3
    yaw_torque_cutoff_hz: float = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """Cells in series, open-circuit voltage linear in the charge (PX4's simulated battery), resistance, capacity."""

    cells: int = 4
    cell_full_v: float = 4.05
    cell_empty_v: float = 3.6
    resistance_ohm: float = 0.0
    capacity_ah: float = 5.0
    hover_current_a: float = 10.0
    thrust_falls_with_voltage: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """A multirotor. Coefficients are in SI; body axes FRD.

    ``thrust_curve``: share of the square in thrust over signal (PX4's THR_MDL_FAC; 0 linear, 1 quadratic).
    ``drag_n_s_m``: linear drag of the body. ``rotor_drag_n_s_m``: drag of one rotor at full speed, linear in air
    speed and in rotor speed. ``angular_damping_nm_s``: torque against body rates.
    """

    name: str
    mass_kg: float
    inertia_kg_m2: Vec3
    rotors: tuple[Rotor, ...]
    rotor_max_thrust_n: float
    motor_time_constant_s: float
    rate_gains: RateGains
    thrust_curve: float = 0.0
    drag_n_s_m: Vec3 = (0.0, 0.0, 0.0)
    rotor_drag_n_s_m: Vec3 = (0.0, 0.0, 0.0)
    angular_damping_nm_s: float = 0.0
    battery: Battery = Battery()

    @property
    def hover_thrust(self) -> float:
        """Collective thrust command that carries the vehicle in still air, 0 to 1."""
        from daemon.sim.vehicle import SIM_GRAVITY_M_S2

        return self.mass_kg * SIM_GRAVITY_M_S2 / (len(self.rotors) * self.rotor_max_thrust_n)
