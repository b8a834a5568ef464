"""What the report's pictures share: the flight they show, panels on one time axis, marks of goals and events."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import dist
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from daemon.recording import style
from daemon.recording.analysis import Array, GoalSummary, Traces
from daemon.recording.style import BAD, FLOWN, INK, MUTED, thinned

Line = tuple[Array, str, str, float]  # values, colour, name, width
TOUCHING = 0.03  # of an axis: numbers nearer than this run together
GAP = "\N{NO-BREAK SPACE}" * 2  # beside a mark; browsers drop common spaces where a text of an SVG begins
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
    """A line where each goal begins, and its number; goals whose numbers would touch share one."""
    for goal in scene.goals:
        axes.axvline(goal.begin_s, color=MUTED, lw=0.8, ls=(0, (4, 3)))
    begins = [[goal.begin_s] for goal in scene.goals]
    for group in together(begins, TOUCHING * (axes.get_xlim()[1] - axes.get_xlim()[0])):
        axes.annotate(
            numbered(group),
            (scene.goals[group[0]].begin_s, 1.0),
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


def mark_targets(axes: Any, scene: Scene, *, in_space: bool = False) -> None:
    """A numbered dot where each goal is, seen from above or in space; hollow where the goal was not reached."""
    known = [i for i, goal in enumerate(scene.goals) if goal.target_ned_m is not None]
    targets = [_place(scene.goals[i], in_space) for i in known]
    for reached, name in ((True, "goal"), (False, "goal, not reached")):
        dots = [p for p, i in zip(targets, known, strict=True) if (scene.goals[i].outcome == "succeeded") is reached]
        if dots:
            axes.plot(*zip(*dots, strict=True), "o", color=INK, mfc=INK if reached else "none", ms=4.5, label=name)
    span = float(np.nanmax(np.ptp(scene.traces.position_m, axis=0)))
    for group in together(targets, TOUCHING * span):
        text = numbered([known[i] for i in group])
        if in_space:
            axes.text(*targets[group[0]], f"{GAP}{text}", color=INK)
        else:
            axes.annotate(text, targets[group[0]], (5, 5), textcoords="offset points", color=INK)


def _place(goal: GoalSummary, in_space: bool) -> tuple[float, ...]:
    north, east, down = goal.target_ned_m or (0.0, 0.0, 0.0)
    return (east, north, -down) if in_space else (east, north)


def together(places: Sequence[Sequence[float]], apart: float) -> list[list[int]]:
    """Indices in groups: each place joins the first group whose first place is less than ``apart`` away."""
    groups: list[list[int]] = []
    for i, place in enumerate(places):
        near = (group for group in groups if dist(places[group[0]], place) < apart)
        group = next(near, None)
        if group is None:
            groups.append([i])
        else:
            group.append(i)
    return groups


def numbered(indices: Sequence[int]) -> str:
    """Numbers, counted from 1, of ascending indices; three or more in a row as a range: ``1, 3–5``."""
    runs: list[list[int]] = []
    for index in indices:
        if runs and runs[-1][-1] == index - 1:
            runs[-1].append(index)
        else:
            runs.append([index])
    texts = (f"{run[0] + 1}–{run[-1] + 1}" if len(run) > 2 else ", ".join(f"{i + 1}" for i in run) for run in runs)
    return ", ".join(texts)
