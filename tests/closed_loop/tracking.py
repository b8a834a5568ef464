"""The control law around the simulated vehicle and rate loop, with PX4's delays and, if asked for, its noise."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import cos, sin, sqrt
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.control import controller
from daemon.control.parameters import ControlParameters
from daemon.estimation import predictor
from daemon.estimation.predictor import PredictorParameters, SentRates
from daemon.messages import ZERO3, EstimatedState, Quat, Reference, Setpoint, Vec3
from daemon.sim import vehicle
from daemon.sim.airframe_files import load
from daemon.sim.rate_control import RateLoop
from daemon.sim.vehicle import Surroundings, VehicleState

STEP_S = 0.004
AGE_STEPS = 3  # of ODOMETRY when it arrives, 12 ms
ACTS_S = 0.02  # after now: moment for which the state is predicted, as the pipeline has it
HOVER_HEIGHT_M = 10.0

PREDICTOR = PredictorParameters()
SIH = load("sih")
SIH_DRAG_1_S = (1.0, 1.0, 1.0)


class RecordedErrors:
    """What PX4's estimate was wrong by on a recorded flight (48 s of a figure-eight): replayed over any truth.

    Rows at 100 Hz: position and velocity (NED), attitude (rotation vector, body), rates; estimate minus truth.
    """

    def __init__(self) -> None:
        with np.load(Path(__file__).parent.parent / "fixtures" / "control" / "estimate_errors.npz") as file:
            self._rows: list[list[float]] = file["errors"].astype(float).tolist()

    def on(self, state: EstimatedState) -> EstimatedState:
        """The state as PX4 would estimate it."""
        row = self._rows[round(state.time_s / 0.01) % len(self._rows)]
        return replace(
            state,
            position_ned_m=frames.add(state.position_ned_m, (row[0], row[1], row[2])),
            velocity_ned_m_s=frames.add(state.velocity_ned_m_s, (row[3], row[4], row[5])),
            attitude_wb=frames.multiply(state.attitude_wb, frames.exp((row[6], row[7], row[8]))),
            rates_frd_rad_s=frames.add(state.rates_frd_rad_s, (row[9], row[10], row[11])),
        )


@dataclass(frozen=True, slots=True)
class Sample:
    """One control tick: truth and estimate at the newest sample's stamp with the reference there; the command."""

    time_s: float
    truth: VehicleState
    estimate: EstimatedState
    reference: Reference
    setpoint: Setpoint
    record: controller.ControlRecord

    @property
    def error_m(self) -> float:
        """Distance of the truth from the reference."""
        return frames.norm(frames.subtract(self.truth.position_ned_m, self.reference.position_ned_m))

    @property
    def estimate_error_m(self) -> float:
        """Distance of the estimate from the reference."""
        return frames.norm(frames.subtract(self.estimate.position_ned_m, self.reference.position_ned_m))


@dataclass(slots=True, kw_only=True)
class Flight:
    """A flight from a start upon the reference, level, with conditions; ``switched``: parameters from a time on."""

    reference_at: Callable[[float], Reference]
    parameters: ControlParameters
    wind_at: Callable[[float], Vec3] = lambda _: ZERO3
    payload_kg: float = 0.0
    errors: RecordedErrors | None = None
    uplink_steps: int = 1
    predicted: bool = True
    switched: tuple[float, ControlParameters] | None = None
    start_wb: Quat | None = None
    samples: list[Sample] = field(default_factory=list)

    def fly(self, duration_s: float) -> list[Sample]:
        """One sample a control tick."""
        start = self.reference_at(0.0)
        attitude_wb = self.start_wb or frames.from_yaw(start.yaw_rad)
        signals = (SIH.hover_thrust / frames.down_axis(attitude_wb)[2],) * 4
        truth = VehicleState(start.position_ned_m, start.velocity_ned_m_s, attitude_wb, ZERO3, signals, on_ground=False)
        loop, law = RateLoop(SIH, 0.0), _Law(self)
        downlink: deque[tuple[int, VehicleState, EstimatedState]] = deque()
        uplink: deque[tuple[int, Setpoint]] = deque()
        command = Setpoint(ZERO3, SIH.hover_thrust)
        for step in range(round(duration_s / STEP_S)):
            now_s = step * STEP_S
            if step % 5 in (0, 3):  # telemetry: 100 Hz on the 4 ms grid
                downlink.append((step + AGE_STEPS, truth, self._estimate(now_s, truth, loop)))
            if step % 5 in (1, 4) and downlink and downlink[0][0] <= step:
                while len(downlink) > 1 and downlink[1][0] <= step:
                    downlink.popleft()
                _, seen, estimate = downlink[0]
                setpoint, record = law.tick(now_s, estimate)
                uplink.append((step + self.uplink_steps, setpoint))
                reference = self.reference_at(estimate.time_s)
                self.samples.append(Sample(now_s, seen, estimate, reference, setpoint, record))
            while uplink and uplink[0][0] <= step:
                command = uplink.popleft()[1]
            loop.sense(truth.rates_frd_rad_s)
            signals = loop.run(command.rates_frd_rad_s, command.thrust, False)
            around = Surroundings(wind_ned_m_s=self.wind_at(now_s), payload_kg=self.payload_kg, has_ground=False)
            truth = vehicle.step(truth, signals, SIH, around, STEP_S)
        return self.samples

    def _estimate(self, now_s: float, truth: VehicleState, loop: RateLoop) -> EstimatedState:
        state = EstimatedState(
            now_s, truth.position_ned_m, truth.velocity_ned_m_s, truth.attitude_wb, loop.filtered_rates
        )
        return self.errors.on(state) if self.errors else state


