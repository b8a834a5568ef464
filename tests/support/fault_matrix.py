"""One fault in a flight: what is expected of the daemon, what it did, and what must hold in any case."""

from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from itertools import pairwise
from math import degrees, hypot, radians
from typing import Any
from unittest import mock

from daemon import frames
from daemon.config import load
from daemon.loops.goal_book import GoalEntry
from daemon.messages import FlightMode, Setpoint
from daemon.pipeline import Inputs, Record
from daemon.realtime import preload
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import Fault
from support import blocking_calls
from support.flight import Flight, fly

GOAL_NED_M = (40.0, 0.0, -12.0)
HEIGHT_M = 5.0
SPEED_M_S = 5.0
TILT_SLACK_DEG = 3.0
WATCHDOG_S = 1.0  # WatchdogSec of the unit

Deed = Callable[[Flight, ExitStack], Coroutine[Any, Any, None] | None]


class Start(Enum):
    """What the vehicle does when the fault strikes."""

    FLYING = "flies north at 5 m/s towards its goal"
    CIRCLING = "flies a circle of 6 m radius at 4 m/s"
    HOVERING = "hovers at its goal"
    IN_HOLD = "is in the autopilot's Hold, and is then given a goal"
    ON_GROUND = "stands on the ground"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A fault, and the response that is expected.

    ``state``, ``left`` and ``mode`` are of the end; ``asked`` are the modes that the daemon asked for since, each once.
    ``silent_s`` and ``hold_s`` bound the time to the last setpoint and to the autopilot's Hold; None: flies on.
    ``outcome`` is the goal's, empty when it has none; ``inside_m`` bounds the distance from home; ``ends``: the daemon
    ends with an error; ``starves``: systemd's watchdog hears nothing any more. ``words`` say what the rest does not.
    """

    name: str
    faults: tuple[Fault, ...] = ()
    do: Deed | None = None
    start: Start = Start.FLYING
    goal_ned_m: tuple[float, float, float] = GOAL_NED_M
    hold_s: float | None = None
    strikes_at_m: float = 8.0
    state: State = State.HOLDING
    left: str = ""
    mode: FlightMode = FlightMode.OFFBOARD
    asked: tuple[FlightMode, ...] = ()
    outcome: str = "succeeded"
    silent_s: float | None = None
    tilt_deg: float = 35.0
    inside_m: float | None = None
    ends: bool = False
    starves: bool = False
    watch_s: float = 6.0
    stays_s: float = 0.0
    timeout_s: float | None = None
    config: dict[str, Any] = field(default_factory=dict)
    words: str = ""

    @property
    def sentence(self) -> str:
        """The expected response in words."""
        if self.words:
            return self.words
        if self.silent_s is None:
            return "flies on, the goal succeeds"
        hold = "" if self.hold_s is None else f", Hold within {self.hold_s:g} s"
        return f"`{self.left}`, silent within {self.silent_s:g} s{hold}"


@dataclass
class Seen:
    """What was measured; times are seconds after the fault, tilt is the true vehicle's until it is flown by others."""

    silent_s: float | None
    hold_s: float | None
    tilt_deg: float
    state: State
    left: str
    mode: FlightMode
    asked: tuple[FlightMode, ...]
    ended: list[GoalEntry]
    reach_m: float
    ends: bool
    starves: bool
    faults: list[str]


