"""Vehicle requests with a scripted autopilot and supervisor, in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest

from daemon.autopilot.port import Command, CommandKind
from daemon.latest import Latest
from daemon.loops.asking import CommandTimeouts
from daemon.loops.commander import Commander
from daemon.loops.turns import NotPossibleError
from daemon.messages import (
    IDENTITY,
    ZERO3,
    AutopilotStatus,
    ClockSync,
    EstimatedState,
    FlightMode,
    GlobalPosition,
    RequestKind,
    Setpoint,
    VehicleRequest,
)
from daemon.pipeline import Record
from daemon.safety.dead_man import SetpointGate
from daemon.safety.supervisor import State
from daemon.sim.virtual_time import run_virtual
from support.statuses import IN_HOLD, ON_GROUND
from support.trajectory_rig import NOTHING

PLACE = GlobalPosition(47.0, 8.0, 500.0)
GROUND = replace(ON_GROUND, global_position=PLACE)
AIR = replace(IN_HOLD, global_position=PLACE)
AT_TEN_METRES = EstimatedState(0.0, (0.0, 0.0, -10.0), ZERO3, IDENTITY, ZERO3)
TIMEOUTS = CommandTimeouts()


class Vehicle:
    """Autopilot and supervisor in one: answers by ``script``, which is called with each command and request."""

    def __init__(self, status: AutopilotStatus, state: State) -> None:
        self.status: Latest[AutopilotStatus] = Latest(status)
        self.record: Latest[Record | None] = Latest(None)
        self.request: Latest[VehicleRequest | None] = Latest(None)
        self.clock: Latest[ClockSync | None] = Latest(None)
        self.seen = self.withdrawn = 0
        self.reads = True
        self.asked: list[CommandKind | RequestKind] = []
        self.altitude_amsl_m: float | None = None
        self.script: Callable[[CommandKind | RequestKind], None] = lambda _asked: None
        self.gate = SetpointGate(self, lambda: 0.0)
        self.commander = Commander(
            self,  # type: ignore[arg-type]
            self.gate,
            self.record,
            self.request,
            TIMEOUTS,
            list,
        )
        self.set(state)

    def set(self, state: State, reason: str = "requested", **status: Any) -> None:
        """What telemetry and the supervisor show from now on."""
        self.status.set(replace(self.status.value, **status))
        conditions = replace(NOTHING.conditions, state_usable=True, estimate_poor=False)
        supervision = replace(NOTHING.supervision, state=state, reason=reason, serial=self.seen)
        estimate = replace(NOTHING.estimate, newest=AT_TEN_METRES)
        self.record.set(replace(NOTHING, supervision=supervision, conditions=conditions, estimate=estimate))

    def later(self, delay_s: float, state: State, reason: str = "requested", **status: Any) -> None:
        asyncio.get_running_loop().call_later(delay_s, lambda: self.set(state, reason, **status))

    def see(self, **conditions: bool) -> None:
        record = self.record.value
        assert record is not None
        self.record.set(replace(record, conditions=replace(record.conditions, **conditions)))

    async def command(self, command: Command, timeout_s: float) -> None:
        assert timeout_s == TIMEOUTS.acknowledge_s
        self.altitude_amsl_m = command.altitude_amsl_m
        self._tell(command.kind)

    def withdraw_commands(self) -> None:
        self.withdrawn += 1

    async def watch(self) -> None:
        """The supervisor, which takes each request once, as long as it ``reads``."""
        while True:
            request, record = self.request.value, self.record.value
            if self.reads and request is not None and record is not None and request.serial != self.seen:
                assert request.serial == self.seen + 1
                self.seen = request.serial
                self.record.set(replace(record, supervision=replace(record.supervision, serial=self.seen)))
                self._tell(request.kind)
            await asyncio.sleep(0.01)

    def _tell(self, asked: CommandKind | RequestKind) -> None:
        self.asked.append(asked)
        self.script(asked)

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        return True

    def request_mode(self, mode: FlightMode) -> bool:
        return True


Play = Callable[[Vehicle], Awaitable[None]]


def play(scenario: Play, status: AutopilotStatus = GROUND, state: State = State.STANDBY) -> float:
    """Runs it; how long it took in virtual time."""

    async def main() -> float:
        vehicle = Vehicle(status, state)
        watch = asyncio.ensure_future(vehicle.watch())
        try:
            await scenario(vehicle)
        finally:
            watch.cancel()
        return asyncio.get_running_loop().time()

    return run_virtual(main())


def answers(vehicle: Vehicle, replies: dict[CommandKind | RequestKind, Callable[[], None]]) -> None:
    vehicle.script = lambda asked: replies.get(asked, lambda: None)()


def refused(
    match: str,
    status: AutopilotStatus,
    state: State,
    ask: Callable[[Commander], Awaitable[None]],
    error: type[Exception] = NotPossibleError,
) -> None:
    """The request is refused at once, in these words, and nothing is asked of anybody."""

    async def scenario(vehicle: Vehicle) -> None:
        with pytest.raises(error, match=match):
            await ask(vehicle.commander)
        await asyncio.sleep(0.1)
        assert vehicle.asked == []

    assert play(scenario, status, state) < 0.2
