"""What PX4's estimator believes: truth plus errors as recorded, jumps with their counter, the loss of GPS.

Velocity errs by a Gauss-Markov process of some seconds, position by the integral of that error, pulled back by
GPS, and by a slow wander; tilt by a standing bias and a Gauss-Markov process; the heading by a large bias that differs
from start to start. The standard deviations are those of recordings of PX4 1.17 SITL (hover; smaller at rest).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import radians

from daemon.frames import add, exp, from_yaw, multiply, rotate_about_down, scale
from daemon.messages import IDENTITY, ZERO3, Quat, Vec3
from daemon.sim.noise import Coloured
from daemon.sim.vehicle import VehicleState

STEP_S = 0.008  # PX4's estimator output: 125 Hz

_VELOCITY_STD_M_S = (0.06, 0.13, 0.06)
_VELOCITY_TIME_S = (4.0, 2.5, 1.2)
_TILT_TIME_S = 1.2
_POSITION_PULL_S = 1.5
_WANDER_STD_M = (0.12, 0.12, 0.15)
_WANDER_TIME_S = 30.0
_WANDER_SMOOTH_S = 0.08
_TILT_STD_RAD = (radians(0.6), radians(0.2))
_TILT_BIAS_STD_RAD = (radians(1.2), radians(0.8))
_HEADING_STD_RAD = radians(1.0)
_HEADING_BIAS_STD_RAD = radians(5.0)
_REST_SHARE = 0.12  # of the flying noise, on the ground
_SPIN_UP_S = 1.0  # noise grows and fades with this time constant at take-off and landing

_GPS_DRIFT_M_S2 = 0.55  # recorded: 6 m in 5 s, 74 m in 16 s
_DRIFT_HEADING_RAD = -1.45
_INVALID_AFTER_S = 5.3
_FUSION_STOPS_AFTER_S = 7.4
_RETURN_AFTER_S = 1.2
_SLIDE_S = 0.1
_VALID_AFTER_RETURN_S = 2.2
_CALM_VARIANCE_M2 = 0.042
_GPS_RATE_HZ, _GPS_VARIANCE_M2 = 8.0, 0.81
_EXTERNAL_VARIANCE_M2 = 0.25  # of a position from outside, accurate to 0.5 m
_GPS_RESET_VARIANCE_M2 = 1.62
_EXTERNAL_POSITION_PULL_S = 0.8  # recorded: 2.8 m off, 1.75 m after 0.45 s, 0.85 m after 0.95 s
_EXTERNAL_POSITION_GATE_M = 5.0  # further off than this GPS resets the estimate back
_EXTERNAL_POSITION_RESET_S = 1.07
_VELOCITY_RESET_PULL_S = 1.0
BOOT_RESETS = ((0.0, 8), (2.0, 10), (4.0, 11))  # seconds after boot, reset_counter


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """One output of the estimator in its local frame; ``stamp_us`` of the autopilot's clock."""

    stamp_us: int
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    attitude_wb: Quat
    position_variance_m2: float
    reset_counter: int


@dataclass(frozen=True, slots=True, eq=False)
class Jump:
    """A reset: what the controller's setpoints have to be moved by (new minus old) and how far the counter steps."""

    position_ned_m: Vec3 = ZERO3
    velocity_ned_m_s: Vec3 = ZERO3
    yaw_rad: float = 0.0
    count: int = 1