class _Witness:
    """Looks at the autopilot and the true vehicle every 4 ms, at each command, and at what systemd hears."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.ticks: list[tuple[float, FlightMode, float, bool]] = []
        self.fed_s: list[float] = []
        self.commanded_rad = 0.0
        self.reach_m = 0.0
        self.struck_s = 0.0
        self.asked_before = 0
        self.waits = blocking_calls.begin()
        self._step = flight.px4.step
        flight.px4.step = self._stepped  # type: ignore[method-assign]
        flight.vehicle.control.listeners.append(self._on_tick)

    def strikes(self) -> None:
        """From now on."""
        self.struck_s, self.asked_before = self.flight.now_s, len(self.flight.asked)

    def notified(self, message: str) -> bool:
        """What is said to systemd."""
        if message == "WATCHDOG=1":
            self.fed_s.append(self.flight.now_s)
        return True

    def _stepped(self) -> None:
        self._step()
        px4 = self.flight.px4
        self.reach_m = max(self.reach_m, hypot(*px4.truth.position_ned_m[:2]))
        in_offboard = px4.mode is FlightMode.OFFBOARD and px4.armed
        self.ticks.append((self.flight.now_s, px4.mode, frames.tilt_of(px4.truth.attitude_wb), in_offboard))

    def _on_tick(self, _inputs: Inputs, record: Record) -> None:
        if record.control is not None:
            self.commanded_rad = max(self.commanded_rad, frames.tilt_of(record.control.desired_wb))

    def seen(self, ends: bool) -> Seen:
        """The measurements."""
        flight, struck_s, end_s = self.flight, self.struck_s, self.ticks[-1][0]
        ours = flight.state in OURS and not ends
        last_s = flight.sent[-1][0] if flight.sent else struck_s
        flown_s = end_s if ours else max(last_s, struck_s)
        since = [tick for tick in self.ticks if tick[0] >= struck_s - 0.02]
        tilts = [tilt for t, _, tilt, in_offboard in since if t <= flown_s or in_offboard]
        return Seen(
            silent_s=None if ours else max(0.0, last_s - struck_s),
            hold_s=next((t - struck_s for t, m, *_ in self.ticks if t >= struck_s and m is FlightMode.HOLD), None),
            tilt_deg=degrees(max(tilts)),
            state=flight.state,
            left=flight.records[-1].supervision.left,
            mode=flight.px4.mode,
            asked=tuple(dict.fromkeys(mode for _, mode in flight.asked[self.asked_before :])),
            ended=flight.ended,
            reach_m=self.reach_m,
            ends=ends,
            starves=largest_gap_s([*self.fed_s, end_s]) > WATCHDOG_S,
            faults=[*broken_limits(flight.sent), *_broken_rules(flight, self.commanded_rad), *self.waits],
        )


def strike(case: Case, *, noise: bool = True, seed: int = 1) -> Seen:
    """Fly the case and measure."""
    witnesses: list[_Witness] = []

    async def scenario(flight: Flight) -> None:
        witness = _Witness(flight)
        witnesses.append(witness)
        with ExitStack() as stack:
            stack.enter_context(mock.patch("daemon.loops.health_task.notify", witness.notified))
            await _fly(case, flight, witness, stack)

    ends = False
    preload()
    try:
        fly(scenario, seed=seed, noise=noise, config=case.config)
    except ExceptionGroup:
        if not case.ends:
            raise
        ends = True
    finally:
        blocking_calls.end()
    return witnesses[0].seen(ends)


async def _fly(case: Case, flight: Flight, witness: _Witness, stack: ExitStack) -> None:
    goal_id: str | None = None
    waypoint: dict[str, Any] = {"position": list(case.goal_ned_m), "hold_s": case.stays_s}
    submit = partial(flight.submit, waypoint=waypoint, timeout_s=case.timeout_s)
    if case.start is Start.ON_GROUND:
        await flight.until(lambda: flight.state is State.STANDBY and flight.records[-1].estimate.newest is not None)
    else:
        await flight.airborne(HEIGHT_M, engage=case.start is not Start.IN_HOLD)
    if case.start is Start.FLYING:
        goal_id = await submit()
        await flight.until(lambda: flight.position[0] > case.strikes_at_m)
    elif case.start is Start.CIRCLING:
        circle = {"kind": "circle", "center": [0.0, 0.0, -HEIGHT_M], "radius_m": 6.0, "speed_m_s": 4.0, "turns": 20}
        goal_id = await flight.submit(trajectory=circle)
        circling_s = flight.now_s + 8.0
        await flight.until(lambda: flight.now_s > circling_s)
    elif case.start is Start.HOVERING:
        goal_id = await submit()
        await flight.until(lambda: flight.state is State.TRACKING)
    witness.strikes()
    for fault in case.faults:
        flight.px4.inject(fault)
    doing = None if case.do is None else case.do(flight, stack)
    if doing is not None:
        await doing
    if case.start is Start.IN_HOLD:
        goal_id = await submit()
    await flight.until(lambda: flight.now_s - witness.struck_s > case.watch_s)
    if goal_id is not None and case.outcome:
        await flight.result(goal_id)


def largest_gap_s(times_s: list[float]) -> float:
    """The longest time between two of them."""
    return max((b - a for a, b in pairwise(times_s)), default=0.0)


def broken_limits(sent: list[tuple[float, Setpoint]]) -> list[str]:
    """Setpoints that are not within the limits of rates and thrust, in words."""
    control = load([]).control
    broken = []
    for time_s, setpoint in sent:
        roll, pitch, yaw = setpoint.rates_frd_rad_s
        if not hypot(roll, pitch) <= radians(control.rate_max_deg_s) * 1.0001:
            broken.append(f"{time_s:.2f} s: rates {setpoint.rates_frd_rad_s}")
        if not abs(yaw) <= radians(control.yaw_rate_max_deg_s) * 1.0001:
            broken.append(f"{time_s:.2f} s: yaw rate {yaw}")
        if not control.thrust_min - 1e-6 <= setpoint.thrust <= control.thrust_max + 1e-6:
            broken.append(f"{time_s:.2f} s: thrust {setpoint.thrust}")
    return broken


def _broken_rules(flight: Flight, commanded_rad: float) -> list[str]:
    """What must hold whatever happens: the limit of the commanded tilt, one result a goal."""
    broken = []
    if not commanded_rad <= radians(load([]).control.tilt_max_deg) * 1.0001:
        broken.append(f"commanded tilt {degrees(commanded_rad):.1f} deg")
    ids = [entry.goal_id for entry in flight.ended]
    if len(set(ids)) != len(ids):
        broken.append(f"a goal ended twice: {ids}")
    return broken


def differences(case: Case, seen: Seen) -> list[str]:
    """Where the response is not the expected one, in words."""
    wrong = list(seen.faults)
    for name in ("state", "left", "mode", "asked", "ends", "starves"):
        if getattr(seen, name) != getattr(case, name):
            wrong.append(f"{name} is {getattr(seen, name)}, expected {getattr(case, name)}")
    if [entry.outcome for entry in seen.ended] != [case.outcome] * bool(case.outcome):
        wrong.append(f"goals ended {seen.ended}, expected {case.outcome}")
    for name in ("silent_s", "hold_s"):
        value, bound = getattr(seen, name), getattr(case, name)
        if (value is None) != (bound is None) or (bound is not None and value > bound):
            wrong.append(f"{name} is {value}, expected within {bound}")
    if seen.tilt_deg > case.tilt_deg + TILT_SLACK_DEG:
        wrong.append(f"tilt {seen.tilt_deg:.1f} deg, expected within {case.tilt_deg:g}")
    if case.inside_m is not None and seen.reach_m > case.inside_m:
        wrong.append(f"{seen.reach_m:.1f} m from home, expected within {case.inside_m:g}")
    return wrong
