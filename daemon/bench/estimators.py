"""What a tick of each estimator costs: the same flight's telemetry through the autopilot path, the EKF and the UKF."""

import asyncio
import gc
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from time import thread_time
from typing import Any

from daemon.autopilot.port import LinkError
from daemon.bench.cockpit import Cockpit
from daemon.bench.manoeuvres import lemniscate
from daemon.bench.quantiles import quantile
from daemon.bench.track import OURS, configuration
from daemon.config import load
from daemon.estimation import estimator
from daemon.estimation.estimator import EstimatorParameters
from daemon.loops.grid import LoopAlarm
from daemon.loops.turns import NotPossibleError
from daemon.messages import ZERO3, ExternalPose, Vec3
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Inputs, Record
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual

HEIGHT_M = 15.0
MANOEUVRE = replace(lemniscate(5.0), duration_s=20.0)
BOUNDS_US = {"autopilot": 40.0, "ekf": 250.0}
_POSE_LATE_S = 0.06
_POSE_EVERY = 3  # ticks


@dataclass(frozen=True, slots=True)
class Tick:
    """What the estimator gets in a tick."""

    inputs: Inputs
    acceleration_ned_m_s2: Vec3
    pose: ExternalPose | None
    now_s: float


@dataclass(frozen=True, slots=True)
class Cost:
    """Microseconds of CPU of a tick; ``bound_us``: of the median, None: none is set."""

    name: str
    ticks: int
    p50_us: float
    p99_us: float
    bound_us: float | None


def recorded(seed: int = 1) -> list[Tick]:
    """A lemniscate at 5 m/s on the simulated PX4, in virtual time; poses from outside at 33 Hz come 60 ms late."""
    return run_virtual(_flight(seed))


def measured(ticks: list[Tick], rounds: int = 5) -> list[Cost]:
    """The estimators in turn, round by round; of each the round with the least median."""
    kinds = {
        "autopilot": ("autopilot", False),
        "ekf": ("ekf", False),
        "ekf, late poses": ("ekf", True),
        "ukf": ("ukf", False),
    }
    best: dict[str, list[float]] = {}
    for _ in range(rounds):
        for name, (kind, poses) in kinds.items():
            costs = _timed(ticks, _parameters(kind), poses)
            if name not in best or quantile(costs, 0.5) < quantile(best[name], 0.5):
                best[name] = costs
    return [
        Cost(name, len(costs), 1e6 * quantile(costs, 0.5), 1e6 * quantile(costs, 0.99), BOUNDS_US.get(name))
        for name, costs in best.items()
    ]


def table(costs: Iterable[Cost]) -> str:
    """One line an estimator."""
    lines = [f"{'estimator':<16}  p50 us  p99 us  bound"]
    for cost in costs:
        bound = "" if cost.bound_us is None else f"{cost.bound_us:5.0f}"
        lines.append(f"{cost.name:<16}  {cost.p50_us:6.1f}  {cost.p99_us:6.1f}  {bound}".rstrip())
    return "\n".join(lines)


def as_json(costs: Iterable[Cost]) -> list[dict[str, Any]]:
    """One object an estimator."""
    return [{k: round(v, 2) if isinstance(v, float) else v for k, v in asdict(cost).items()} for cost in costs]


def _parameters(kind: str) -> EstimatorParameters:
    config = load([], {"estimator": {"kind": kind}})
    return pipeline_parameters(config, geofence(config, ZERO3)).estimator


def _timed(ticks: list[Tick], parameters: EstimatorParameters, poses: bool) -> list[float]:
    state = estimator.initial(parameters)
    costs = []
    gc.collect()
    gc.disable()
    try:
        for tick in ticks:
            pose, inputs = tick.pose if poses else None, tick.inputs
            begun = thread_time()
            state, _ = estimator.step(
                state,
                inputs.odometry,
                inputs.imu,
                tick.acceleration_ned_m_s2,
                tick.now_s,
                parameters=parameters,
                pose=pose,
                sync=inputs.clock,
            )
            costs.append(thread_time() - begun)
    finally:
        gc.enable()
    return costs


class _Tape:
    """A listener of the control task."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []
        self._poses: list[ExternalPose] = []
        self._pose: ExternalPose | None = None

    def on_tick(self, inputs: Inputs, record: Record) -> None:
        """Note what the estimator saw; the pose that comes now was true a while ago."""
        newest = record.estimate.newest
        if newest is not None and len(self.ticks) % _POSE_EVERY == 0:
            variance = (1e-4, 1e-4, 1e-4)
            self._poses.append(
                ExternalPose(newest.time_s, newest.position_ned_m, newest.attitude_wb, variance, variance)
            )
            while self._poses and self._poses[0].stamp_s <= record.now_s - _POSE_LATE_S:
                self._pose = self._poses.pop(0)
        acceleration = record.control.acceleration_ned_m_s2 if record.control else ZERO3
        self.ticks.append(Tick(inputs, acceleration, self._pose, record.now_s))


async def _flight(seed: int) -> list[Tick]:
    loop = asyncio.get_running_loop()
    airframe = load_airframe("sih")
    px4 = SimulatedPx4(airframe=airframe, seed=seed, noise=True)
    px4.start_in_air(HEIGHT_M)
    config = configuration(MANOEUVRE, ZERO3)
    parameters = OURS.parameters(config, airframe.hover_thrust)
    cockpit = Cockpit(InProcessAutopilot(px4), config, parameters, lambda: LoopAlarm(loop))
    tape = _Tape()
    tasks = asyncio.ensure_future(cockpit.run())
    try:
        await cockpit.airborne(HEIGHT_M)
        await cockpit.fly(MANOEUVRE, parameters, lambda: cockpit.listen(tape.on_tick))
    except (LinkError, NotPossibleError) as error:
        raise RuntimeError(f"the flight to measure on was lost: {error}") from None
    finally:
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)
    return tape.ticks
