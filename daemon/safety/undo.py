"""An OFFBOARD that comes after we let go is nobody's choice: what it is answered with; pure.

Requests and setpoints may wait in a link for seconds. The autopilot that gets them then takes OFFBOARD over a pilot's
mode, or goes back to it from its own failsafe, and flies the last rates: nobody flies, and the sticks are dead.
"""

from dataclasses import replace
from math import inf

from daemon.messages import AutopilotStatus, FlightMode
from daemon.safety.conditions import LANDING_MODES
from daemon.values import value

UNDO_ASKS = 3


@value(eq=True)
class Undo:
    """An OFFBOARD that shows until ``until_s`` is answered by ``mode``; -inf: there is nothing of ours to undo.

    ``away``: another mode has shown since we let go. ``asks``: how often, last at ``asked_s``, it was answered.
    """

    until_s: float = -inf
    mode: FlightMode = FlightMode.HOLD
    away: bool = False
    asks: int = 0
    asked_s: float = -inf

    def waits(self, now_s: float) -> bool:
        """An OFFBOARD of now would be ours."""
        return self.until_s > -inf and (not self.away or now_s < self.until_s)


NOTHING = Undo()


def over(mode: FlightMode, until_s: float) -> Undo:
    """An OFFBOARD of ours is about to come over this mode, or has: a landing or Return is restored, else it is Hold."""
    return Undo(until_s, mode if mode in LANDING_MODES else FlightMode.HOLD, away=True)


def let_go(status: AutopilotStatus, now_s: float, *, undo_s: float) -> Undo:
    """The vehicle is not ours any more."""
    return Undo(now_s) if status.mode is FlightMode.OFFBOARD else over(status.mode, now_s + undo_s)


def step(
    undo: Undo, status: AutopilotStatus, now_s: float, *, undo_s: float, retry_s: float
) -> tuple[Undo, tuple[FlightMode, ...]]:
    """A tick in which the vehicle is not ours: what to ask for.

    As long as the autopilot intends to go back to OFFBOARD by itself, the time does not run. The answer is repeated
    while OFFBOARD stays, for a message may be lost; with the next mode that shows it is over, and whoever chooses
    OFFBOARD then keeps it.
    """
    if undo.until_s == -inf:
        return undo, ()
    if status.mode is not FlightMode.OFFBOARD:
        if undo.asks:
            return NOTHING, ()
        returns = status.intended_mode is FlightMode.OFFBOARD
        return over(status.mode, now_s + undo_s if returns else undo.until_s), ()
    if undo.asks == 0 and undo.away and now_s > undo.until_s:
        return NOTHING, ()
    if not status.heard:  # it may be of the past, and a pilot has the vehicle by now
        return replace(undo, until_s=max(undo.until_s, now_s + retry_s)) if undo.away else undo, ()
    if not undo.away or undo.asks >= UNDO_ASKS or now_s - undo.asked_s < retry_s:
        return undo, ()
    refusal = status.mode_refusal
    refused = undo.asks > 0 and refusal is not None and refusal.mode is undo.mode
    mode = FlightMode.HOLD if refused else undo.mode
    return replace(undo, mode=mode, asks=undo.asks + 1, asked_s=now_s), (mode,)
