"""From the ground: arm, disarm, take off."""

import contextlib

from daemon.autopilot.port import Command, CommandKind, LinkError
from daemon.loops.asking import Asking
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, LandedState, RequestKind
from daemon.safety.conditions import PILOT_MODES
from daemon.safety.supervisor import State


class TakeOff:
    """Remembers whether the vehicle was armed here."""

    def __init__(self, asking: Asking) -> None:
        self._asking = asking
        self._arming = self._armed_here = False

    def armed_shows(self, armed: bool) -> None:
        """At each control tick: what is disarmed, or armed by somebody else later, was not armed here."""
        if not armed:
            self._armed_here = self._arming

    async def arm(self) -> None:
        """Arm; done when telemetry shows it."""
        await self._asking.until_heard("arm")
        self._asking.require_multirotor("arm")
        if not self._asking.status.armed:
            await self._arm(self._asking.turns.begin(takes=True))

    async def disarm(self) -> None:
        """Disarm; only on the ground."""
        asking = self._asking
        asking.require_connected()
        if asking.status.landed is not LandedState.ON_GROUND:
            raise NotPossibleError("the vehicle is not landed; land it first")
        turn = asking.turns.begin()
        await asking.command(turn, Command(CommandKind.DISARM))
        await asking.until(turn, lambda: not asking.status.armed, asking.timeouts.arm_s, "disarmed")

    async def stand_down(self, limit_s: float) -> None:
        """Disarm what was armed here and has not left the ground: nobody is left who would fly it.

        The autopilot itself refuses that once it has taken off.
        """
        asking, status = self._asking, self._asking.status
        on_ground = asking.state in (State.STANDBY, State.TAKING_OFF) and status.landed is LandedState.ON_GROUND
        if not (self._armed_here and on_ground) or status.mode in PILOT_MODES:
            return
        asking.turns.begin()
        with contextlib.suppress(LinkError):
            await asking.autopilot.command(Command(CommandKind.DISARM), limit_s)

    async def takeoff(self, altitude_m: float) -> None:
        """Arm if needed and climb to ``altitude_m`` above the take-off point; done in the air and in Hold."""
        asking = self._asking
        await asking.until_heard("take off")
        asking.require_multirotor("take off")
        status = asking.status
        if asking.state is not State.STANDBY or status.landed is not LandedState.ON_GROUND:
            raise NotPossibleError(f"take-off needs a vehicle on the ground; the state is {asking.state.value}")
        if status.armed and status.mode in PILOT_MODES:
            raise NotPossibleError(f"a pilot has armed the vehicle and flies in mode {status.mode.value}")
        if status.global_position is None:
            raise NotPossibleError("the autopilot has no global position yet, so the height cannot be given")
        turn = asking.turns.begin(takes=True)
        altitude_amsl_m = status.global_position.altitude_amsl_m + altitude_m
        if status.mode is not FlightMode.HOLD:
            # Arming is refused in Land, and in a mode that lacks what it needs.
            asking.post(RequestKind.HOLD)
            await asking.until_mode(turn, FlightMode.HOLD)
        await self._arm(turn)
        mode = asking.status.mode
        if mode is not FlightMode.HOLD:  # arming takes up to a second to show
            raise NotPossibleError(f"take-off ended: somebody else changed the mode to {mode.value}")
        asking.post(RequestKind.TAKEOFF)
        await asking.command(turn, Command(CommandKind.TAKEOFF, altitude_amsl_m))
        await asking.until(turn, lambda: asking.state is State.TAKING_OFF, asking.timeouts.mode_s, "taking off")
        limit_s = asking.timeouts.takeoff_s + altitude_m / asking.timeouts.climb_m_s
        await asking.until(turn, lambda: asking.state is not State.TAKING_OFF, limit_s, "in the air")
        asking.require_state(State.READY, "take-off")

    async def _arm(self, turn: int) -> None:
        asking = self._asking
        if asking.status.armed:
            return
        if asking.state is not State.STANDBY:
            raise NotPossibleError(f"cannot arm in state {asking.state.value}")
        if asking.stopping:
            raise NotPossibleError("the daemon is stopping")
        self._arming = self._armed_here = True
        try:
            await asking.command(turn, Command(CommandKind.ARM))
            await asking.until(turn, lambda: asking.status.armed, asking.timeouts.arm_s, "armed")
        finally:
            self._arming = False
