"""What PX4's own modes want from moment to moment: take-off, hold, return, land, descend, and the pilot's sticks.

Speeds and times are PX4's parameters; where a recording of PX4 1.17 shows another figure than the parameter, the
constant below says so. Runs at the estimator's 125 Hz, in the estimator's frame. Climbing and sinking is by velocity
alone: against linear drag PX4's velocity integral needs some seconds, and the recordings show that.
"""

from dataclasses import dataclass
from math import copysign, hypot, nan, radians, tan

from daemon.frames import add, clamp, from_rpy, rotate_about_down, wrap_pi, yaw_of
from daemon.messages import ZERO3, FlightMode, Setpoint, Vec3
from daemon.sim.estimator import STEP_S, Estimate, Jump
from daemon.sim.modes import STICK_VELOCITY_MODES
from daemon.sim.parameters import Parameters
from daemon.sim.position_control import PositionControl, Wanted, attitude_rates

_ACCELERATION_M_S2 = 3.0  # MPC_ACC_HOR
_CLIMB_ACCELERATION_M_S2 = 1.0  # recorded
_CLIMB_BRAKE_M_S2 = 0.4  # recorded
_ALTITUDE_RADIUS_M = 0.8  # NAV_MC_ALT_RAD
_LAND_ALTITUDES_M = (10.0, 5.0, 1.0)  # MPC_LAND_ALT1, ALT2, ALT3
_STICK_SPEED_M_S = 10.0  # MPC_VEL_MANUAL
_STICK_YAW_RATE_RAD_S = radians(150.0)  # MPC_MAN_Y_MAX
_STICK_TILT_RAD = radians(35.0)  # MPC_MAN_TILT_MAX
_STICK_RATE_RAD_S = radians(100.0)  # MC_ACRO_R_MAX
_LANDS_AFTER_S = 0.05  # recorded: near home Return turns into a landing after 50 to 60 ms
_FAR_M = 100.0
_TAKEOFF_THROTTLE = 0.6
_STAYS_DOWN = frozenset((FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN, FlightMode.UNKNOWN))


@dataclass(frozen=True, slots=True, eq=False)
class Sticks:
    """MANUAL_CONTROL: pitch (forward), roll (right), yaw, -1 to 1; throttle 0 to 1."""

    forward: float = 0.0
    right: float = 0.0
    throttle: float = 0.5
    yaw: float = 0.0


