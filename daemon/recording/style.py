"""The look of the report's pictures, the same in light and dark: an SVG takes its colours from the page's style."""

import io
import re
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from daemon.recording.analysis import Array

INK, MUTED, GRID = "#1b1f24", "#69717b", "#d8dce1"
FLOWN, WANTED, THIRD, FOURTH = "#d1480e", "#2263ad", "#2b8a40", "#7047aa"
BAD = "#c2263c"
COLOURS = {
    "ink": (INK, "#e4e7ea"),
    "muted": (MUTED, "#98a2ad"),
    "grid": (GRID, "#343b43"),
    "flown": (FLOWN, "#ff9556"),
    "wanted": (WANTED, "#6fb1ff"),
    "third": (THIRD, "#6fd487"),
    "fourth": (FOURTH, "#c3a2ff"),
    "bad": (BAD, "#ff7285"),
}
WIDTH_IN = 9.6
_POINTS = 1400  # a line of the picture is not finer than this
_RC: Any = {  # typed by matplotlib down to each key
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": GRID,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "legend.labelcolor": INK,
    "legend.fontsize": 9,
    "svg.fonttype": "none",
    "figure.constrained_layout.use": True,
}


def figure(height_in: float) -> Figure:
    """An empty figure of the report's width."""
    with mpl.rc_context(_RC):
        return Figure(figsize=(WIDTH_IN, height_in))


def styled() -> Any:
    """Context in which axes are made and drawn."""
    return mpl.rc_context(_RC)


def svg(drawn: Figure, name: str) -> str:
    """The figure as inline SVG; ``name`` keeps its ids apart from those of other figures on the page."""
    with mpl.rc_context({**_RC, "svg.hashsalt": name}):
        buffer = io.StringIO()
        drawn.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    for key, (light, _) in COLOURS.items():
        text = text.replace(light, f"var(--{key})")
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    return re.sub(r"font: ([\d.]+px) [^;\"]*", r"font: \1 var(--face)", text)


def png(drawn: Figure) -> bytes:
    """The figure as a picture on white."""
    with mpl.rc_context({**_RC, "savefig.facecolor": "white"}):
        buffer = io.BytesIO()
        drawn.savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()


def thinned(time_s: Array, values: Array) -> tuple[Array, Array]:
    """A trace of few enough points; of each bin the smallest and the largest stay, so that no peak is lost."""
    size = len(time_s) // (_POINTS // 2)
    if size < 2:
        return time_s, values
    whole = len(time_s) // size * size
    bins = values[:whole].reshape(-1, size)
    filled = np.isfinite(bins)
    low = np.where(filled, bins, np.inf).argmin(axis=1)
    high = np.where(filled, bins, -np.inf).argmax(axis=1)
    index = np.sort(np.stack([low, high], axis=1), axis=1) + np.arange(len(bins))[:, None] * size
    index = np.append(index.ravel(), np.arange(whole, len(time_s)))
    return time_s[index], values[index]
