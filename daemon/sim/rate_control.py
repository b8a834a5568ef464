"""PX4's inner loop: gyro low-pass, rate controller, control allocation. Runs with each simulation step.

Structure and defaults of PX4 1.17: ``RateControl::update`` (PID on the filtered gyro, the integral waits while landed),
``MulticopterRateControl::Run`` (a setpoint that is not finite is the rate itself), IMU_GYRO_CUTOFF, IMU_DGYRO_CUTOFF,
MC_YAW_TQ_CUTOFF, ``ControlAllocationPseudoInverse`` with its normalized matrix (roll and pitch columns 1/sqrt 2, yaw
columns 1, on a four-rotor x). Saturation is simpler than in ``ControlAllocationSequentialDesaturation``.
"""

from math import copysign, isfinite, pi, sqrt, tan

from daemon.frames import clamp
from daemon.messages import ZERO3, Vec3
from daemon.sim.airframe import Airframe

STEP_S = 0.004
GYRO_CUTOFF_HZ = 40.0
GYRO_DERIVATIVE_CUTOFF_HZ = 20.0
_INTEGRAL_FADE_RAD_S = 400.0 * pi / 180.0  # the integral stops growing at this error


class LowPass3:
    """Second-order Butterworth low-pass on three axes, bilinear transform, sampled every ``STEP_S``."""

    __slots__ = ("_a1", "_a2", "_b0", "_d1", "_d2", "value")

    def __init__(self, cutoff_hz: float) -> None:
        k = tan(pi * cutoff_hz * STEP_S)
        norm = 1.0 / (1.0 + sqrt(2.0) * k + k * k)
        self._b0 = k * k * norm
        self._a1 = 2.0 * (k * k - 1.0) * norm
        self._a2 = (1.0 - sqrt(2.0) * k + k * k) * norm
        self._d1: Vec3 = ZERO3
        self._d2: Vec3 = ZERO3
        self.value: Vec3 = ZERO3

    def update(self, sample: Vec3) -> Vec3:
        """The filtered value (direct form II)."""
        b0, a1, a2, d1, d2 = self._b0, self._a1, self._a2, self._d1, self._d2
        n0 = sample[0] - a1 * d1[0] - a2 * d2[0]
        n1 = sample[1] - a1 * d1[1] - a2 * d2[1]
        n2 = sample[2] - a1 * d1[2] - a2 * d2[2]
        self._d1, self._d2 = (n0, n1, n2), d1
        self.value = (
            b0 * (n0 + 2.0 * d1[0] + d2[0]),
            b0 * (n1 + 2.0 * d1[1] + d2[1]),
            b0 * (n2 + 2.0 * d1[2] + d2[2]),
        )
        return self.value


