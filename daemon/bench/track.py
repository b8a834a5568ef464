"""The tracking benchmark: the same manoeuvres, conditions and vehicle for every contestant, in virtual time."""

import asyncio
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from math import degrees

from daemon import frames
from daemon.autopilot.port import LinkError
from daemon.bench.cockpit import Cockpit, Flown
from daemon.bench.manoeuvres import Manoeuvre, rms
from daemon.bench.quantiles import quantile
from daemon.config import load
from daemon.control.parameters import mavros_controllers
from daemon.estimation.predictor import PredictorParameters
from daemon.loops.grid import LoopAlarm
from daemon.loops.turns import NotPossibleError
from daemon.messages import ZERO3, Odometry, Vec3
from daemon.parameters import geofence, pipeline_parameters
from daemon.pipeline import Parameters
from daemon.settings import Config
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.link_faults import LinkQuality
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual
from daemon.sim.wind import Gust

HEIGHT_M = 15.0
BEGIN_S = 5.0  # after the manoeuvre's beginning: when wind rises
WRONG_THRUST = 0.75
EXTRA_DELAY_S = 0.04
PAYLOAD_SHARE = 0.3
_KEPT_TRUTHS = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What is different from a calm day. ``before`` acts on the vehicle before the flight, ``later`` within it.

    ``thrust_share``: what the law believes of the hover thrust, of the true one.
    """

    name: str
    noise: bool = False
    before: Callable[[SimulatedPx4], None] = lambda _px4: None
    later: Callable[[SimulatedPx4], None] = lambda _px4: None
    thrust_share: float = 1.0


def _loaded(px4: SimulatedPx4) -> None:
    px4.payload_kg = PAYLOAD_SHARE * px4.airframe.mass_kg


def _delayed(px4: SimulatedPx4) -> None:
    px4.links["up"].quality = LinkQuality(delay_s=EXTRA_DELAY_S)


def _windy(px4: SimulatedPx4) -> None:
    px4.wind.steady_ned_m_s = (5.0, 0.0, 0.0)


def _gusty(px4: SimulatedPx4) -> None:
    px4.wind.steady_ned_m_s = (3.0, 0.0, 0.0)
    px4.wind.turbulence_m_s = 1.0
    px4.wind.gust(Gust((0.0, 5.0, 0.0), 4.0))


CONDITIONS = (
    Condition(name="calm"),
    Condition(name="noise", noise=True),
    Condition(name="wind", later=_windy),
    Condition(name="gusts", later=_gusty),
    Condition(name="payload", before=_loaded),
    Condition(name="thrust_wrong", thrust_share=WRONG_THRUST),
    Condition(name="delay", before=_delayed),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contestant:
    """A law under its name: the flow's parameters for a manoeuvre of a vehicle with a believed hover thrust.

    ``position_targets``: the law does not fly at all, the autopilot's own position controller does.
    """

    name: str
    parameters: Callable[[Config, float], Parameters]
    drag_known: bool = False
    position_targets: bool = False


def _ours(config: Config, hover_thrust: float) -> Parameters:
    return pipeline_parameters(config, geofence(config, (0.0, 0.0, 0.0)), hover_thrust)


def _mavros(config: Config, hover_thrust: float) -> Parameters:
    """The published law on the newest sample as it is: no prediction, no lead; the line of thrust off as the belief."""
    share = hover_thrust / load_airframe("sih").hover_thrust
    control = mavros_controllers()
    slope, offset = control.linear_thrust or (0.0, 0.0)
    return replace(
        _ours(config, hover_thrust),
        control=replace(control, linear_thrust=(slope * share, offset * share)),
        predictor=PredictorParameters(horizon_s=1e-9),
        command_latency_s=0.0,
    )


OURS = Contestant(name="flightd", parameters=_ours, drag_known=True)
OURS_BLIND = Contestant(name="flightd_no_drag", parameters=_ours)
MAVROS = Contestant(name="mavros", parameters=_mavros)
PX4 = Contestant(name="px4", parameters=_ours, position_targets=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The figures of one flight, metres and degrees; None where the manoeuvre has no such figure or nobody knows.

    ``after_wind_m`` is the largest error later than 6 s after the wind rose, ``settle_s`` the time after a step from
    which on the error stays below 5 % of it. Errors against the estimate and the truth are at the sample's own stamp.
    """

    manoeuvre: str
    condition: str
    contestant: str
    rms_m: float
    max_m: float
    true_rms_m: float | None
    true_max_m: float | None
    tilt_max_deg: float
    tilt_limit_deg: float
    height_change_m: float
    overshoot_pct: float | None
    settle_s: float | None
    after_wind_m: float | None
    step_p50_us: float
    lost: str | None
    path: tuple[tuple[float, float], ...] = ()  # north, east
    wanted: tuple[tuple[float, float], ...] = ()


