"""What the report's pictures share: the flight they show, panels on one time axis, marks of goals and events."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from daemon.recording import style
from daemon.recording.analysis import Array, GoalSummary, Traces
from daemon.recording.style import BAD, FLOWN, INK, MUTED, thinned

Line = tuple[Array, str, str, float]  # values, colour, name, width
MARKED = {"reset": BAD, "fast_slide": BAD, "record_gap": BAD, "refused": FLOWN, "goal.refused": FLOWN}


@dataclass(frozen=True, slots=True)
class Scene:
    """What the pictures show."""

    traces: Traces
    goals: list[GoalSummary]
    events: list[dict[str, Any]]
    zero_s: float


def stack(scene: Scene, panels: Sequence[tuple[str, Sequence[Line]]]) -> Figure:
    """Panels above each other on one time axis, with goals and marked events."""
    figure = style.figure(0.5 + 1.75 * len(panels))
    with style.styled():
        rows = np.atleast_1d(np.asarray(figure.subplots(len(panels), 1, sharex=True)))
        for axes, (label, lines) in zip(rows, panels, strict=True):
            for values, colour, name, width in lines:
                axes.plot(*thinned(scene.traces.time_s, values), color=colour, lw=width, label=name)
            axes.set_ylabel(label)
            mark_goals(axes, scene)
            mark_events(axes, scene)
        rows[0].legend(loc="lower right", ncols=4, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        for axes in rows[1:]:
            if len(panels[0][1]) != len(panels[-1][1]):
                axes.legend(loc="best", ncols=4)
        rows[-1].set_xlabel("time, s")
        rows[-1].set_xlim(0.0, float(scene.traces.time_s[-1]) or 1.0)
    return figure


def mark_goals(axes: Axes, scene: Scene) -> None:
    """A line where each goal begins."""
    for number, goal in enumerate(scene.goals, 1):
        axes.axvline(goal.begin_s, color=MUTED, lw=0.8, ls=(0, (4, 3)))
        axes.annotate(
            f"{number}",
            (goal.begin_s, 1.0),
            (2, -9),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            color=MUTED,
            fontsize=8.5,
        )


def mark_events(axes: Axes, scene: Scene) -> None:
    """A line at each reset, refusal and gap."""
    for event in scene.events:
        colour = MARKED.get(event["code"])
        if colour is not None:
            axes.axvline(event["time_s"] - scene.zero_s, color=colour, lw=1.0, ls=(0, (1, 2)))


def mark_targets(axes: Axes, scene: Scene) -> None:
    """A numbered dot where each goal is, seen from above."""
    for number, goal in enumerate(scene.goals, 1):
        if goal.target_ned_m is not None:
            axes.plot(goal.target_ned_m[1], goal.target_ned_m[0], "o", color=INK, ms=4)
            axes.annotate(f"{number}", goal.target_ned_m[1::-1], (5, 5), textcoords="offset points", color=INK)
