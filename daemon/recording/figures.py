"""The report's pictures, each from the traces of a flight."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from daemon.recording import paths, style
from daemon.recording.analysis import spans
from daemon.recording.drawing import GAP, MARKED, Scene, stack
from daemon.recording.style import BAD, FLOWN, FOURTH, INK, MUTED, THIRD, WANTED

_STATE_COLOURS = {"tracking": WANTED, "holding": THIRD, "engaging": FOURTH, "releasing": FLOWN, "fault": BAD}


def positions(scene: Scene) -> Figure:
    """Position against the reference, axis by axis."""
    t = scene.traces
    sign = np.array([1.0, 1.0, -1.0])
    return stack(
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
    return stack(
        scene,
        [
            ("position error, m", [*axes, (t.distance_m, FLOWN, "length", 1.5)]),
            ("heading error, °", [(t.yaw_error_deg, FLOWN, "heading", 1.2)]),
        ],
    )


def attitude(scene: Scene) -> Figure:
    """Attitude against what the control law wanted."""
    t = scene.traces
    return stack(
        scene,
        [
            (f"{name}, °", [(t.desired_rpy_deg[:, i], WANTED, "wanted", 1.6), (t.rpy_deg[:, i], FLOWN, "flown", 1.1)])
            for i, name in enumerate(("roll", "pitch", "yaw"))
        ],
    )


def rates(scene: Scene) -> Figure:
    """Body rates against the setpoints that were sent."""
    t = scene.traces
    return stack(
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
    return stack(
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
        for axes, values, name in zip(
            figure.subplots(1, 2), (t.period_ms, t.age_ms), ("control period", "age of the state"), strict=True
        ):
            known = values[np.isfinite(values)]
            if not len(known):
                continue
            low, high = np.percentile(known, (0.0, 99.8))
            edges = np.linspace(low, max(high, low + 0.1), 60)
            _, _, bars = axes.hist(np.clip(known, edges[0], edges[-1]), bins=list(edges), color=WANTED, log=True)
            note = f"p99 {np.percentile(known, 99):.2f}, largest {known.max():.1f}"
            if known.max() > edges[-1]:
                bars[-1].set_color(MUTED)
                note += ", grey: all that are longer"
            axes.axvline(float(np.percentile(known, 99)), color=FLOWN, lw=1.2)
            axes.annotate(note, (1.0, 1.02), xycoords="axes fraction", ha="right", color=MUTED)
            axes.set(xlabel=f"{name}, ms", ylabel="ticks")
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
            late = end > 0.88 * t.time_s[-1]  # no room to the right of it
            place, side = (goal.begin_s, "right") if late else (end, "left")
            text = f"{GAP}{goal.outcome or 'active'}{GAP}"
            axes.text(place, rows - 1 - number, text, va="center", ha=side, fontsize=8.5)
        for event in scene.events:
            colour = MARKED.get(event["code"], MUTED)
            axes.plot(event["time_s"] - scene.zero_s, 0, "|", color=colour, ms=11, mew=1.6)
        labels = ["events", *(f"goal {n}" for n in range(len(scene.goals), 0, -1)), "state"]
        axes.set_yticks(range(rows + 1), labels)
        axes.set(xlabel="time, s", xlim=(0.0, float(t.time_s[-1]) or 1.0), ylim=(-0.6, rows + 0.6))
        axes.grid(axis="y", visible=False)
    return figure


PICTURES: dict[str, tuple[str, Callable[[Scene], Figure]]] = {
    "timeline": ("What happened when", timeline),
    "path_3d": ("Path", paths.path_3d),
    "path_plan": ("Path from above, and height", paths.path_plan),
    "positions": ("Position", positions),
    "errors": ("Tracking errors", errors),
    "attitude": ("Attitude", attitude),
    "rates": ("Body rates and setpoints", rates),
    "thrust": ("Thrust, hover estimate, wind", thrust),
    "timing": ("Loop and telemetry timing", timing),
}
