"""One fault in a flight to a goal: what is expected of the daemon, what it did, and what must hold in any case."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, hypot, radians
from typing import Any

from daemon import frames
from daemon.config import load
from daemon.loops.goal_book import GoalEntry
from daemon.messages import FlightMode
from daemon.pipeline import Inputs, Record
from daemon.safety.supervisor import OURS, State
from daemon.sim.faults import Fault
from support.flight import Flight, fly

GOAL_NED_M = (40.0, 0.0, -12.0)
STRUCK_AT_M = 8.0
SPEED_M_S = 5.0
TILT_SLACK_DEG = 3.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """A fault that strikes a vehicle on its way north at 5 m/s, and the response that is expected.

    ``state``, ``left`` and ``mode`` are of the end; ``asked`` are the modes that the daemon asked for since, each once.
    ``silent_s`` and ``hold_s`` bound the time to the last setpoint and to the autopilot's Hold; None: flies on.
    """

    name: str
    faults: tuple[Fault, ...] = ()
    do: Callable[[Flight], Any] | None = None
    state: State = State.HOLDING
    left: str = ""
    mode: FlightMode = FlightMode.OFFBOARD
    asked: tuple[FlightMode, ...] = ()
    outcome: str = "succeeded"
    silent_s: float | None = None
    hold_s: float | None = None
    tilt_deg: float = 35.0
    watch_s: float = 6.0
    timeout_s: float | None = None
    config: dict[str, Any] = field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """The expected response in words."""
        if self.silent_s is None:
            return "flies on, the goal succeeds"
        hold = "" if self.hold_s is None else f", Hold within {self.hold_s:g} s"
        return f"`{self.left}`, silent within {self.silent_s:g} s{hold}"


@dataclass
class Seen:
    """What was measured; times are seconds after the fault, tilt is the true vehicle's while it was flown by us."""

    silent_s: float | None
    hold_s: float | None
    tilt_deg: float
    state: State
    left: str
    mode: FlightMode
    asked: tuple[FlightMode, ...]
    ended: list[GoalEntry]
    faults: list[str]

    @property
    def goal(self) -> GoalEntry:
        """The goal that was flown."""
        return self.ended[0]


class _Witness:
    """Looks at the autopilot and the true vehicle at each control tick."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self.ticks: list[tuple[float, FlightMode, float]] = []
        self.commanded_rad = 0.0

    def __call__(self, _inputs: Inputs, record: Record) -> None:
        px4 = self._flight.px4
        self.ticks.append((record.now_s, px4.mode, frames.tilt_of(px4.truth.attitude_wb)))
        if record.control is not None:
            self.commanded_rad = max(self.commanded_rad, frames.tilt_of(record.control.desired_wb))


def strike(case: Case, *, noise: bool = True, seed: int = 1) -> Seen:
    """Fly the case and measure."""

    async def scenario(flight: Flight) -> Seen:
        await flight.airborne(5.0)
        witness = _Witness(flight)
        flight.vehicle.control.listeners.append(witness)
        goal_id = await flight.submit(waypoint={"position": list(GOAL_NED_M)}, timeout_s=case.timeout_s)
        await flight.until(lambda: flight.position[0] > STRUCK_AT_M)
        struck_s, asked = flight.now_s, len(flight.asked)
        for fault in case.faults:
            flight.px4.inject(fault)
        if case.do is not None:
            case.do(flight)
        await flight.until(lambda: flight.now_s - struck_s > case.watch_s)
        await flight.result(goal_id)
        last_s = flight.sent[-1][0]
        ours_until_s = flight.now_s if flight.state in OURS else last_s
        return Seen(
            silent_s=None if flight.state in OURS else max(0.0, last_s - struck_s),
            hold_s=next((t - struck_s for t, m, _ in witness.ticks if t >= struck_s and m is FlightMode.HOLD), None),
            tilt_deg=degrees(max(tilt for t, _, tilt in witness.ticks if struck_s - 0.02 <= t <= ours_until_s)),
            state=flight.state,
            left=flight.records[-1].supervision.left,
            mode=flight.px4.mode,
            asked=tuple(dict.fromkeys(mode for _, mode in flight.asked[asked:])),
            ended=flight.ended,
            faults=_broken_rules(flight, witness),
        )

    return fly(scenario, seed=seed, noise=noise, config=case.config)


def _broken_rules(flight: Flight, witness: _Witness) -> list[str]:
    """What must hold whatever happens: limits of every setpoint and of the commanded tilt, one result a goal."""
    control = load([]).control
    broken = []
    for time_s, setpoint in flight.sent:
        roll, pitch, yaw = setpoint.rates_frd_rad_s
        if not hypot(roll, pitch) <= radians(control.rate_max_deg_s) * 1.0001:
            broken.append(f"{time_s:.2f} s: rates {setpoint.rates_frd_rad_s}")
        if not abs(yaw) <= radians(control.yaw_rate_max_deg_s) * 1.0001:
            broken.append(f"{time_s:.2f} s: yaw rate {yaw}")
        if not control.thrust_min - 1e-9 <= setpoint.thrust <= control.thrust_max + 1e-9:
            broken.append(f"{time_s:.2f} s: thrust {setpoint.thrust}")
    if not witness.commanded_rad <= radians(control.tilt_max_deg) * 1.0001:
        broken.append(f"commanded tilt {degrees(witness.commanded_rad):.1f} deg")
    ids = [entry.goal_id for entry in flight.ended]
    if len(set(ids)) != len(ids):
        broken.append(f"a goal ended twice: {ids}")
    return broken


def differences(case: Case, seen: Seen) -> list[str]:
    """Where the response is not the expected one, in words."""
    wrong = list(seen.faults)
    for name in ("state", "left", "mode", "asked"):
        if getattr(seen, name) != getattr(case, name):
            wrong.append(f"{name} is {getattr(seen, name)}, expected {getattr(case, name)}")
    if [entry.outcome for entry in seen.ended] != [case.outcome]:
        wrong.append(f"goals ended {seen.ended}, expected {case.outcome}")
    for name in ("silent_s", "hold_s"):
        value, bound = getattr(seen, name), getattr(case, name)
        if (value is None) != (bound is None) or (bound is not None and value > bound):
            wrong.append(f"{name} is {value}, expected within {bound}")
    if seen.tilt_deg > case.tilt_deg + TILT_SLACK_DEG:
        wrong.append(f"tilt {seen.tilt_deg:.1f} deg, expected within {case.tilt_deg:g}")
    return wrong