class _Law:
    """The control law with its prediction, as the pipeline runs it."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._state = controller.initial(flight.parameters)
        self._acceleration = ZERO3
        self._sent: tuple[SentRates, ...] = ()
        self._last_s = -0.01

    def tick(self, now_s: float, estimate: EstimatedState) -> tuple[Setpoint, controller.ControlRecord]:
        flight, acts_s = self._flight, now_s + ACTS_S
        if flight.switched is not None and now_s >= flight.switched[0]:
            flight.parameters = flight.switched[1]
        ahead = replace(estimate, time_s=acts_s)
        if flight.predicted:
            ahead = predictor.predict(estimate, acts_s, self._acceleration, self._sent, parameters=PREDICTOR)
        self._state, setpoint, record = controller.step(
            self._state,
            estimate,
            ahead,
            flight.reference_at(acts_s),
            now_s - self._last_s,
            parameters=flight.parameters,
        )
        self._acceleration, self._last_s = record.acceleration_ned_m_s2, now_s
        self._sent = predictor.remembered(self._sent, now_s, setpoint.rates_frd_rad_s, parameters=PREDICTOR)
        return setpoint, record


def hover(_: float) -> Reference:
    """Stay at a point."""
    return Reference(_, (0.0, 0.0, -HOVER_HEIGHT_M))


def lemniscate(peak_m_s: float) -> Callable[[float], Reference]:
    """x = 10 sin, y = 5 sin 2 with a peak speed; it starts at rest and is brought up to speed within 4 s."""
    rate = peak_m_s / (10.0 * sqrt(2.0))
    ramp_s = 4.0

    def phase(t: float) -> tuple[float, float, float, float]:
        if t >= ramp_s:
            return rate * (t - 0.5 * ramp_s), rate, 0.0, 0.0
        s = max(t, 0.0) / ramp_s
        # speed along the phase: smoothstep 10 s^3 - 15 s^4 + 6 s^5
        angle = ramp_s * (2.5 * s**4 - 3.0 * s**5 + s**6)
        speed = 10 * s**3 - 15 * s**4 + 6 * s**5
        slope = (30 * s**2 - 60 * s**3 + 30 * s**4) / ramp_s
        curve = (60 * s - 180 * s**2 + 120 * s**3) / ramp_s**2
        return rate * angle, rate * speed, rate * slope, rate * curve

    def axis(
        amplitude: float, factor: float, p: tuple[float, float, float, float]
    ) -> tuple[float, float, float, float]:
        angle, w, dw, ddw = (factor * v for v in p)
        s, c = sin(angle), cos(angle)
        return (
            amplitude * s,
            amplitude * c * w,
            amplitude * (c * dw - s * w * w),
            amplitude * (c * ddw - 3.0 * s * w * dw - c * w**3),
        )

    def at(t: float) -> Reference:
        p = phase(t)
        x, y = axis(10.0, 1.0, p), axis(5.0, 2.0, p)
        return Reference(t, (x[0], y[0], -HOVER_HEIGHT_M), (x[1], y[1], 0.0), (x[2], y[2], 0.0), (x[3], y[3], 0.0))

    return at


def rms(values: list[float]) -> float:
    """Root of the mean square."""
    return sqrt(sum(v * v for v in values) / len(values))


def move(distance_m: float, duration_s: float) -> Callable[[float], Reference]:
    """North by a distance from rest to rest (quintic), then stay."""

    def at(t: float) -> Reference:
        s = min(max(t / duration_s, 0.0), 1.0)
        d, T = distance_m, duration_s
        return Reference(
            t,
            (d * (10 * s**3 - 15 * s**4 + 6 * s**5), 0.0, -HOVER_HEIGHT_M),
            (d * (30 * s**2 - 60 * s**3 + 30 * s**4) / T, 0.0, 0.0),
            (d * (60 * s - 180 * s**2 + 120 * s**3) / T**2, 0.0, 0.0),
            (d * (60 - 360 * s + 360 * s**2) / T**3 if 0.0 < t < T else 0.0, 0.0, 0.0),
        )

    return at


def tilt_max_rad(samples: list[Sample]) -> float:
    """Largest tilt of the truth."""
    return max(frames.tilt_of(s.truth.attitude_wb) for s in samples)
