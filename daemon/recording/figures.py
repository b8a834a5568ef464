"""The report's pictures, each from the traces of a flight."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from daemon.recording import style
from daemon.recording.analysis import Array, GoalSummary, Traces, spans
from daemon.recording.style import BAD, FLOWN, FOURTH, GRID, INK, MUTED, THIRD, WANTED, thinned

_STATE_COLOURS = {"tracking": WANTED, "holding": THIRD, "engaging": FOURTH, "releasing": FLOWN, "fault": BAD}
_MARKED = {"reset": BAD, "fast_slide": BAD, "record_gap": BAD, "refused": FLOWN, "goal.refused": FLOWN}
BAD_NEWS = frozenset(_MARKED)


@dataclass(frozen=True, slots=True)
class Scene:
    """What the pictures show."""

    traces: Traces
    goals: list[GoalSummary]
    events: list[dict[str, Any]]
    zero_s: float


def path_3d(scene: Scene) -> Figure:
    """Flown path and reference in space, with the goals."""
    t = scene.traces
    figure = style.figure(5.2)
    with style.styled():
        axes: Any = figure.add_subplot(projection="3d")
        for path, colour, name, width in (
            (t.reference_m, WANTED, "reference", 2.4),
            (t.position_m, FLOWN, "flown", 1.2),
        ):
            step = max(1, len(path) // 1500)
            axes.plot(path[::step, 1], path[::step, 0], -path[::step, 2], color=colour, lw=width, label=name)
        for number, goal in enumerate(scene.goals, 1):
            if goal.target_ned_m is not None:
                n, e, d = goal.target_ned_m
                axes.scatter([e], [n], [-d], color=INK, s=22, depthshade=False)
                axes.text(e, n, -d, f"  {number}", color=INK)
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        axes.set_zlabel("up, m")
        _equal_box(axes, t.position_m)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.pane.set_visible(False)
            axis.line.set_color(GRID)
            axis._axinfo["grid"].update(color=GRID, linewidth=0.6)
        axes.legend(loc="upper left")
    return figure


def path_plan(scene: Scene) -> Figure:
    """Seen from above, and the height over the way that was flown."""
    t = scene.traces
    figure = style.figure(4.4)
    with style.styled():
        plan, height = figure.subplots(1, 2)
        for axes, x, y in ((plan, 1, 0), (height, None, 2)):
            for path, colour, width, name in (
                (t.reference_m, WANTED, 2.4, "reference"),
                (t.position_m, FLOWN, 1.2, "flown"),
            ):
                across = t.time_s if x is None else path[:, x]
                up = -path[:, y] if y == 2 else path[:, y]
                step = max(1, len(up) // 2000)
                axes.plot(across[::step], up[::step], color=colour, lw=width, label=name)
        for number, goal in enumerate(scene.goals, 1):
            if goal.target_ned_m is not None:
                plan.plot(goal.target_ned_m[1], goal.target_ned_m[0], "o", color=INK, ms=4)
                plan.annotate(f"{number}", goal.target_ned_m[1::-1], (5, 5), textcoords="offset points", color=INK)
        plan.set_aspect("equal", adjustable="datalim")
        plan.set(title="From above", xlabel="east, m", ylabel="north, m")
        plan.legend(loc="best")
        height.set(title="Height", xlabel="time, s", ylabel="up, m")
    return figure


def positions(scene: Scene) -> Figure:
    """Position against the reference, axis by axis."""
    t = scene.traces
    sign = np.array([1.0, 1.0, -1.0])
    return _stack(
        scene,
        [
            (
                f"{name}, m",
                [
                    (t.reference_m[:, i] * sign[i], WANTED, "reference", 2.2),
                    (t.position_m[:, i] * sign[i], FLOWN, "flown", 1.1),
                ],
            )
            for i, name in enumerate(("north", "east", "up"))
        ],
    )


def errors(scene: Scene) -> Figure:
    """Errors of position and heading against the reference."""
    t = scene.traces
    axes = [
        (t.error_m[:, i], colour, name, 1.0)
        for i, (name, colour) in enumerate(zip(("north", "east", "down"), (WANTED, THIRD, FOURTH), strict=True))
    ]
    return _stack(
        scene,
        [
            ("position error, m", [*axes, (t.distance_m, FLOWN, "length", 1.5)]),
            ("heading error, °", [(t.yaw_error_deg, FLOWN, "heading", 1.2)]),
        ],
    )


def attitude(scene: Scene) -> Figure:
    """Attitude against what the control law wanted."""
    t = scene.traces
    return _stack(
        scene,
        [
            (f"{name}, °", [(t.desired_rpy_deg[:, i], WANTED, "wanted", 1.6), (t.rpy_deg[:, i], FLOWN, "flown", 1.1)])
            for i, name in enumerate(("roll", "pitch", "yaw"))
        ],
    )


def rates(scene: Scene) -> Figure:
    """Body rates against the setpoints that were sent."""
    t = scene.traces
    return _stack(
        scene,
        [
            (
                f"{name} rate, °/s",
                [(t.rate_setpoint_deg_s[:, i], WANTED, "setpoint", 1.4), (t.rates_deg_s[:, i], FLOWN, "measured", 1.0)],
            )
            for i, name in enumerate(("roll", "pitch", "yaw"))
        ],
    )


def thrust(scene: Scene) -> Figure:
    """Thrust with the hover thrust that was learned, and the acceleration that the model does not know."""
    t = scene.traces
    wind = [
        (t.disturbance_m_s2[:, i], colour, name, 1.2)
        for i, (name, colour) in enumerate(zip(("north", "east", "down"), (WANTED, THIRD, FOURTH), strict=True))
    ]
    return _stack(
        scene,
        [
            ("thrust, 0 to 1", [(t.thrust, FLOWN, "sent", 1.0), (t.hover_thrust, INK, "hover estimate", 1.6)]),
            ("wind and payload, m/s²", wind),
        ],
    )


def timing(scene: Scene) -> Figure:
    """Histograms of the control period and of the state's age at each tick."""
    t = scene.traces
    figure = style.figure(2.6)
    with style.styled():
        for axes, values, title in zip(
            figure.subplots(1, 2), (t.period_ms, t.age_ms), ("Control period, ms", "Age of the state, ms"), strict=True
        ):
            known = values[np.isfinite(values)]
            if not len(known):
                continue
            low, high = np.percentile(known, (0.0, 99.8))
            edges = np.linspace(low, max(high, low + 0.1), 60)
            axes.hist(np.clip(known, edges[0], edges[-1]), bins=list(edges), color=WANTED, log=True)
            axes.axvline(float(np.percentile(known, 99)), color=FLOWN, lw=1.2)
            axes.annotate(
                f"p99 {np.percentile(known, 99):.2f}, largest {known.max():.1f}",
                (1.0, 1.02),
                xycoords="axes fraction",
                ha="right",
                color=MUTED,
            )
            axes.set(title=title, ylabel="ticks")
            axes.grid(axis="x", visible=False)
    return figure


