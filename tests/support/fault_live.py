"""One fault in a flight of the whole process over real MAVSDK: what is expected, what was seen, what must hold."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError
from daemon.goals.goal import Goal
from daemon.messages import FlightMode
from support.air import HEIGHT_M, PATIENCE_S, Air, LogPipe, Systemd, air, state_of, take
from support.fault_matrix import WATCHDOG_S, broken_limits, largest_gap_s
from support.processes import Child, troubled_daemon
from support.standstill import StoodStillError, where_it_runs

SPEED_M_S = 3.0
FLIES_S = 0.3  # a setpoint as new as this: the daemon flies


@dataclass(frozen=True, kw_only=True)
class LiveCase:
    """A fault that strikes a vehicle on its way to a goal 40 m away, and the response that is expected.

    ``exits`` is the code with which the process ends; ``says`` are events of its log; bounds as those of ``Case``,
    None: not looked at. Where ``modes`` is offboard alone the vehicle is flown to the end.
    """

    name: str
    words: str
    do: Callable[[Scene], Awaitable[None]]
    trouble: str = ""
    block_s: float = 0.0
    pipe: bool = False
    states: tuple[str, ...] = ("holding",)
    modes: tuple[FlightMode, ...] = (FlightMode.OFFBOARD,)
    outcomes: tuple[str, ...] = ("succeeded",)
    silent_s: float | None = None
    hold_s: float | None = None
    tilt_deg: float = 45.0
    starves: bool = False
    exits: int | None = None
    says: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The expected response in words."""
        return self.words


@dataclass
class LiveSeen:
    """What was measured; times are seconds after the fault, of the autopilot's clock."""

    silent_s: float | None
    hold_s: float | None
    tilt_deg: float
    state: str
    mode: FlightMode
    outcome: str
    starves: bool
    exits: int | None
    events: list[str]
    faults: list[str]


class _Client(FlightClient):
    """Counts results."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, reconnect_s=1.0)
        self.results: Counter[str] = Counter()

    def _take(self, method: str, params: dict[str, Any]) -> None:
        if method == "goal.result":
            self.results[params["goal_id"]] += 1
        super()._take(method, params)


@dataclass
class Scene:
    """What a row works with; ``look`` notes how things are, for rows that go on after it."""

    case: LiveCase
    air: Air
    child: Child
    flight: _Client
    goal: Goal
    systemd: Systemd
    config: Path
    pipe: LogPipe | None
    struck_s: float
    seen: LiveSeen | None = None

    def signal(self, number: int) -> None:
        """Send a signal to the daemon."""
        self.child.process.send_signal(number)

    async def goal_ends(self) -> None:
        """Wait for the goal's result."""
        async with asyncio.timeout(PATIENCE_S):
            await self.goal.result()
        await self.air.passes(0.3)

    async def look(self) -> None:
        """Note how things are now."""
        exits, case = self.child.process.returncode, self.case
        end_s = self.air.now_s
        outcome = await self._outcome()
        state = "-" if exits is not None else await state_of(self.child)
        last_s = self.air.sent[-1][0]
        flown = end_s - last_s < FLIES_S
        fed_s = [t for t in self.systemd.fed_s if t <= end_s]
        ticks = [tick for tick in self.air.ticks if tick[0] >= self.struck_s]
        faults = broken_limits(self.air.sent)
        if any(count != 1 for count in self.flight.results.values()):
            faults.append(f"results: {self.flight.results}")
        self.seen = LiveSeen(
            silent_s=None if flown else max(0.0, last_s - self.struck_s),
            hold_s=next((t - self.struck_s for t, mode, _ in ticks if mode is FlightMode.HOLD), None),
            tilt_deg=max(tilt for _, mode, tilt in ticks if mode is FlightMode.OFFBOARD),
            state=state,
            mode=self.air.px4.mode,
            outcome=outcome,
            starves=largest_gap_s([*fed_s, end_s] if exits is None else fed_s) > WATCHDOG_S,
            exits=exits if case.exits is not None else None,
            events=[],
            faults=faults,
        )

    async def _outcome(self) -> str:
        try:
            result = await asyncio.wait_for(self.goal.result(), 3.0)
        except (FlightError, TimeoutError):
            return "-"
        return ", ".join(filter(None, (result.outcome, result.reason)))