class RateLoop:
    """Rates and collective thrust in, rotor signals out."""

    def __init__(self, airframe: Airframe, thrust_model_factor: float) -> None:
        self._gains = airframe.rate_gains
        self._mixer = _mixer(airframe)
        self._largest_tilt = max(max(abs(r), abs(p)) for r, p, _ in self._mixer)
        self._curve = thrust_model_factor
        self._gyro = LowPass3(GYRO_CUTOFF_HZ)
        self._derivative = LowPass3(GYRO_DERIVATIVE_CUTOFF_HZ)
        self._integral: Vec3 = ZERO3
        self._yaw_torque = 0.0
        rc_s = 1.0 / (2.0 * pi * self._gains.yaw_torque_cutoff_hz)
        self._yaw_share = STEP_S / (rc_s + STEP_S)
        self._saturated: tuple[int, int, int] = (0, 0, 0)
        self._still = tuple(0.0 for _ in airframe.rotors)

    @property
    def filtered_rates(self) -> Vec3:
        """The gyro after its low-pass: what ODOMETRY and ATTITUDE carry."""
        return self._gyro.value

    def sense(self, gyro_rad_s: Vec3) -> None:
        """Take a gyro sample; once per step."""
        old = self._gyro.value
        new = self._gyro.update(gyro_rad_s)
        self._derivative.update(((new[0] - old[0]) / STEP_S, (new[1] - old[1]) / STEP_S, (new[2] - old[2]) / STEP_S))

    def stop(self) -> tuple[float, ...]:
        """Disarmed: no signals, integrals cleared."""
        self._integral = ZERO3
        self._yaw_torque = 0.0
        return self._still

    def run(self, rates_rad_s: Vec3, thrust: float, on_ground: bool) -> tuple[float, ...]:
        """Rotor signals, 0 to 1."""
        if not isfinite(thrust):
            return self.stop()
        gains, rates, slopes = self._gains, self._gyro.value, self._derivative.value
        torque, integral = [0.0, 0.0, 0.0], list(self._integral)
        for i in range(3):
            setpoint = rates_rad_s[i]
            error = setpoint - rates[i] if isfinite(setpoint) else 0.0
            torque[i] = gains.p[i] * error + integral[i] - gains.d[i] * slopes[i]
            if not on_ground:
                integral[i] = self._integrated(i, error)
        self._integral = (integral[0], integral[1], integral[2])
        self._yaw_torque += (torque[2] - self._yaw_torque) * self._yaw_share
        return self._allocate(torque[0], torque[1], self._yaw_torque, clamp(thrust, 0.0, 1.0))

    def _integrated(self, axis: int, error: float) -> float:
        if self._saturated[axis] * error > 0.0:
            return self._integral[axis]
        fade = error / _INTEGRAL_FADE_RAD_S
        share = 1.0 - fade * fade
        if share <= 0.0:
            return self._integral[axis]
        limit = self._gains.integral_limit
        return clamp(self._integral[axis] + share * self._gains.i[axis] * error * STEP_S, -limit, limit)

    def _allocate(self, roll: float, pitch: float, yaw: float, thrust: float) -> tuple[float, ...]:
        """Roll and pitch first, then yaw as far as it fits; thrust gives way within [0, 1] (no airmode beyond it)."""
        signals = [thrust + r * roll + p * pitch + y * yaw for r, p, y in self._mixer]
        tilt = self._largest_tilt * (abs(roll) + abs(pitch))
        if min(signals) >= 0.0 and max(signals) <= 1.0 and tilt <= thrust and thrust + tilt <= 1.0:
            self._saturated = (0, 0, 0)
            return tuple(signals) if self._curve <= 0.0 else tuple([self._signal(signal) for signal in signals])
        return self._allocate_saturated(roll, pitch, yaw, thrust)

    def _allocate_saturated(self, roll: float, pitch: float, yaw: float, thrust: float) -> tuple[float, ...]:
        tilting = [r * roll + p * pitch for r, p, _ in self._mixer]
        low, high = min(tilting), max(tilting)
        share = 1.0 / (high - low) if high - low > 1.0 else 1.0
        if low * share < -thrust:
            share = thrust / -low
        room = [(thrust + t * share, y) for t, (_, _, y) in zip(tilting, self._mixer, strict=True)]
        excess = max(0.0, max(base for base, _ in room) - 1.0)
        yaw_share = 1.0
        for base, column in room:
            wanted = column * yaw
            signal = base - excess
            if wanted > 0.0 and signal + wanted > 1.0:
                yaw_share = min(yaw_share, max(0.0, 1.0 - signal) / wanted)
            elif wanted < 0.0 and signal + wanted < 0.0:
                yaw_share = min(yaw_share, max(0.0, signal) / -wanted)
        tilt_sign = (_sign(roll), _sign(pitch)) if share < 1.0 else (0, 0)
        self._saturated = (*tilt_sign, _sign(yaw) if yaw_share < 1.0 else 0)
        return tuple([self._signal(base - excess + column * yaw * yaw_share) for base, column in room])

    def _signal(self, thrust: float) -> float:
        """Inverse of PX4's thrust model, THR_MDL_FAC: thrust = f u^2 + (1 - f) u."""
        f, thrust = self._curve, clamp(thrust, 0.0, 1.0)
        if f <= 0.0:
            return thrust
        return (sqrt((1.0 - f) ** 2 + 4.0 * f * thrust) - (1.0 - f)) / (2.0 * f)


def _sign(value: float) -> int:
    return int(copysign(1.0, value))


def _mixer(airframe: Airframe) -> list[Vec3]:
    """Normalized roll, pitch and yaw share of each rotor."""
    roll = [-rotor.y_m for rotor in airframe.rotors]
    pitch = [rotor.x_m for rotor in airframe.rotors]
    yaw = [copysign(1.0, rotor.torque_nm_per_n) for rotor in airframe.rotors]
    half = len(roll) / 2.0
    roll_norm = sqrt(sum(r * r for r in roll) / half)
    pitch_norm = sqrt(sum(p * p for p in pitch) / half)
    norm = min(roll_norm, pitch_norm)
    return [(r / norm, p / norm, y) for r, p, y in zip(roll, pitch, yaw, strict=True)]
