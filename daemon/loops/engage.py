"""Taking the vehicle over from Hold: what must be so, asking for it, and waiting for its end."""

from collections.abc import Callable

from daemon.autopilot.port import CommandRefusedError
from daemon.loops.asking import Asking
from daemon.loops.engageable import hindrances
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode, RequestKind
from daemon.safety.dead_man import SetpointGate
from daemon.safety.supervisor import FLYING, OURS, State

READ_S = 0.5


class Engage:
    """``cannot_hover``: what of the configuration hinders it, in words."""

    def __init__(self, asking: Asking, gate: SetpointGate, cannot_hover: Callable[[], list[str]]) -> None:
        self._asking = asking
        self._gate = gate
        self._cannot_hover = cannot_hover

    async def engage(self) -> None:
        """Take the vehicle over from Hold; done when offboard is confirmed."""
        turns = self._asking.turns
        await self._asking.until_heard("engage")
        self.ask()
        turn = turns.begin(takes=True)
        await self.ended(lambda: turns.lasts(turn))

    def ask(self) -> None:
        """Ask for the vehicle, unless it is ours or about to be. Raises ``NotPossibleError`` and asks for nothing."""
        asking = self._asking
        self.require_no_other_mode()
        if asking.state in FLYING or asking.state is State.ENGAGING:
            return
        self.require_engageable()
        asking.autopilot.withdraw_commands()
        self._gate.unlatch()
        asking.post(RequestKind.ENGAGE)

    async def ended(self, wanted: Callable[[], bool]) -> None:
        """Wait for the end of an engage that was asked for, for whoever still wants it."""
        asking = self._asking
        await asking.turns.wait(wanted, lambda: asking.read or asking.state in OURS, READ_S, "engaging")
        if asking.state not in OURS:  # not taken, or over between two looks
            self.require_engageable()
        words = ""

        def ended() -> bool:
            nonlocal words
            refusal = asking.status.mode_refusal
            if refusal is not None and refusal.mode is FlightMode.OFFBOARD:
                words = f" ({refusal.reason})"
            return asking.state is not State.ENGAGING

        await asking.turns.wait(wanted, ended, asking.timeouts.engage_s, "engaged")
        if asking.state not in FLYING:
            raise CommandRefusedError(f"engage ended in state {asking.state.value}: {asking.reason}{words}")

    def require_no_other_mode(self) -> None:
        """Raise ``NotPossibleError`` while another mode was asked for that the supervisor has yet to read."""
        last = self._asking.request.value
        if last is not None and last.kind is not RequestKind.ENGAGE and not self._asking.read:
            raise NotPossibleError(f"cannot engage: {last.kind.value} was asked for and may still come")

    def require_engageable(self) -> None:
        """Raise ``NotPossibleError`` with what is missing, unless the vehicle could be engaged now."""
        asking = self._asking
        asking.require_connected()
        record = asking.record.value
        if asking.stopping:
            raise NotPossibleError("the daemon is stopping")
        if record is None or asking.state not in (State.READY, State.PILOT, State.FAULT):
            raise NotPossibleError(f"cannot engage in state {asking.state.value}; take off first")
        clock, patience_s = asking.autopilot.clock.value, asking.timeouts.mode_s
        missing = hindrances(asking.status, record, asking.request.value, clock, patience_s=patience_s)
        missing += self._cannot_hover()
        if missing:
            raise NotPossibleError("cannot engage: " + ", ".join(missing))
