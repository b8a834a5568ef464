"""The tracking benchmark's figures as a table, as JSON and as a picture."""

from collections.abc import Iterable
from dataclasses import asdict
from math import isfinite
from typing import Any

from daemon.bench.track import Run

_HEADER = (
    "manoeuvre", "condition", "contestant", "rms m", "max m", "true rms", "true max", "tilt deg", "remarks"
)  # fmt: skip

_LABELS = {
    "flightd": "flightd",
    "flightd_no_drag": "flightd, drag not configured",
    "mavros": "mavros_controllers",
    "px4": "PX4",
}


def as_json(runs: Iterable[Run]) -> list[dict[str, Any]]:
    """One object a run: figures to the millimetre, without the paths; null where there is no figure."""
    return [{k: _rounded(v) for k, v in asdict(run).items() if k not in ("path", "wanted")} for run in runs]


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4) if isfinite(value) else None
    return value


def table(runs: Iterable[Run]) -> str:
    """Lines of equal columns."""
    rows = [_HEADER, *(_row(run) for run in runs)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def markdown(runs: Iterable[Run]) -> str:
    """The table for a document."""
    rows = [_HEADER, ("---",) * len(_HEADER), *(_row(run) for run in runs)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _row(run: Run) -> tuple[str, ...]:
    return (
        run.manoeuvre,
        run.condition,
        run.contestant,
        _metres(run.rms_m),
        _metres(run.max_m),
        _metres(run.true_rms_m),
        _metres(run.true_max_m),
        f"{run.tilt_max_deg:.0f} of {run.tilt_limit_deg:.0f}",
        "; ".join(_remarks(run)),
    )


def _metres(value: float | None) -> str:
    return "-" if value is None or not isfinite(value) else f"{value:.3f}"


def _remarks(run: Run) -> Iterable[str]:
    if run.lost is not None:
        yield f"LOST: {run.lost}"
    if run.overshoot_pct is not None:
        yield f"overshoot {run.overshoot_pct:.1f} %"
        yield "never settled" if run.settle_s is None else f"settled in {run.settle_s:.1f} s"
    if run.after_wind_m is not None:
        yield f"{run.after_wind_m:.3f} m later than 6 s after the wind"
    if run.condition == "thrust_wrong":
        yield f"height changed {run.height_change_m:.2f} m at engage"


def picture(runs: list[Run]) -> bytes:
    """PNG: the lemniscates as flown (in noise where flown, else as first flown), and the RMS errors as bars."""
    from daemon.recording import style

    shown = [run for run in runs if run.manoeuvre.startswith("lemniscate") and run.path]
    names = list(dict.fromkeys(run.manoeuvre for run in shown))
    contestants = list(dict.fromkeys(run.contestant for run in runs))
    colours = dict(zip(contestants, (style.FLOWN, style.THIRD, style.WANTED, style.FOURTH), strict=False))
    figure = style.figure(7.4)
    with style.styled():
        grid = figure.add_gridspec(2, max(1, len(names)), height_ratios=(1.0, 1.0))
        for column, name in enumerate(names):
            axes = figure.add_subplot(grid[0, column])
            of_name = [run for run in shown if run.manoeuvre == name]
            condition = "noise" if any(run.condition == "noise" for run in of_name) else of_name[0].condition
            flown = [run for run in of_name if run.condition == condition]
            axes.plot(*_east_north(flown[0].wanted), color=style.MUTED, lw=4.0, alpha=0.35, label="reference")
            for run in reversed(flown):  # the daemon's own on top
                axes.plot(*_east_north(run.path), color=colours[run.contestant], lw=0.9)
            axes.set(title=_words(name, condition), xlabel="east, m", ylabel="north, m")
            axes.set_aspect("equal")
            if column == 0:
                axes.legend(loc="upper right", bbox_to_anchor=(2.1, 1.0))
        _bars(figure.add_subplot(grid[1, :]), runs, contestants, colours)
    return style.png(figure)


def _words(manoeuvre: str, condition: str) -> str:
    """``lemniscate_5``, ``thrust_wrong``: lemniscate 5 m/s, thrust wrong."""
    kind, _, number = manoeuvre.rpartition("_")
    named = f"{kind} {number} m/s" if number.isdecimal() else manoeuvre
    return f"{named}, {condition}".replace("_", " ")


def _east_north(path: Iterable[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [east for _, east in path], [north for north, _ in path]


def _bars(axes: Any, runs: list[Run], contestants: list[str], colours: dict[str, str]) -> None:
    counted = [run for run in runs if not run.manoeuvre.startswith("step") and isfinite(run.rms_m)]
    flights = list(dict.fromkeys((run.manoeuvre, run.condition) for run in counted))
    width = 0.8 / max(1, len(contestants))
    for i, contestant in enumerate(contestants):
        own = [(flights.index((r.manoeuvre, r.condition)), r.rms_m) for r in counted if r.contestant == contestant]
        places = [place + (i - 0.5 * (len(contestants) - 1)) * width for place, _ in own]
        axes.bar(places, [value for _, value in own], width, color=colours[contestant], label=_LABELS[contestant])
    labels = [_words(*flight) for flight in flights]
    axes.set_xticks(range(len(flights)), labels, rotation=40.0, ha="right", rotation_mode="anchor")
    axes.set_ylabel("RMS error, m")
    axes.legend()
