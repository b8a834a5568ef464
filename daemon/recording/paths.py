"""Pictures of the way that was flown: in space, from above, and at a glance."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from daemon.recording import style
from daemon.recording.analysis import Array
from daemon.recording.drawing import Scene, mark_goals, mark_targets
from daemon.recording.style import FLOWN, GRID, WANTED, thinned


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
        mark_targets(axes, scene, in_space=True)
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
        mark_targets(plan, scene)
        plan.set_aspect("equal", adjustable="datalim")
        plan.set(title="From above", xlabel="east, m", ylabel="north, m")
        plan.legend(loc="best")
        height.set(title="Height", xlabel="time, s", ylabel="up, m")
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
        mark_targets(plan, scene)
        plan.set_aspect("equal", adjustable="datalim")
        plan.set(title="Path from above", xlabel="east, m", ylabel="north, m")
        plan.legend(loc="best")
        height.set(title="Height", xlabel="time, s", ylabel="up, m")
        error, heading = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
        error.plot(*thinned(t.time_s, t.distance_m), color=FLOWN, lw=1.2)
        heading.plot(*thinned(t.time_s, t.yaw_error_deg), color=FLOWN, lw=1.2)
        error.set(title="Position error, m", xlabel="time, s", ylim=(0.0, None))
        heading.set(title="Heading error, °", xlabel="time, s")
        for axes in (height, error, heading):
            mark_goals(axes, scene)
    return figure


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