def timeline(scene: Scene) -> Figure:
    """States, goals and events on one time axis."""
    t = scene.traces
    figure = style.figure(1.7 + 0.24 * max(1, len(scene.goals)))
    with style.styled():
        axes = figure.subplots()
        rows = len(scene.goals) + 1
        for begin, end, name in spans(t.time_s, t.states):
            colour = _STATE_COLOURS.get(name, MUTED)
            axes.barh(rows, end - begin, left=begin, height=0.7, color=colour, alpha=0.35, lw=0)
            if end - begin > 0.045 * t.time_s[-1]:
                axes.text((begin + end) / 2, rows, name.replace("_", " "), ha="center", va="center", fontsize=8.5)
        for number, goal in enumerate(scene.goals):
            end = goal.end_s if goal.end_s is not None else float(t.time_s[-1])
            good = goal.outcome in ("succeeded", "preempted")
            axes.barh(
                rows - 1 - number,
                end - goal.begin_s,
                left=goal.begin_s,
                height=0.6,
                color=THIRD if good else BAD,
                alpha=0.4,
                lw=0,
            )
            axes.text(end, rows - 1 - number, f"  {goal.outcome or 'active'}", va="center", fontsize=8.5)
        for event in scene.events:
            colour = _MARKED.get(event["code"], MUTED)
            axes.plot(event["time_s"] - scene.zero_s, 0, "|", color=colour, ms=11, mew=1.6)
        labels = ["events", *(f"goal {n}" for n in range(len(scene.goals), 0, -1)), "state"]
        axes.set_yticks(range(rows + 1), labels)
        axes.set(xlabel="time, s", xlim=(0.0, float(t.time_s[-1]) or 1.0), ylim=(-0.6, rows + 0.6))
        axes.grid(axis="y", visible=False)
    return figure


