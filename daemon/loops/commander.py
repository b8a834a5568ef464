"""Vehicle requests as coroutines: check, ask, and wait until telemetry shows it. The newest request supersedes."""

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass

from daemon.autopilot.port import (
    Autopilot,
    Command,
    CommandKind,
    CommandRefusedError,
    CommandTimeoutError,
    LinkError,
)
from daemon.latest import Latest
from daemon.loops.engageable import NOT_HEARD, hindrances
from daemon.messages import FlightMode, LandedState, RequestKind, VehicleRequest
from daemon.pipeline import Inputs, Record
from daemon.safety.conditions import PILOT_MODES
from daemon.safety.dead_man import SetpointGate
from daemon.safety.reasons import REASONS
from daemon.safety.supervisor import FLYING, OURS, State

POLL_S = 0.02
SUPERSEDED = "superseded by a newer vehicle request"
STOOD_STILL = "the daemon stood still before it was done; ask again"


class NotPossibleError(Exception):
    """The request does not fit the state that the vehicle or the daemon is in; the text says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandTimeouts:
    """Bounds on every wait, seconds; ``climb_m_s`` and ``descend_m_s`` are the slowest rates to allow for."""

    acknowledge_s: float = 2.0
    heard_s: float = 1.0
    mode_s: float = 2.5
    arm_s: float = 3.0
    engage_s: float = 3.0
    takeoff_s: float = 20.0
    land_s: float = 60.0
    return_s: float = 600.0
    climb_m_s: float = 0.5
    descend_m_s: float = 0.3


class Commander:
    """One request at a time: a newer one ends a pending one with ``NotPossibleError("superseded ...")``.

    A request that is refused at once ends none. ``stopping``: the vehicle is neither armed nor engaged any more.
    ``releases`` counts what gave the vehicle away, or was asked to: what was sent before must not take it again.
    ``standstills`` of the daemon are counted for the same reason.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        gate: SetpointGate,
        record: Latest[Record | None],
        request: Latest[VehicleRequest | None],
        timeouts: CommandTimeouts,
        cannot_hover: Callable[[], list[str]],
    ) -> None:
        self._autopilot = autopilot
        self._gate = gate
        self._record = record
        self._request = request
        self._timeouts = timeouts
        self._cannot_hover = cannot_hover
        self._turn = 0
        self._takes = False
        self._ended_by = SUPERSEDED
        self._flying = False
        self._arming = self._armed_here = False
        self.stopping = False
        self.releases = 0
        self.standstills = 0

    @property
    def state(self) -> State:
        """The supervisor's state."""
        record = self._record.value
        return record.supervision.state if record else State.DISCONNECTED

    @property
    def read(self) -> bool:
        """Whether the supervisor has read the newest request."""
        record, last = self._record.value, self._request.value
        return last is None or (record is not None and record.supervision.serial == last.serial)

    def on_control_tick(self, inputs: Inputs, record: Record) -> None:
        """A listener of the control task: notes when the vehicle goes to somebody else, and who armed it."""
        flying = record.supervision.state in FLYING
        self.releases += self._flying and not flying
        self._flying = flying
        if not inputs.status.armed:
            self._armed_here = self._arming

    def stood_still(self) -> None:
        """End what would still arm, take off or engage: who asked has given up, and may stand beside the vehicle."""
        self.standstills += 1
        if self._takes:
            self._begin()
            self._ended_by = STOOD_STILL

    async def arm(self) -> None:
        """Arm; done when telemetry shows it."""
        await self.until_heard("arm")
        if not self._autopilot.status.value.armed:
            await self._arm(self._begin(takes=True))

    async def disarm(self) -> None:
        """Disarm; only on the ground."""
        self._require_connected()
        if self._autopilot.status.value.landed is not LandedState.ON_GROUND:
            raise NotPossibleError("the vehicle is not landed; land it first")
        turn = self._begin()
        await self._command(turn, Command(CommandKind.DISARM))
        await self._until(turn, lambda: not self._autopilot.status.value.armed, self._timeouts.arm_s, "disarmed")

    async def stand_down(self, limit_s: float) -> None:
        """Disarm what was armed here and has not left the ground: nobody is left who would fly it.

        The autopilot itself refuses that once it has taken off.
        """
        status = self._autopilot.status.value
        on_ground = self.state in (State.STANDBY, State.TAKING_OFF) and status.landed is LandedState.ON_GROUND
        if not (self._armed_here and on_ground) or status.mode in PILOT_MODES:
            return
        self._begin()
        with contextlib.suppress(LinkError):
            await self._autopilot.command(Command(CommandKind.DISARM), limit_s)

    async def takeoff(self, altitude_m: float) -> None:
        """Arm if needed and climb to ``altitude_m`` above the take-off point; done in the air and in Hold."""
        await self.until_heard("take off")
        status = self._autopilot.status.value
        if self.state is not State.STANDBY or status.landed is not LandedState.ON_GROUND:
            raise NotPossibleError(f"take-off needs a vehicle on the ground; the state is {self.state.value}")
        if status.armed and status.mode in PILOT_MODES:
            raise NotPossibleError(f"a pilot has armed the vehicle and flies in mode {status.mode.value}")
        if status.global_position is None:
            raise NotPossibleError("the autopilot has no global position yet, so the height cannot be given")
        turn = self._begin(takes=True)
        altitude_amsl_m = status.global_position.altitude_amsl_m + altitude_m
        if status.mode is not FlightMode.HOLD:
            # Arming is refused in Land, and in a mode that lacks what it needs.
            self.post(RequestKind.HOLD)
            await self._until_mode(turn, FlightMode.HOLD)
        await self._arm(turn)
        mode = self._autopilot.status.value.mode
        if mode is not FlightMode.HOLD:  # arming takes up to a second to show
            raise NotPossibleError(f"take-off ended: somebody else changed the mode to {mode.value}")
        self.post(RequestKind.TAKEOFF)
        await self._command(turn, Command(CommandKind.TAKEOFF, altitude_amsl_m))
        await self._until(turn, lambda: self.state is State.TAKING_OFF, self._timeouts.mode_s, "taking off")
        limit_s = self._timeouts.takeoff_s + altitude_m / self._timeouts.climb_m_s
        await self._until(turn, lambda: self.state is not State.TAKING_OFF, limit_s, "in the air")
        self._require(State.READY, "take-off")

    async def engage(self) -> None:
        """Take the vehicle over from Hold; done when offboard is confirmed."""
        await self.until_heard("engage")
        self.ask_engage()
        turn = self._begin(takes=True)
        await self.engaged(lambda: self._turn == turn)

    def ask_engage(self) -> None:
        """Ask for the vehicle, unless it is ours or about to be. Raises ``NotPossibleError`` and asks for nothing."""
        self.require_no_other_mode()
        if self.state in FLYING or self.state is State.ENGAGING:
            return
        self.require_engageable()
        self._autopilot.withdraw_commands()
        self._gate.unlatch()
        self.post(RequestKind.ENGAGE)

    async def engaged(self, wanted: Callable[[], bool]) -> None:
        """Wait for the end of an engage that was asked for, for whoever still wants it."""
        await self._wait(wanted, lambda: self.read or self.state in OURS, 0.5, "engaging")
        if self.state not in OURS:  # not taken, or over between two looks
            self.require_engageable()
        words = ""

        def ended() -> bool:
            nonlocal words
            refusal = self._autopilot.status.value.mode_refusal
            if refusal is not None and refusal.mode is FlightMode.OFFBOARD:
                words = f" ({refusal.reason})"
            return self.state is not State.ENGAGING

        await self._wait(wanted, ended, self._timeouts.engage_s, "engaged")
        if self.state not in FLYING:
            raise CommandRefusedError(f"engage ended in state {self.state.value}: {self._reason()}{words}")

    def require_no_other_mode(self) -> None:
        """Raise ``NotPossibleError`` while another mode was asked for that the supervisor has yet to read."""
        last = self._request.value
        if last is not None and last.kind is not RequestKind.ENGAGE and not self.read:
            raise NotPossibleError(f"cannot engage: {last.kind.value} was asked for and may still come")

    def require_engageable(self) -> None:
        """Raise ``NotPossibleError`` with what is missing, unless the vehicle could be engaged now."""
        self._require_connected()
        record, status = self._record.value, self._autopilot.status.value
        if self.stopping:
            raise NotPossibleError("the daemon is stopping")
        if record is None or self.state not in (State.READY, State.PILOT, State.FAULT):
            raise NotPossibleError(f"cannot engage in state {self.state.value}; take off first")
        clock = self._autopilot.clock.value
        missing = hindrances(status, record, self._request.value, clock, patience_s=self._timeouts.mode_s)
        missing += self._cannot_hover()
        if missing:
            raise NotPossibleError("cannot engage: " + ", ".join(missing))

    async def hold(self) -> None:
        """The autopilot's Hold, from any airborne mode except a pilot's; also how the vehicle is released."""
        turn = await self._begin_leaving("hold")
        self.post(RequestKind.HOLD)
        await self._until_mode(turn, FlightMode.HOLD)
        await self._until(turn, lambda: self.read and self.state is State.READY, self._timeouts.mode_s, "in Hold")

    async def land(self) -> None:
        """Land here; done when disarmed."""
        await self._come_down(RequestKind.LAND, FlightMode.LAND, self._timeouts.land_s)

    async def return_home(self) -> None:
        """The autopilot's Return; done when disarmed."""
        await self._come_down(RequestKind.RETURN, FlightMode.RETURN, self._timeouts.return_s)

    async def _come_down(self, kind: RequestKind, mode: FlightMode, limit_s: float) -> None:
        turn = await self._begin_leaving(kind.value)
        record = self._record.value
        height_m = 0.0
        if record is not None and record.estimate.newest is not None:
            height_m = max(0.0, -record.estimate.newest.position_ned_m[2])
        self.post(kind)
        await self._until_mode(turn, mode)
        await self._until(turn, lambda: self.state is State.LANDING, self._timeouts.mode_s, kind.value + "ing")
        limit_s += height_m / self._timeouts.descend_m_s
        await self._until(
            turn,
            lambda: not self._autopilot.status.value.armed or self.state is not State.LANDING,
            limit_s,
            "landed and disarmed",
        )
        if self._autopilot.status.value.armed:
            raise NotPossibleError(f"{kind.value} ended in state {self.state.value}: {self._reason()}")
        await self._until(turn, lambda: self.state is State.STANDBY, 1.0, "standby")

    async def _arm(self, turn: int) -> None:
        if self._autopilot.status.value.armed:
            return
        if self.state is not State.STANDBY:
            raise NotPossibleError(f"cannot arm in state {self.state.value}")
        if self.stopping:
            raise NotPossibleError("the daemon is stopping")
        self._arming = self._armed_here = True
        try:
            await self._command(turn, Command(CommandKind.ARM))
            await self._until(turn, lambda: self._autopilot.status.value.armed, self._timeouts.arm_s, "armed")
        finally:
            self._arming = False

    def _begin(self, *, takes: bool = False) -> int:
        """End the request before; a command of its that was not acknowledged must not come after this request's."""
        self._turn += 1
        self._takes = takes
        self._ended_by = SUPERSEDED
        self._autopilot.withdraw_commands()
        return self._turn

    async def _begin_leaving(self, what: str) -> int:
        """Begin a request for another mode; a release that is under way is let end first, it takes no second wish.

        A vehicle that is not ours is asked for nothing until it is known who has it now: it may be a pilot.
        """
        with contextlib.suppress(CommandTimeoutError):
            await self.wait_for(self._knows_who_flies, self._timeouts.mode_s, "heard")
        if not self._knows_who_flies():
            raise NotPossibleError(f"cannot {what}: {NOT_HEARD}")
        self._require_flyable(what)
        self.releases += 1
        turn = self._begin()
        await self._until(turn, lambda: self.state is not State.RELEASING, self._timeouts.mode_s, "released")
        self._require_flyable(what)
        return turn

    async def _command(self, turn: int, command: Command) -> None:
        """Command and acknowledgement; a refusal does not count when the request was superseded meanwhile."""
        try:
            await self._autopilot.command(command, self._timeouts.acknowledge_s)
        except LinkError as error:
            self._require_wanted(self._turn == turn)
            raise type(error)(f"{command.kind.value}: {error}") from None

    def post(self, kind: RequestKind) -> None:
        """Ask the supervisor, and wait for nothing: it reads the newest request alone."""
        last = self._request.value
        self._request.set(VehicleRequest(1 if last is None else last.serial + 1, kind))

    def _require_wanted(self, wanted: bool) -> None:
        if not wanted:
            raise NotPossibleError(self._ended_by)

    def _require(self, state: State, what: str) -> None:
        if self.state is not state:
            raise CommandRefusedError(f"{what} ended in state {self.state.value}: {self._reason()}")

    def _require_connected(self) -> None:
        if not self._autopilot.status.value.connected or self.state is State.DISCONNECTED:
            raise NotPossibleError("no autopilot is connected")

    def _knows_who_flies(self) -> bool:
        status = self._autopilot.status.value
        return status.heard or not status.connected or self.state in OURS

    async def until_heard(self, what: str) -> None:
        """Wait a little until it is known what the autopilot does now; nothing that comes meanwhile is overtaken.

        Raises ``NotPossibleError``, also when the vehicle was released, or the daemon stood still, meanwhile.
        """
        self._require_connected()
        before = self.releases, self.standstills
        with contextlib.suppress(CommandTimeoutError):
            await self.wait_for(lambda: self._autopilot.status.value.heard, self._timeouts.heard_s, "heard")
        if before != (self.releases, self.standstills):
            raise NotPossibleError(f"cannot {what}: the vehicle was released, or the daemon stood still, meanwhile")
        self._require_connected()
        if not self._autopilot.status.value.heard:
            raise NotPossibleError(f"cannot {what}: {NOT_HEARD}")

    def _require_flyable(self, what: str) -> None:
        self._require_connected()
        status = self._autopilot.status.value
        if not status.armed or status.landed is LandedState.ON_GROUND:
            raise NotPossibleError(f"cannot {what}: the vehicle is not in the air")
        if status.mode in PILOT_MODES:
            failsafe = self._record.value is not None and self._record.value.conditions.failsafe
            who = "a failsafe of the autopilot acts," if failsafe else "a pilot flies"
            raise NotPossibleError(f"cannot {what}: {who} in mode {status.mode.value}")

    def _reason(self) -> str:
        record = self._record.value
        reason = record.supervision.reason if record else "link_lost"
        return REASONS.get(reason, reason)

    async def _until_mode(self, turn: int, mode: FlightMode) -> None:
        since_s = asyncio.get_running_loop().time()

        def settled() -> bool:
            status = self._autopilot.status.value
            refusal = status.mode_refusal
            if status.mode is mode:
                return True
            if refusal is not None and refusal.mode is mode and refusal.time_s >= since_s and self.state not in OURS:
                raise CommandRefusedError(f"the autopilot refused {mode.value}: {refusal.reason}")
            return False

        await self._until(turn, settled, self._timeouts.mode_s, f"in mode {mode.value}")

    async def wait_for(self, done: Callable[[], bool], limit_s: float, what: str) -> None:
        """Wait for something that nobody supersedes. Raises ``CommandTimeoutError``."""
        await self._wait(lambda: True, done, limit_s, what)

    async def _until(self, turn: int, done: Callable[[], bool], limit_s: float, what: str) -> None:
        await self._wait(lambda: self._turn == turn, done, limit_s, what)

    async def _wait(self, wanted: Callable[[], bool], done: Callable[[], bool], limit_s: float, what: str) -> None:
        """Look every ``POLL_S``: what is waited for is several cells, each with its own writer."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + limit_s
        while True:
            self._require_wanted(wanted())
            if done():
                return
            if loop.time() > deadline_s:
                raise CommandTimeoutError(f"not {what} after {limit_s:g} s; it may still come")
            await asyncio.sleep(POLL_S)
