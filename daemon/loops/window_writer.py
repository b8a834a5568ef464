"""The reference window as it is published: the plan's next moments, those of the last window again where they serve."""

from collections.abc import Callable

from daemon.guidance.limits import MotionLimits
from daemon.guidance.plan import Plan
from daemon.latest import Latest
from daemon.loops.stopping import way_to_rest
from daemon.messages import WINDOW_SPACING_S, FrameShift, Reference, ReferenceWindow
from daemon.safety.geofence import Geofence


class WindowWriter:
    """Writes ``window``, which reaches ``window_s`` ahead, and to a rest where it takes more to stop in the fence."""

    def __init__(self, window_s: float, limits: Callable[[], MotionLimits], fence: Callable[[], Geofence]) -> None:
        self.window: Latest[ReferenceWindow | None] = Latest(None)
        self._limits = limits
        self._fence = fence
        self._count = round(window_s / WINDOW_SPACING_S)
        self._sampled: Plan | None = None
        self._samples: tuple[Reference, ...] = ()

    def write(self, goal_id: str | None, plan: Plan, from_s: float, shift: FrameShift) -> None:
        """Publish a plan from a time on; ``shift`` is the frame in which it was planned."""
        known = self._samples if plan is self._sampled else ()
        kept = tuple(reference for reference in known if reference.time_s > from_s - WINDOW_SPACING_S)
        start_s = kept[-1].time_s + WINDOW_SPACING_S if kept else from_s
        self._sampled = plan
        self._samples = (*kept, *plan.window(start_s, self._count - len(kept)))
        stop = way_to_rest(self._samples[-1], plan, self._limits(), self._fence())
        self.window.set(ReferenceWindow(goal_id, (*self._samples, *stop), shift))

    def ran_out(self, time_s: float) -> bool:
        """Whether what was published ends before a moment, so that its plan was not flown on."""
        return bool(self._samples) and time_s > self._samples[-1].time_s + WINDOW_SPACING_S

    def clear(self) -> None:
        """Nothing is flown any more."""
        self._sampled, self._samples = None, ()
        self.window.set(None)
