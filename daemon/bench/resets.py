"""Resets of the autopilot's estimate in flight: how far the vehicle departs from its twin without a reset.

Twins fly the same seed on simulated PX4s of their own. Beside the daemon's law flies that of mavros_controllers as it
is published, which knows nothing of resets: to it a reset is an error of the position, of the velocity, of the heading.
"""

import asyncio
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from math import degrees, dist, inf
from typing import Any

from daemon.autopilot.port import LinkError
from daemon.autopilot.px4 import Fields, Message
from daemon.bench.cockpit import Cockpit
from daemon.bench.manoeuvres import RAMP_S, Manoeuvre, hover, leg
from daemon.bench.track import MAVROS, OURS, Contestant, configuration
from daemon.estimation.reset_tracker import ResetParameters
from daemon.frames import angle_between, tilt_of
from daemon.loops.grid import LoopAlarm
from daemon.loops.turns import NotPossibleError
from daemon.messages import ZERO3, Quat, Vec3
from daemon.pipeline import Parameters
from daemon.settings import Config
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.faults import EkfReset
from daemon.sim.in_process import InProcessAutopilot
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual

HEIGHT_M = 15.0
AFTER_S = 4.0
_BEGIN_S = RAMP_S + 2.0  # of the manoeuvre until the reset
_SOON_S = 2.0
_DURATION_S = _BEGIN_S + AFTER_S + 0.5
HOVER = replace(hover(), duration_s=_DURATION_S)
LEG = leg(2.0, _DURATION_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A reset in a flight, and what of the departure is bounded: metres within ``AFTER_S`` or 2 s, degrees."""

    name: str
    reset: EkfReset
    flight: Manoeuvre = HOVER
    bound_m: float | None = None
    bound_2s_m: float | None = None
    bound_deg: float | None = None


def _cases() -> Iterator[Case]:
    for name, reset in (
        ("position 3 m", EkfReset(kind="position_ne", size_m=3.0)),
        ("position 11 m", EkfReset(kind="position_ne", size_m=11.0)),
        ("height 2 m", EkfReset(kind="position_d", size_m=2.0)),
    ):
        for flight in (HOVER, LEG):
            yield Case(name=name, reset=reset, flight=flight, bound_m=0.15, bound_deg=2.0)
    yield Case(name="velocity 1 m/s", reset=EkfReset(kind="velocity_ne", size_m_s=1.0), bound_2s_m=0.3)
    yield Case(name="heading 30 deg", reset=EkfReset(kind="heading", size_deg=30.0), bound_2s_m=0.3)


CASES = tuple(_cases())


def _unaware(config: Config, hover_thrust: float) -> Parameters:
    """Every reset passes as if it were motion."""
    parameters = MAVROS.parameters(config, hover_thrust)
    blind = ResetParameters(position_noise_m=inf, velocity_noise_m_s=inf, yaw_noise_rad=inf)
    return replace(parameters, estimator=replace(parameters.estimator, reset=blind))


CONTESTANTS = (OURS, Contestant(name="mavros", parameters=_unaware))


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """The departure from the twin: largest within ``AFTER_S``, largest within 2 s, of the attitude; the largest tilt.

    ``kept``: within the case's bounds. ``lost``: why the flight ended early.
    """

    reset: str
    flight: str
    contestant: str
    seed: int
    departure_m: float
    departure_2s_m: float
    attitude_deg: float
    tilt_deg: float
    kept: bool
    lost: str | None


@dataclass(slots=True)
class _Flown:
    path: list[tuple[float, Vec3, Quat]] = field(default_factory=list)
    lost: str | None = None


class _Watched:
    """A simulated PX4 whose truth is noted from a moment on."""

    def __init__(self, px4: SimulatedPx4) -> None:
        self._px4 = px4
        self._since_us: int | None = None
        self.path: list[tuple[float, Vec3, Quat]] = []

    def receive(self, name: str, fields: Fields, *, sender_system: int = 1, sender_component: int = 195) -> None:
        """Take a message."""
        self._px4.receive(name, fields, sender_system=sender_system, sender_component=sender_component)

    def take_outgoing(self) -> list[Message]:
        """Messages sent."""
        return self._px4.take_outgoing()

    def begin(self, reset: EkfReset | None) -> None:
        """Reset the estimate, if this is not the twin."""
        self._since_us = self._px4.simulated_us
        if reset is not None:
            self._px4.inject(reset)

    def step(self) -> None:
        """Advance 4 ms."""
        self._px4.step()
        if self._since_us is not None:
            truth, time_s = self._px4.truth, (self._px4.simulated_us - self._since_us) * 1e-6
            if time_s <= AFTER_S:
                self.path.append((time_s, truth.position_ned_m, truth.attitude_wb))


def flown(
    cases: Iterable[Case] = CASES, contestants: Iterable[Contestant] = CONTESTANTS, *, seed: int = 3
) -> Iterator[Figures]:
    """Fly every case with every contestant; yields the figures of each when done."""
    twins: dict[tuple[str, str], _Flown] = {}
    for case in cases:
        for contestant in contestants:
            key = (case.flight.name, contestant.name)
            if key not in twins:
                twins[key] = run_virtual(_flight(case.flight, None, contestant, seed))
            struck = run_virtual(_flight(case.flight, case.reset, contestant, seed))
            yield compared(case, contestant.name, seed, struck, twins[key])


def compared(case: Case, contestant: str, seed: int, struck: _Flown, twin: _Flown) -> Figures:
    """The figures of a flight beside its twin."""
    pairs = list(zip(struck.path, twin.path, strict=False))
    apart = [(a[0], dist(a[1], b[1])) for a, b in pairs]
    farthest = max((metres for _, metres in apart), default=inf)
    soon = max((metres for time_s, metres in apart if time_s <= _SOON_S), default=inf)
    turned = degrees(max((angle_between(a[2], b[2]) for a, b in pairs), default=inf))
    lost = struck.lost or twin.lost
    return Figures(
        reset=case.name,
        flight=case.flight.name,
        contestant=contestant,
        seed=seed,
        departure_m=farthest,
        departure_2s_m=soon,
        attitude_deg=turned,
        tilt_deg=degrees(max((tilt_of(attitude) for _, _, attitude in struck.path), default=inf)),
        kept=lost is None
        and farthest <= (case.bound_m or inf)
        and soon <= (case.bound_2s_m or inf)
        and turned <= (case.bound_deg or inf),
        lost=lost,
    )


async def _flight(manoeuvre: Manoeuvre, reset: EkfReset | None, contestant: Contestant, seed: int) -> _Flown:
    loop = asyncio.get_running_loop()
    airframe = load_airframe("sih")
    px4 = SimulatedPx4(airframe=airframe, seed=seed, noise=True)
    px4.start_in_air(HEIGHT_M)
    watched = _Watched(px4)
    drag = tuple(d / airframe.mass_kg for d in airframe.drag_n_s_m) if contestant.drag_known else ZERO3
    config = configuration(manoeuvre, (drag[0], drag[1], drag[2]))
    parameters = contestant.parameters(config, airframe.hover_thrust)
    cockpit = Cockpit(InProcessAutopilot(watched), config, parameters, lambda: LoopAlarm(loop))
    tasks = asyncio.ensure_future(cockpit.run())
    lost: str | None = None
    try:
        await cockpit.airborne(HEIGHT_M)
        lost = (await cockpit.fly(manoeuvre, parameters, lambda: _later(loop, watched, reset))).lost
    except (LinkError, NotPossibleError) as error:
        lost = str(error)
    finally:
        tasks.cancel()
        await asyncio.gather(tasks, return_exceptions=True)
    return _Flown(watched.path, lost)


def _later(loop: asyncio.AbstractEventLoop, watched: _Watched, reset: EkfReset | None) -> None:
    loop.call_later(_BEGIN_S, watched.begin, reset)


_HEADER = ("reset", "flight", "contestant", "departs m", "in 2 s", "attitude deg", "tilt deg", "remarks")


def table(figures: Iterable[Figures]) -> str:
    """Lines of equal columns."""
    rows = [_HEADER, *(_row(one) for one in figures)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def _row(one: Figures) -> tuple[str, ...]:
    numbers = (f"{one.departure_m:.3f}", f"{one.departure_2s_m:.3f}", f"{one.attitude_deg:.1f}", f"{one.tilt_deg:.1f}")
    remark = f"LOST: {one.lost}" if one.lost else "" if one.kept else "beyond the bound"
    return (one.reset, one.flight, one.contestant, *numbers, remark)


def as_json(figures: Iterable[Figures]) -> list[dict[str, Any]]:
    """One object a flight."""
    return [{k: round(v, 4) if isinstance(v, float) else v for k, v in asdict(one).items()} for one in figures]
