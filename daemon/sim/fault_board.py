"""Faults at work on one vehicle: begun at run time or by schedule, ended after their duration or when cleared."""

from collections.abc import Iterable
from heapq import heappop, heappush
from typing import TYPE_CHECKING

from daemon.sim.faults import FAULTS, Fault, SpoiltTelemetry
from daemon.sim.sample import Fields
from daemon.sim.scenario import ScheduledFault

if TYPE_CHECKING:
    from daemon.sim.px4 import SimulatedPx4


class FaultBoard:
    """``active``: the faults at work; ``spoilt``: which of them spoils which message."""

    def __init__(self, px4: "SimulatedPx4") -> None:
        self._px4 = px4
        self._plan: list[tuple[int, int, bool, Fault]] = []
        self._count = 0
        self.active: list[Fault] = []
        self.spoilt: dict[str, SpoiltTelemetry] = {}
        self._first: dict[str, Fields] = {}

    def inject(self, fault: Fault) -> None:
        """Begin a fault now. Raises ValueError when it does not fit this vehicle."""
        fault.check(self._px4)
        self._begin(fault)

    def schedule(self, faults: Iterable[ScheduledFault]) -> None:
        """Plan faults by simulated time since the start. Raises ValueError when one does not fit this vehicle."""
        planned = list(faults)
        for entry in planned:
            entry.fault.check(self._px4)
        for entry in planned:
            self._plan_at(round(entry.at_s * 1e6), True, entry.fault)

    def clear(self, name: str | None = None) -> int:
        """End the active faults of a name, or all; how many there were. Raises ValueError for an unknown name."""
        if name is not None and name not in FAULTS:
            raise ValueError(f"fault: {name!r} is none of {', '.join(FAULTS)}")
        chosen = [fault for fault in self.active if name is None or type(fault) is FAULTS[name]]
        for fault in chosen:
            self._end(fault)
        return len(chosen)

    def step(self, now_us: int) -> None:
        """Begin and end what is due."""
        while self._plan and self._plan[0][0] <= now_us:
            _, _, begins, fault = heappop(self._plan)
            if begins:
                self._begin(fault)
            elif any(fault is other for other in self.active):
                self._end(fault)

    def spoil(self, name: str, fields: Fields) -> Fields | None:
        """What becomes of a message; None when it is not sent."""
        fault, first = self.spoilt[name], self._first.setdefault(name, fields)
        return fault.spoil(fields, first)

    def _plan_at(self, time_us: int, begins: bool, fault: Fault) -> None:
        self._count += 1
        heappush(self._plan, (time_us, self._count, begins, fault))

    def _begin(self, fault: Fault) -> None:
        fault.begin(self._px4)
        if fault.lasts:
            self.active.append(fault)
            self._note_spoilt()
            if fault.duration_s is not None:
                self._plan_at(self._px4.simulated_us + round(fault.duration_s * 1e6), False, fault)

    def _end(self, fault: Fault) -> None:
        self.active = [other for other in self.active if other is not fault]
        fault.end(self._px4)
        self._note_spoilt()

    def _note_spoilt(self) -> None:
        """Which fault spoils which message: the newest of those at work."""
        faults = [fault for fault in self.active if isinstance(fault, SpoiltTelemetry)]
        spoilt = {name: fault for fault in faults for name in fault.messages}
        self._first = {name: first for name, first in self._first.items() if spoilt.get(name) is self.spoilt.get(name)}
        self.spoilt = spoilt