def figures(manoeuvre: Manoeuvre, condition: Condition, contestant: Contestant, flown: Flown) -> Run:
    """What a flight amounts to."""
    counted = [s for s in flown.samples if s.time_s >= manoeuvre.run_in_s]
    errors = [frames.norm(frames.subtract(s.position_ned_m, s.reference_ned_m)) for s in counted]
    true = [
        frames.norm(frames.subtract(s.truth_ned_m, s.reference_ned_m)) for s in counted if s.truth_ned_m is not None
    ]
    best = true or errors
    late = [e for e, s in zip(best, counted, strict=True) if s.time_s > BEGIN_S + 6.0]
    windy = condition.name in ("wind", "gusts") and manoeuvre.name == "hover"
    start = counted[0].reference_ned_m[0] - manoeuvre.step_m if counted else 0.0
    north = [(s.truth_ned_m or s.position_ned_m)[0] - start for s in counted]
    stepped = manoeuvre.step_m > 0.0 and bool(north)
    return Run(
        manoeuvre=manoeuvre.name,
        condition=condition.name,
        contestant=contestant.name,
        rms_m=rms(errors),
        max_m=max(errors, default=float("nan")),
        true_rms_m=rms(true) if true else None,
        true_max_m=max(true) if true else None,
        tilt_max_deg=degrees(max((s.tilt_rad for s in flown.samples), default=float("nan"))),
        tilt_limit_deg=manoeuvre.tilt_max_deg,
        height_change_m=flown.height_change_m,
        overshoot_pct=100.0 * max(0.0, max(north) / manoeuvre.step_m - 1.0) if stepped else None,
        settle_s=_settled(manoeuvre, counted[-1].time_s, [s.time_s for s in counted], best) if stepped else None,
        after_wind_m=max(late, default=None) if windy else None,
        step_p50_us=1e6 * quantile(flown.step_s, 0.5) if flown.step_s else float("nan"),
        lost=flown.lost,
        path=tuple((s.position_ned_m[0], s.position_ned_m[1]) for s in counted[::5]),
        wanted=tuple((s.reference_ned_m[0], s.reference_ned_m[1]) for s in counted[::5]),
    )


def _settled(manoeuvre: Manoeuvre, end_s: float, times_s: list[float], errors_m: list[float]) -> float | None:
    outside = [t for t, e in zip(times_s, errors_m, strict=True) if e > 0.05 * manoeuvre.step_m]
    last_s = outside[-1] if outside else manoeuvre.step_at_s
    return last_s - manoeuvre.step_at_s if last_s < end_s - 0.5 else None


def programme(manoeuvres: Iterable[Manoeuvre], conditions: Iterable[Condition]) -> list[tuple[Manoeuvre, Condition]]:
    """Every manoeuvre on a calm day and with noise; the ones that tell most in the other conditions."""
    telling, everywhere = ("hover", "step_10m", "lemniscate_5"), ("calm", "noise")
    chosen = list(manoeuvres)
    return [(m, c) for c in conditions for m in chosen if c.name in everywhere or m.name in telling]


def simulated(
    flights: Iterable[tuple[Manoeuvre, Condition]],
    contestants: Iterable[Contestant] = (OURS, OURS_BLIND, MAVROS),
    *,
    seed: int = 1,
    airframe: str = "sih",
) -> Iterator[Run]:
    """Fly every contestant in every flight on a simulated PX4 of its own; yields the figures of each when done."""
    for manoeuvre, condition in flights:
        for contestant in contestants:
            flown = run_virtual(_flight(manoeuvre, condition, contestant, seed, airframe))
            yield figures(manoeuvre, condition, contestant, flown)


def configuration(manoeuvre: Manoeuvre, drag_1_s: Vec3) -> Config:
    """The default configuration with the manoeuvre's tilt limit and an airframe's drag; the fence is out of the way."""
    tilt = manoeuvre.tilt_max_deg
    return load(
        [],
        {
            "control": {"tilt_max_deg": tilt, "drag_1_s": list(drag_1_s)},
            "safety": {"tilt_max_deg": 120.0, "speed_max_m_s": 60.0, "fence": {"radius_m": 5000.0}},
        },
    )


class _Truths:
    """A simulated PX4 whose true positions can be asked for by stamp, in its own local frame."""

    def __init__(self, px4: SimulatedPx4) -> None:
        self._px4 = px4
        self._positions: dict[int, Vec3] = {}
        self.receive = px4.receive
        self.take_outgoing = px4.take_outgoing

    def step(self) -> None:
        """Advance 4 ms."""
        self._px4.step()
        self._positions[self._px4.time_us] = self._px4.truth.position_ned_m
        if len(self._positions) > _KEPT_TRUTHS:
            del self._positions[next(iter(self._positions))]

    def at(self, odometry: Odometry) -> Vec3 | None:
        """The truth at a sample's stamp."""
        position = self._positions.get(odometry.stamp_us)
        return position and frames.subtract(position, self._px4.estimator.origin_ned_m)

    def loop_time_s(self, odometry: Odometry) -> float:
        """The stamp on the loop's clock, exactly."""
        return asyncio.get_running_loop().time() + (odometry.stamp_us - self._px4.time_us) * 1e-6


async def _flight(
    manoeuvre: Manoeuvre, condition: Condition, contestant: Contestant, seed: int, airframe_name: str
) -> Flown:
    loop = asyncio.get_running_loop()
    airframe = load_airframe(airframe_name)
    px4 = SimulatedPx4(airframe=airframe, seed=seed, noise=condition.noise)
    condition.before(px4)
    px4.start_in_air(HEIGHT_M)
    truths = _Truths(px4)
    drag = tuple(d / airframe.mass_kg for d in airframe.drag_n_s_m) if contestant.drag_known else ZERO3
    config = configuration(manoeuvre, (drag[0], drag[1], drag[2]))
    parameters = contestant.parameters(config, airframe.hover_thrust * condition.thrust_share)
    cockpit = Cockpit(
        InProcessAutopilot(truths),
        config,
        parameters,
        lambda: LoopAlarm(loop),
        truth_at=truths.at,
        stamp_s=truths.loop_time_s,
    )
    tasks = asyncio.ensure_future(cockpit.run())
    try:
        await cockpit.airborne(HEIGHT_M)
        return await cockpit.fly(manoeuvre, parameters, lambda: _later(loop, condition, px4))
    except (LinkError, NotPossibleError) as error:
        return Flown(lost=str(error))
    finally:
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)


def _later(loop: asyncio.AbstractEventLoop, condition: Condition, px4: SimulatedPx4) -> None:
    loop.call_later(BEGIN_S, condition.later, px4)
