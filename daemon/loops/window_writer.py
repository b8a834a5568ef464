"""The reference window as it is published: the plan's next moments, those of the last window again where they serve."""

from daemon.guidance.plan import Plan
from daemon.latest import Latest
from daemon.messages import WINDOW_SPACING_S, FrameShift, Reference, ReferenceWindow


class WindowWriter:
    """Writes ``window``, which reaches ``window_s`` ahead."""

    def __init__(self, window_s: float) -> None:
        self.window: Latest[ReferenceWindow | None] = Latest(None)
        self._count = round(window_s / WINDOW_SPACING_S)
        self._sampled: Plan | None = None

    def write(self, goal_id: str | None, plan: Plan, from_s: float, shift: FrameShift) -> None:
        """Publish a plan from a time on; ``shift`` is the frame in which it was planned."""
        self.window.set(ReferenceWindow(goal_id, self._samples(plan, from_s), shift))

    def clear(self) -> None:
        """Nothing is flown any more."""
        self.window.set(None)

    def _samples(self, plan: Plan, from_s: float) -> tuple[Reference, ...]:
        """The references from ``from_s`` on; those of the last window serve again while the plan is the same."""
        window = self.window.value
        known = window.samples if window is not None and plan is self._sampled else ()
        kept = tuple(reference for reference in known if reference.time_s > from_s - WINDOW_SPACING_S)
        self._sampled = plan
        start_s = kept[-1].time_s + WINDOW_SPACING_S if kept else from_s
        return (*kept, *plan.window(start_s, self._count - len(kept)))