def overview(scene: Scene) -> Figure:
    """The flight on one picture: path from above and in height, errors over time."""
    t = scene.traces
    figure = style.figure(6.4)
    with style.styled():
        grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
        plan, height = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
        for path, colour, width, name in (
            (t.reference_m, WANTED, 2.6, "reference"),
            (t.position_m, FLOWN, 1.2, "flown"),
        ):
            plan.plot(path[:, 1], path[:, 0], color=colour, lw=width, label=name)
            height.plot(t.time_s, -path[:, 2], color=colour, lw=width, label=name)
        for number, goal in enumerate(scene.goals, 1):
            if goal.target_ned_m is not None:
                plan.plot(goal.target_ned_m[1], goal.target_ned_m[0], "o", color=INK, ms=4)
                plan.annotate(f"{number}", goal.target_ned_m[1::-1], (5, 5), textcoords="offset points", color=INK)
        plan.set_aspect("equal", adjustable="datalim")
        plan.set(title="Path from above", xlabel="east, m", ylabel="north, m")
        plan.legend(loc="best")
        height.set(title="Height", xlabel="time, s", ylabel="up, m")
        error, heading = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
        error.plot(*thinned(t.time_s, t.distance_m), color=FLOWN, lw=1.2)
        heading.plot(*thinned(t.time_s, t.yaw_error_deg), color=FLOWN, lw=1.2)
        error.set(title="Position error against the reference", xlabel="time, s", ylabel="m", ylim=(0.0, None))
        heading.set(title="Heading error against the reference", xlabel="time, s", ylabel="°")
        for axes in (height, error, heading):
            _mark_goals(axes, scene)
    return figure


PICTURES: dict[str, tuple[str, Callable[[Scene], Figure]]] = {
    "timeline": ("What happened when", timeline),
    "path_3d": ("Path", path_3d),
    "path_plan": ("Path from above, and height", path_plan),
    "positions": ("Position", positions),
    "errors": ("Tracking errors", errors),
    "attitude": ("Attitude", attitude),
    "rates": ("Body rates and setpoints", rates),
    "thrust": ("Thrust, hover estimate, wind", thrust),
    "timing": ("Loop and telemetry timing", timing),
}

Line = tuple[Array, str, str, float]


def _stack(scene: Scene, panels: Sequence[tuple[str, Sequence[Line]]]) -> Figure:
    """Panels above each other on one time axis, with goals and marked events."""
    figure = style.figure(0.5 + 1.75 * len(panels))
    with style.styled():
        rows = np.atleast_1d(np.asarray(figure.subplots(len(panels), 1, sharex=True)))
        for axes, (label, lines) in zip(rows, panels, strict=True):
            for values, colour, name, width in lines:
                axes.plot(*thinned(scene.traces.time_s, values), color=colour, lw=width, label=name)
            axes.set_ylabel(label)
            _mark_goals(axes, scene)
            _mark_events(axes, scene)
        rows[0].legend(loc="lower right", ncols=4, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        for axes in rows[1:]:
            if len(panels[0][1]) != len(panels[-1][1]):
                axes.legend(loc="best", ncols=4)
        rows[-1].set_xlabel("time, s")
        rows[-1].set_xlim(0.0, float(scene.traces.time_s[-1]) or 1.0)
    return figure


def _mark_goals(axes: Axes, scene: Scene) -> None:
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


def _mark_events(axes: Axes, scene: Scene) -> None:
    for event in scene.events:
        colour = _MARKED.get(event["code"])
        if colour is not None:
            axes.axvline(event["time_s"] - scene.zero_s, color=colour, lw=1.0, ls=(0, (1, 2)))


def _equal_box(axes: Any, path: Array) -> None:
    """The same scale on the three axes."""
    known = path[np.isfinite(path).all(axis=1)]
    if not len(known):
        return
    low, high = known.min(axis=0), known.max(axis=0)
    half = 0.5 * np.maximum(high - low, 1.0) + 0.5
    middle = 0.5 * (low + high)
    axes.set_xlim(middle[1] - half[1], middle[1] + half[1])
    axes.set_ylim(middle[0] - half[0], middle[0] + half[0])
    axes.set_zlim(-middle[2] - half[2], -middle[2] + half[2])
    axes.set_box_aspect((half[1], half[0], half[2]))