async def strike_live(case: LiveCase, folder: Path) -> LiveSeen:
    """Fly the case in real time and measure, on a machine that runs."""

    async def strike(own: Path) -> LiveSeen:
        seen = await _strike(case, own)
        if not seen.faults and "aborted" not in case.outcomes and "control_stalled" in seen.outcome:
            raise StoodStillError
        return seen

    return await where_it_runs(strike, folder, lambda seen: not seen.faults and live_differences(case, seen))


async def _strike(case: LiveCase, folder: Path) -> LiveSeen:
    config = folder / "flightd.yaml"
    config.write_text("guidance: {limits: {speed_m_s: 5.0}}\n")
    async with AsyncExitStack() as stack:
        seen = await stack.enter_async_context(air())
        systemd = Systemd(folder / "notify", lambda: seen.now_s)
        stack.callback(systemd.close)
        environ = {"NOTIFY_SOCKET": str(systemd.path)}
        pipe = LogPipe() if case.pipe else None
        child = await stack.enter_async_context(
            troubled_daemon(
                folder, seen.connection, case.trouble, block_s=case.block_s, config=config, environ=environ,
                stderr=None if pipe is None else pipe.write_end,
            )
        )  # fmt: skip
        if pipe is not None:
            stack.callback(pipe.close)
        assert child.socket is not None
        flight = await stack.enter_async_context(_Client(child.socket))
        await take(flight, seen)
        goal = await flight.goto(40.0, 0.0, -HEIGHT_M)
        await seen.until(lambda: seen.px4.truth.velocity_ned_m_s[0] > SPEED_M_S)
        scene = Scene(case, seen, child, flight, goal, systemd, config, pipe, seen.now_s)
        await case.do(scene)
        if scene.seen is None:
            await scene.look()
        assert scene.seen is not None
        if pipe is not None:
            pipe.reads(child.log_file)
        if scene.child.process.returncode is None:
            await scene.child.stop()
            await asyncio.sleep(0.1)
    events = child.events()
    scene.seen.events = [str(event.get("event")) for event in events]
    scene.seen.faults += [str(event["call"]) for event in events if event.get("event") == "blocking_call"]
    return scene.seen


def live_differences(case: LiveCase, seen: LiveSeen) -> list[str]:
    """Where the response is not the expected one, in words."""
    wrong = list(seen.faults)
    for name, allowed in (("state", case.states), ("mode", case.modes)):
        if getattr(seen, name) not in allowed:
            wrong.append(f"{name} is {getattr(seen, name)}, expected {allowed}")
    if seen.outcome.partition(",")[0] not in case.outcomes:
        wrong.append(f"the goal ended {seen.outcome}, expected {case.outcomes}")
    for name in ("starves", "exits"):
        if getattr(seen, name) != getattr(case, name):
            wrong.append(f"{name} is {getattr(seen, name)}, expected {getattr(case, name)}")
    for name in ("silent_s", "hold_s"):
        value, bound = getattr(seen, name), getattr(case, name)
        if bound is not None and (value is None or value > bound):
            wrong.append(f"{name} is {value}, expected within {bound}")
    if seen.silent_s is not None and case.modes == (FlightMode.OFFBOARD,):
        wrong.append(f"silent after {seen.silent_s:.2f} s")
    if seen.tilt_deg > case.tilt_deg:
        wrong.append(f"tilt {seen.tilt_deg:.1f} deg, expected within {case.tilt_deg:g}")
    return wrong + [f"{event} was not logged" for event in case.says if event not in seen.events]