class Estimator:
    """Stepped every ``STEP_S``; ``jumps`` collects the resets since they were last taken."""

    def __init__(self, draw: Iterator[float], *, noise: bool) -> None:
        self._draw = draw
        self._noise = noise
        self._velocity = tuple(Coloured(time_s, STEP_S) for time_s in _VELOCITY_TIME_S)
        self._wander = tuple(Coloured(_WANDER_TIME_S, STEP_S, self._normal()) for _ in range(3))
        self._tilt = tuple(Coloured(_TILT_TIME_S, STEP_S) for _ in range(3))
        self._tilt_bias = tuple(_TILT_BIAS_STD_RAD[i] * self._normal() for i in range(2))
        self._heading_bias = _HEADING_BIAS_STD_RAD * self._normal()
        self.origin_ned_m: Vec3 = tuple(0.15 * self._normal() for _ in range(3))  # type: ignore[assignment]
        self._pulled: Vec3 = ZERO3
        self._wandered: Vec3 = ZERO3
        self._share = _REST_SHARE
        self._external: Vec3 = ZERO3
        self._external_age_s: float | None = None
        self._variance_m2, self._variance_age_s = _CALM_VARIANCE_M2, 0.0
        self._velocity_offset: Vec3 = ZERO3
        self.heading_offset_rad = 0.0
        self.heading_fault = False
        self.gps = True
        self.lost_s = 0.0
        self._returning_s: float | None = None
        self._since_return_s = 1e9
        self._drift_velocity: Vec3 = ZERO3
        self._drift: Vec3 = ZERO3
        self.reset_counter = BOOT_RESETS[-1][1]
        self.jumps: list[Jump] = []
        self.estimate = Estimate(0, ZERO3, ZERO3, IDENTITY, _CALM_VARIANCE_M2, self.reset_counter)

    def _normal(self) -> float:
        return next(self._draw) if self._noise else 0.0

    @property
    def position_valid(self) -> bool:
        """Whether PX4's checks take the position as usable (false from 5.3 s without GPS)."""
        return self.lost_s < _INVALID_AFTER_S and self._since_return_s > _VALID_AFTER_RETURN_S

    @property
    def fusing(self) -> bool:
        """Whether GNSS data is fused: from 7.4 s without GPS to the jump back it is not."""
        return self.lost_s < _FUSION_STOPS_AFTER_S

    def start_in_air(self) -> None:
        """The errors of flight from the first moment."""
        self._share = 1.0

    def step(self, truth: VehicleState, stamp_us: int) -> Estimate:
        """The estimate of the truth at this moment."""
        self._step_resets()
        self._step_gps()
        velocity_error, position_error, turn = self._errors(not truth.on_ground)
        position = add(truth.position_ned_m, position_error)
        origin, external = self.origin_ned_m, self._external
        attitude = multiply(truth.attitude_wb, exp(turn[0])) if self._noise else truth.attitude_wb
        if turn[1] != 0.0:
            attitude = multiply(from_yaw(turn[1]), attitude)
        if attitude[0] < 0.0:
            attitude = (-attitude[0], -attitude[1], -attitude[2], -attitude[3])
        self.estimate = Estimate(
            stamp_us,
            (
                position[0] - origin[0] + external[0],
                position[1] - origin[1] + external[1],
                position[2] - origin[2] + external[2],
            ),
            add(add(truth.velocity_ned_m_s, velocity_error), self._velocity_offset),
            attitude,
            self.position_variance_m2,
            self.reset_counter & 0xFF,
        )
        return self.estimate

    @property
    def position_variance_m2(self) -> float:
        """Claimed variance of x and y; the growth fits the recorded loss of GPS within 10 %.

        A reset to a measurement claims the measurement's, until GPS has told more.
        """
        t = self.lost_s
        if t > 0.0:
            return _CALM_VARIANCE_M2 + 0.0199 * t * t + 5.78e-4 * t**4
        returned = 0.6 * max(0.0, 1.0 - self._since_return_s / _VALID_AFTER_RETURN_S) ** 2
        fixes = int(_GPS_RATE_HZ * self._variance_age_s)
        reset = 1.0 / (1.0 / self._variance_m2 + fixes / _GPS_VARIANCE_M2)
        return max(_CALM_VARIANCE_M2 + returned, reset)

    def move_origin(self, delta_ned_m: Vec3) -> None:
        """The local frame's origin moves: positions step by the opposite, for good."""
        self.origin_ned_m = add(self.origin_ned_m, delta_ned_m)
        self._jump(Jump(position_ned_m=scale(delta_ned_m, -1.0), count=2))

    def offset_position(self, delta_ned_m: Vec3, count: int) -> None:
        """Believe to be elsewhere; GPS pulls the estimate back, or resets it when the offset is large."""
        self._external = add(self._external, delta_ned_m)
        self._external_age_s = 0.0
        self._variance_m2, self._variance_age_s = _EXTERNAL_VARIANCE_M2, 0.0
        self._jump(Jump(position_ned_m=delta_ned_m, count=count))

    def offset_velocity(self, delta_ned_m_s: Vec3) -> None:
        """Believe to move differently; fades within about a second."""
        self._velocity_offset = add(self._velocity_offset, delta_ned_m_s)
        self._jump(Jump(velocity_ned_m_s=delta_ned_m_s))

    def turn_heading(self, angle_rad: float) -> None:
        """Believe to look elsewhere: the attitude turns, position and velocity stay."""
        self.heading_offset_rad += angle_rad
        self._jump(Jump(yaw_rad=angle_rad))

    def _jump(self, jump: Jump) -> None:
        self.reset_counter += jump.count
        self.jumps.append(jump)

    def _step_resets(self) -> None:
        keep = 1.0 - STEP_S / _VELOCITY_RESET_PULL_S
        if self._velocity_offset != ZERO3:
            self._velocity_offset = scale(self._velocity_offset, keep)
        if self._external_age_s is None:
            self._variance_age_s += STEP_S
            return
        self._external_age_s += STEP_S
        off = max(abs(v) for v in self._external)
        if off > _EXTERNAL_POSITION_GATE_M and self._external_age_s >= _EXTERNAL_POSITION_RESET_S:
            back = scale(self._external, -1.0)
            self._external, self._external_age_s = ZERO3, None
            self._variance_m2, self._variance_age_s = _GPS_RESET_VARIANCE_M2, 0.0
            turn, self.heading_offset_rad = -self.heading_offset_rad, 0.0
            self.heading_fault = True
            self._jump(Jump(position_ned_m=back, yaw_rad=turn, count=4))
        elif off <= _EXTERNAL_POSITION_GATE_M:
            self._variance_age_s += STEP_S
            self._external = scale(self._external, 1.0 - STEP_S / _EXTERNAL_POSITION_PULL_S)

    def _step_gps(self) -> None:
        self._since_return_s += STEP_S
        if not self.gps:
            self._returning_s = None
            self._drift_on()
        elif self.lost_s > 0.0:
            self._return()

    def _drift_on(self) -> None:
        """Inertial sensors alone. The vehicle drifts from where it believes to be: the error is the opposite."""
        self.lost_s += STEP_S
        acceleration = rotate_about_down((_GPS_DRIFT_M_S2, 0.0, 0.0), _DRIFT_HEADING_RAD)
        self._drift_velocity = add(self._drift_velocity, scale(acceleration, -STEP_S))
        self._drift = add(self._drift, scale(self._drift_velocity, STEP_S))

    def _return(self) -> None:
        """GPS is back: after a short loss the estimate slides home within 0.1 s, after a long one it jumps."""
        since_s = (self._returning_s or 0.0) + STEP_S
        self._returning_s = since_s
        if self.fusing:
            share = min(1.0, STEP_S / max(STEP_S, _SLIDE_S - since_s + STEP_S))
            self._drift = scale(self._drift, 1.0 - share)
            self._drift_velocity = scale(self._drift_velocity, 1.0 - share)
            if since_s >= _SLIDE_S:
                self._home_again(since_return_s=1e9)
        elif since_s >= _RETURN_AFTER_S:
            jump = Jump(scale(self._drift, -1.0), scale(self._drift_velocity, -1.0), count=4)
            self._home_again(since_return_s=0.0)
            self._jump(jump)
        else:
            self._drift_on()

    def _home_again(self, since_return_s: float) -> None:
        self._drift = self._drift_velocity = ZERO3
        self.lost_s, self._returning_s, self._since_return_s = 0.0, None, since_return_s

    def _errors(self, flying: bool) -> tuple[Vec3, Vec3, tuple[Vec3, float]]:
        """Errors of velocity and position (NED), turn in the body and heading offset."""
        if not self._noise:
            return self._drift_velocity, self._drift, (ZERO3, self.heading_offset_rad)
        draw = self._draw
        self._share += ((1.0 if flying else _REST_SHARE) - self._share) * STEP_S / _SPIN_UP_S
        share = self._share
        v, w, t = self._velocity, self._wander, self._tilt
        sx, sy, sz = _VELOCITY_STD_M_S
        vx = share * sx * v[0].update(next(draw))
        vy = share * sy * v[1].update(next(draw))
        vz = share * sz * v[2].update(next(draw))
        px, py, pz = self._pulled
        keep = 1.0 - STEP_S / _POSITION_PULL_S
        self._pulled = (px * keep + vx * STEP_S, py * keep + vy * STEP_S, pz * keep + vz * STEP_S)
        drift, speed, pulled = self._drift, self._drift_velocity, self._pulled
        sx, sy, sz = _WANDER_STD_M
        wx, wy, wz = self._wandered
        smooth = STEP_S / _WANDER_SMOOTH_S
        wx += (share * sx * w[0].update(next(draw)) - wx) * smooth
        wy += (share * sy * w[1].update(next(draw)) - wy) * smooth
        wz += (share * sz * w[2].update(next(draw)) - wz) * smooth
        self._wandered = (wx, wy, wz)
        position = (drift[0] + pulled[0] + wx, drift[1] + pulled[1] + wy, drift[2] + pulled[2] + wz)
        turn = (
            share * (self._tilt_bias[0] + _TILT_STD_RAD[0] * t[0].update(next(draw))),
            share * (self._tilt_bias[1] + _TILT_STD_RAD[1] * t[1].update(next(draw))),
            self._heading_bias + share * _HEADING_STD_RAD * t[2].update(next(draw)),
        )
        return (speed[0] + vx, speed[1] + vy, speed[2] + vz), position, (turn, self.heading_offset_rad)
