"""The dead-man: when the control task falls silent, a thread of its own levels the vehicle once and hands it over.

A setpoint leaves through ``SetpointGate`` only: one lock covers "may I send; send" for the task and for the dead-man,
and once latched no setpoint leaves whatever the task does. Only ``unlatch`` (an engage that was asked for) clears it.
A call that holds the interpreter lock stops this thread as well: then nothing leaves, and the autopilot's own
offboard-loss failsafe acts.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from daemon.messages import FlightMode, Setpoint

NO_RATES = (0.0, 0.0, 0.0)
STOP_S = 0.5
AUTOPILOT_ACTS_S = 1.0  # COM_OF_LOSS_T: the autopilot's own failsafe, or a pilot, has the vehicle by then


class Sender(Protocol):
    """What the gate needs of an autopilot."""

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send one setpoint."""

    def request_mode(self, mode: FlightMode) -> bool:
        """Ask for a mode."""


def boot_clock() -> float:
    """Seconds of CLOCK_BOOTTIME, which goes on while the machine is suspended."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class SetpointGate:
    """The only way out for setpoints; counts ticks of the control task, and can be latched shut.

    While the vehicle is ours, a gap of more than ``gap_s`` of ``clock`` between two ticks (SIGCONT, suspend) latches
    before anything is sent, and asks for nothing: what is known of the autopilot is of before the gap, and a pilot may
    have taken it. ``gap_listeners`` are told how long we stood still, whoever has the vehicle.
    """

    def __init__(self, sender: Sender, clock: Callable[[], float] = boot_clock, gap_s: float = 0.3) -> None:
        self._sender = sender
        self._clock = clock
        self._gap_s = gap_s
        self._ticked_s = 0.0
        self._looked_s: float | None = None
        self._lock = threading.Lock()
        self.latched = False
        self.ticks = 0
        self.ours = False
        self.hover_thrust = 0.5
        self.gap_listeners: list[Callable[[float], None]] = []

    def tick(self, setpoint: Setpoint | None, hover_thrust: float) -> bool:
        """The control task is alive, and sends this (None: nothing, the vehicle is not ours). True when it left."""
        self.check_gap()
        with self._lock:
            self._ticked_s = self._clock()
            self.ticks += 1
            self.ours = setpoint is not None
            self.hover_thrust = hover_thrust
            if setpoint is None or self.latched:
                return False
            return self._sender.send_setpoint(setpoint)

    def check_gap(self) -> None:
        """Notice that we stood still; called before anything is computed, and again before it is sent."""
        now_s = self._clock()
        if self.ours and now_s - self._ticked_s > self._gap_s:
            self.shut()
        looked_s, self._looked_s = self._looked_s, now_s
        if looked_s is not None and now_s - looked_s > self._gap_s:
            for listener in self.gap_listeners:
                listener(now_s - looked_s)

    def level_once(self) -> None:
        """One setpoint of zero rates at hover thrust, unless latched or not ours."""
        with self._lock:
            if self.ours and not self.latched:
                self._sender.send_setpoint(Setpoint(NO_RATES, self.hover_thrust))

    def shut(self) -> bool:
        """Let nothing out any more. False: it was shut already."""
        with self._lock:
            if self.latched:
                return False
            self.latched = True
        return True

    def latch(self) -> None:
        """Shut the gate, then command Hold if the vehicle is ours.

        After a silence of ``AUTOPILOT_ACTS_S`` nothing is commanded: what has the vehicle by then keeps it.
        """
        if self.shut() and self.ours and self._clock() - self._ticked_s <= AUTOPILOT_ACTS_S:
            self._sender.request_mode(FlightMode.HOLD)

    def unlatch(self) -> None:
        """Open the gate again; only for an engage that somebody asked for."""
        with self._lock:
            self.latched = False


class Action(Enum):
    """What the dead-man does at a poll."""

    NOTHING = "nothing"
    LEVEL = "level"
    LATCH = "latch"
    SHUT = "shut"


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadManTiming:
    """Seconds: silence until levelling, silence until the latch, gap of the own clock that latches, poll period."""

    level_after_s: float = 0.1
    latch_after_s: float = 0.3
    clock_gap_s: float = 0.3
    poll_s: float = 0.02


class Watch:
    """Decides from polls: silence counts only over polls that were themselves on time, so that a stalled machine
    is not blamed on the loop; a gap of the clock itself shuts the gate at once."""

    def __init__(self, timing: DeadManTiming) -> None:
        self._timing = timing
        self._ticks = -1
        self._polled_s: float | None = None
        self._silent_s = 0.0
        self._levelled = False

    def poll(self, now_s: float, ticks: int, ours: bool) -> Action:
        """What to do at this poll; ``ticks`` is the control task's count."""
        gap_s = 0.0 if self._polled_s is None else now_s - self._polled_s
        self._polled_s = now_s
        if ticks != self._ticks or not ours:
            self._ticks = ticks
            self._silent_s = 0.0
            self._levelled = False
            return Action.SHUT if ours and gap_s > self._timing.clock_gap_s else Action.NOTHING
        if gap_s > self._timing.clock_gap_s:
            return Action.SHUT
        if gap_s <= 2.5 * self._timing.poll_s:
            self._silent_s += gap_s
        if self._silent_s >= self._timing.latch_after_s:
            return Action.LATCH
        if self._silent_s >= self._timing.level_after_s and not self._levelled:
            self._levelled = True
            return Action.LEVEL
        return Action.NOTHING


class DeadMan:
    """The thread: polls the gate on CLOCK_BOOTTIME (which goes on in suspend) and acts through it."""

    def __init__(
        self, gate: SetpointGate, timing: DeadManTiming, report: Callable[[str], None] = lambda _event: None
    ) -> None:
        self._gate = gate
        self._timing = timing
        self._report = report
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="dead-man", daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; returns when it has ended, or after ``STOP_S`` when it is stuck in a send."""
        self._stopped = True
        self._thread.join(STOP_S)

    def _run(self) -> None:
        watch = Watch(self._timing)
        while True:
            time.sleep(self._timing.poll_s)
            if self._stopped:
                return
            action = watch.poll(boot_clock(), self._gate.ticks, self._gate.ours)
            if action is Action.LEVEL:
                self._gate.level_once()
                self._say("dead_man_levelled")
            elif action is Action.LATCH and not self._gate.latched:
                self._gate.latch()
                self._say("dead_man_latched")
            elif action is Action.SHUT and self._gate.shut():
                self._say("dead_man_shut")

    def _say(self, event: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # a log that cannot be written must not end this thread
            self._report(event)