class FlightTasks:
    """Rates and thrust for every mode but Offboard. ``finished`` is true when take-off or the way home is done."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._control = PositionControl(parameters["MPC_THR_HOVER"], parameters["MPC_THR_MIN"])
        self._mode = FlightMode.HOLD
        self._reference: Vec3 = ZERO3
        self._speed: Vec3 = ZERO3
        self._target: Vec3 = ZERO3
        self._yaw = 0.0
        self._since_s = 0.0
        self.home_ned_m: Vec3 = ZERO3
        self.finished = False
        self.sticks = Sticks()

    def enter(
        self, mode: FlightMode, estimate: Estimate, takeoff_down_m: float | None = None, *, landed: bool = False
    ) -> None:
        """Begin a mode from the estimate as it is; only a take-off from the ground begins with the thrust ramp."""
        if mode not in (FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN) or self._mode == FlightMode.OFFBOARD:
            self._control.restart()
        climbed = self._mode is FlightMode.TAKEOFF and mode is FlightMode.HOLD and self.finished
        is_home = self._mode is FlightMode.RETURN and mode is FlightMode.LAND and self.finished
        self._mode = mode
        self._reference, self._speed = estimate.position_ned_m, estimate.velocity_ned_m_s
        self._yaw = yaw_of(estimate.attitude_wb)
        self._since_s = 0.0
        self.finished = False
        top_down_m = self._target[2]
        self._target = _stop_point(self._reference, self._speed)
        if climbed:  # Hold after a take-off goes on to its altitude
            self._target = (self._target[0], self._target[1], top_down_m)
        elif is_home:
            self._target = self.home_ned_m
        if mode is FlightMode.TAKEOFF and takeoff_down_m is not None:
            self._target = (self._reference[0], self._reference[1], takeoff_down_m)
            self._speed = ZERO3
            self._since_s = 0.0 if landed else self._parameters["MPC_TKO_RAMP_T"]

    @property
    def lifts(self) -> bool:
        """Whether this mode leaves the ground: Hold and the like do not, a pilot only with the throttle up."""
        if self._mode in STICK_VELOCITY_MODES:
            return self.sticks.throttle > _TAKEOFF_THROTTLE
        return self._mode not in _STAYS_DOWN

    def shift(self, jump: Jump) -> None:
        """Setpoints move with a reset of the estimator (PX4's rule)."""
        self._reference = add(self._reference, jump.position_ned_m)
        self._target = add(self._target, jump.position_ned_m)
        self._speed = add(self._speed, jump.velocity_ned_m_s)
        self._yaw = wrap_pi(self._yaw + jump.yaw_rad)
        self._control.shift(jump)

    def run(self, estimate: Estimate, height_m: float) -> Setpoint:
        """One step; ``height_m`` above ground is what the range finder says."""
        self._since_s += STEP_S
        if self._mode in (FlightMode.MANUAL, FlightMode.STABILIZED, FlightMode.ACRO):
            return self._fly_sticks(estimate)
        if self._mode is FlightMode.TAKEOFF:
            return self._take_off(estimate)
        tilt = radians(self._parameters["MPC_TILTMAX_AIR"])
        if self._mode in STICK_VELOCITY_MODES:
            return self._control.run(self._stick_velocity(estimate), estimate, tilt)
        if self._mode is FlightMode.UNKNOWN:  # FlightTaskDescend: level, down at the landing speed, heading kept
            sink_m_s = self._parameters["MPC_LAND_SPEED"]
            down = Wanted((nan, nan, nan), (*estimate.velocity_ned_m_s[:2], sink_m_s), self._yaw)
            return self._control.run(down, estimate, 0.0)
        if self._mode is FlightMode.LAND:
            down_m = estimate.position_ned_m[2]
            self._reference = (self._reference[0], self._reference[1], down_m)
            self._target = (self._target[0], self._target[1], down_m + _FAR_M)
            self._advance(self._parameters["MPC_XY_CRUISE"], self._sink(height_m))
        elif self._mode is FlightMode.RETURN:
            self._go_home(estimate)
        else:
            self._advance(self._parameters["MPC_XY_CRUISE"], self._parameters["MPC_Z_VEL_MAX_DN"])
        return self._control.run(Wanted(self._reference, self._speed, self._yaw), estimate, tilt)

    def _take_off(self, estimate: Estimate) -> Setpoint:
        """Thrust ramp of MPC_TKO_RAMP_T, then a climb; the ramp lifts off only as it ends."""
        tilt = radians(self._parameters["MPC_TILTMAX_AIR"])
        progress = self._since_s / self._parameters["MPC_TKO_RAMP_T"]
        if progress < 1.0:
            self._reference = estimate.position_ned_m
            held = Wanted((nan, nan, nan), ZERO3, self._yaw)
            rates = self._control.run(held, estimate, tilt).rates_frd_rad_s
            self._control.restart()
            return Setpoint(rates, self._control.hover_thrust * progress)
        self._reference = (self._reference[0], self._reference[1], estimate.position_ned_m[2])
        self._advance(self._parameters["MPC_XY_CRUISE"], self._parameters["MPC_TKO_SPEED"])
        if estimate.position_ned_m[2] - self._target[2] < _ALTITUDE_RADIUS_M:
            self.finished = True
        return self._control.run(Wanted(self._reference, self._speed, self._yaw), estimate, tilt)

    def _go_home(self, estimate: Estimate) -> None:
        """Climb (``RTL::computeReturnAltitude``), fly home, hand over to landing (``RtlDirect``)."""
        position, home, p = estimate.position_ned_m, self.home_ned_m, self._parameters
        away_m = hypot(position[0] - home[0], position[1] - home[1])
        if self._since_s < 1.5 * STEP_S:
            top = min(home[2] - self._return_altitude_m(away_m), position[2])
            self._target = (self._target[0], self._target[1], top)
        if position[2] < self._target[2] + _ALTITUDE_RADIUS_M:
            self._target = (home[0], home[1], self._target[2])
            self.finished = away_m <= p["NAV_ACC_RAD"] and self._since_s > _LANDS_AFTER_S
        self._advance(p["MPC_XY_CRUISE"], p["MPC_Z_VEL_MAX_UP"])

    def _return_altitude_m(self, away_m: float) -> float:
        """Above home: RTL_RETURN_ALT far off; within RTL_MIN_DIST a cone, but at least twice the acceptance radius."""
        p = self._parameters
        if away_m <= p["NAV_ACC_RAD"]:
            return min(2.0 * away_m, p["RTL_RETURN_ALT"])
        if away_m > p["RTL_MIN_DIST"]:
            return p["RTL_RETURN_ALT"]
        cone_m = away_m / tan(radians(p["RTL_CONE_ANG"]))
        return min(max(cone_m, 2.0 * p["NAV_ACC_RAD"]), p["RTL_RETURN_ALT"])

    def _sink(self, height_m: float) -> float:
        """Landing speed (``FlightTaskAuto::_prepareLandSetpoints``): slower near ground."""
        high, low, crawl = _LAND_ALTITUDES_M
        if height_m < crawl:
            return self._parameters["MPC_LAND_CRWL"]
        slow, fast = self._parameters["MPC_LAND_SPEED"], self._parameters["MPC_Z_VEL_MAX_DN"]
        return slow + clamp((height_m - low) / (high - low), 0.0, 1.0) * (fast - slow)

    def _advance(self, speed_m_s: float, vertical_speed_m_s: float) -> None:
        """Move the reference towards the target with limited speed and acceleration."""
        (rx, ry, rz), (vx, vy, vz), (tx, ty, tz) = self._reference, self._speed, self._target
        dx, dy = tx - rx, ty - ry
        away = hypot(dx, dy)
        wanted = min(speed_m_s, away, (_ACCELERATION_M_S2 * away) ** 0.5)
        ux, uy = (dx / away * wanted, dy / away * wanted) if away > 1e-6 else (0.0, 0.0)
        ax, ay = ux - vx, uy - vy
        change, largest = hypot(ax, ay), _ACCELERATION_M_S2 * STEP_S
        share = largest / change if change > largest else 1.0
        vx, vy = vx + ax * share, vy + ay * share
        climb = abs(tz - rz)
        uz = copysign(min(vertical_speed_m_s, climb, (2.0 * _CLIMB_BRAKE_M_S2 * climb) ** 0.5), tz - rz)
        vz += clamp(uz - vz, -_CLIMB_ACCELERATION_M_S2 * STEP_S, _ACCELERATION_M_S2 * STEP_S)
        self._speed = (vx, vy, vz)
        self._reference = (rx + vx * STEP_S, ry + vy * STEP_S, rz + vz * STEP_S)

    def _stick_velocity(self, estimate: Estimate) -> Wanted:
        """Position, Altitude and their kin: sticks are velocities about the heading; centred sticks hold the place."""
        s = self.sticks
        self._yaw = wrap_pi(self._yaw + s.yaw * _STICK_YAW_RATE_RAD_S * STEP_S)
        north, east, _ = rotate_about_down((s.forward * _STICK_SPEED_M_S, s.right * _STICK_SPEED_M_S, 0.0), self._yaw)
        up = 2.0 * s.throttle - 1.0
        limit = self._parameters["MPC_Z_VEL_MAX_UP" if up > 0.0 else "MPC_Z_VEL_MAX_DN"]
        if hypot(s.forward, s.right) > 0.05:
            self._target = (*_stop_point(estimate.position_ned_m, estimate.velocity_ned_m_s)[:2], self._target[2])
            place = (nan, nan)
        else:
            place = (self._target[0], self._target[1])
        if abs(up) > 0.1:
            self._target = (self._target[0], self._target[1], estimate.position_ned_m[2])
            return Wanted((*place, nan), (north, east, -up * limit), self._yaw)
        return Wanted((*place, self._target[2]), (north, east, 0.0), self._yaw)

    def _fly_sticks(self, estimate: Estimate) -> Setpoint:
        """Stabilized (sticks are tilt) and Acro (sticks are rates); thrust is hover at the middle."""
        s = self.sticks
        hover = self._control.hover_thrust
        thrust = hover * s.throttle * 2.0 if s.throttle < 0.5 else hover + (1.0 - hover) * (2.0 * s.throttle - 1.0)
        if self._mode is FlightMode.ACRO:
            return Setpoint(
                (s.right * _STICK_RATE_RAD_S, -s.forward * _STICK_RATE_RAD_S, s.yaw * _STICK_RATE_RAD_S), thrust
            )
        self._yaw = wrap_pi(self._yaw + s.yaw * _STICK_YAW_RATE_RAD_S * STEP_S)
        wanted = from_rpy(s.right * _STICK_TILT_RAD, -s.forward * _STICK_TILT_RAD, self._yaw)
        return Setpoint(attitude_rates(wanted, estimate.attitude_wb), thrust)


def _stop_point(position: Vec3, velocity: Vec3) -> Vec3:
    """Where braking ends."""
    speed = hypot(velocity[0], velocity[1])
    time_s = 0.5 * speed / _ACCELERATION_M_S2 + (0.3 if speed > 0.3 else 0.0)
    return (position[0] + velocity[0] * time_s, position[1] + velocity[1] * time_s, position[2] + 0.3 * velocity[2])
