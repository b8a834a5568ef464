"""What a vehicle request sees of autopilot and supervisor, and how it asks the two."""

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from daemon.autopilot.port import Autopilot, Command, CommandRefusedError, CommandTimeoutError, LinkError
from daemon.latest import Latest
from daemon.loops.engageable import NOT_HEARD, not_flown
from daemon.loops.turns import NotPossibleError, Turns
from daemon.messages import AutopilotStatus, FlightMode, LandedState, RequestKind, VehicleRequest
from daemon.pipeline import Record
from daemon.safety.conditions import PILOT_MODES
from daemon.safety.reasons import REASONS
from daemon.safety.supervisor import OURS, State


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandTimeouts:
    """Bounds on every wait, seconds; ``climb_m_s`` and ``descend_m_s`` are the slowest rates to allow for."""

    acknowledge_s: float = 2.0
    heard_s: float = 1.0
    mode_s: float = 2.5
    crossed_s: float = 0.5
    arm_s: float = 3.0
    engage_s: float = 3.0
    takeoff_s: float = 20.0
    land_s: float = 60.0
    return_s: float = 600.0
    climb_m_s: float = 0.5
    descend_m_s: float = 0.3


class Asking:
    """``stopping``: the vehicle is neither armed nor engaged any more.

    ``releases`` counts what gave the vehicle away, or was asked to: what was sent before must not take it again.
    ``standstills`` of the daemon are counted for the same reason.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        record: Latest[Record | None],
        request: Latest[VehicleRequest | None],
        timeouts: CommandTimeouts,
    ) -> None:
        self.autopilot = autopilot
        self.record = record
        self.request = request
        self.timeouts = timeouts
        self.turns = Turns(autopilot.withdraw_commands)
        self.stopping = False
        self.releases = 0
        self.standstills = 0

    # -- what is seen

    @property
    def status(self) -> AutopilotStatus:
        """What the autopilot told last."""
        return self.autopilot.status.value

    @property
    def state(self) -> State:
        """The supervisor's state."""
        record = self.record.value
        return record.supervision.state if record else State.DISCONNECTED

    @property
    def read(self) -> bool:
        """Whether the supervisor has read the newest request."""
        record, last = self.record.value, self.request.value
        return last is None or (record is not None and record.supervision.serial == last.serial)

    @property
    def reason(self) -> str:
        """Why the supervisor is in its state, in words."""
        record = self.record.value
        reason = record.supervision.reason if record else "link_lost"
        return REASONS.get(reason, reason)

    @property
    def knows_who_flies(self) -> bool:
        """Whether what is known of the autopilot is of now, or the vehicle is ours anyway."""
        status = self.status
        return status.heard or not status.connected or self.state in OURS

    def require_connected(self) -> None:
        """Raise ``NotPossibleError`` without an autopilot."""
        if not self.status.connected or self.state is State.DISCONNECTED:
            raise NotPossibleError("no autopilot is connected")

    def require_multirotor(self, what: str) -> None:
        """Raise ``NotPossibleError`` for any other kind of vehicle."""
        words = not_flown(self.status)
        if words:
            raise NotPossibleError(f"cannot {what}: {words}")

    def require_flyable(self, what: str) -> None:
        """Raise ``NotPossibleError`` unless the vehicle is in the air, and no pilot's."""
        self.require_connected()
        status = self.status
        if not status.armed or status.landed is LandedState.ON_GROUND:
            raise NotPossibleError(f"cannot {what}: the vehicle is not in the air")
        if status.mode in PILOT_MODES:
            failsafe = self.record.value is not None and self.record.value.conditions.failsafe
            who = "a failsafe of the autopilot acts," if failsafe else "a pilot flies"
            raise NotPossibleError(f"cannot {what}: {who} in mode {status.mode.value}")

    def require_state(self, state: State, what: str) -> None:
        """Raise ``CommandRefusedError`` when the request ended in another state."""
        if self.state is not state:
            raise CommandRefusedError(f"{what} ended in state {self.state.value}: {self.reason}")

    # -- asking

    def post(self, kind: RequestKind) -> None:
        """Ask the supervisor, and wait for nothing: it reads the newest request alone."""
        last = self.request.value
        self.request.set(VehicleRequest(1 if last is None else last.serial + 1, kind))

    async def command(self, turn: int, command: Command) -> None:
        """Command and acknowledgement; a refusal does not count when the request was superseded meanwhile."""
        try:
            await self.autopilot.command(command, self.timeouts.acknowledge_s)
        except LinkError as error:
            self.turns.require(turn)
            raise type(error)(f"{command.kind.value}: {error}") from None

    # -- waiting

    async def until(self, turn: int, done: Callable[[], bool], limit_s: float, what: str) -> None:
        """See ``Turns.until``."""
        await self.turns.until(turn, done, limit_s, what)

    async def wait_for(self, done: Callable[[], bool], limit_s: float, what: str) -> None:
        """Wait for something that nobody supersedes. Raises ``CommandTimeoutError``."""
        await self.turns.wait(lambda: True, done, limit_s, what)

    async def until_heard(self, what: str) -> None:
        """Wait a little until it is known what the autopilot does now; nothing that comes meanwhile is overtaken.

        Raises ``NotPossibleError``, also when the vehicle was released, or the daemon stood still, meanwhile.
        """
        self.require_connected()
        before = self.releases, self.standstills
        with contextlib.suppress(CommandTimeoutError):
            await self.wait_for(self._told, self.timeouts.heard_s, "heard")
        if before != (self.releases, self.standstills):
            raise NotPossibleError(f"cannot {what}: the vehicle was released, or the daemon stood still, meanwhile")
        self.require_connected()
        if not self.status.heard:
            raise NotPossibleError(f"cannot {what}: {NOT_HEARD}")

    def _told(self) -> bool:
        """What it does now, and whether it stands on the ground, which comes in a message of its own."""
        return self.status.heard and self.status.landed is not LandedState.UNDEFINED

    async def until_mode(self, turn: int, mode: FlightMode) -> None:
        """Wait until the autopilot shows the mode. Raises ``CommandRefusedError`` in its words as well.

        A pilot's mode that stays for ``crossed_s`` ends the wait: ours came before it, or does not come any more.
        """
        loop = asyncio.get_running_loop()
        since_s, before, crossed_s = loop.time(), self.status.mode, inf

        def settled() -> bool:
            nonlocal crossed_s
            now, refusal = self.status.mode, self.status.mode_refusal
            if now is mode:
                return True
            crossed_s = min(crossed_s, loop.time()) if now in PILOT_MODES and now is not before else inf
            if loop.time() - crossed_s > self.timeouts.crossed_s:
                raise CommandRefusedError(f"a pilot chose {now.value} meanwhile")
            if refusal is not None and refusal.mode is mode and refusal.time_s >= since_s and self.state not in OURS:
                raise CommandRefusedError(f"the autopilot refused {mode.value}: {refusal.reason}")
            return False

        await self.until(turn, settled, self.timeouts.mode_s, f"in mode {mode.value}")
