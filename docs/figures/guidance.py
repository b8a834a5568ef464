"""Draws the pictures of docs/guidance.md from flights in virtual time. `make docs-figures`."""

import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from io import BytesIO
from math import cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from support.flight import CALLER, Flight, fly

from daemon import frames
from daemon.goals.methods import ReferenceSet
from daemon.guidance.polynomial import candidates
from daemon.messages import Reference, Vec3
from daemon.recording import style
from daemon.recording.style import FLOWN, FOURTH, INK, MUTED, THIRD, WANTED

IMAGES = Path(__file__).parents[1] / "images"
DPI, COLOURS = 110, 200
HOME: Vec3 = (0.0, 0.0, -10.0)
SMALLEST_VIEW_M = 1.0

Scenario = Callable[[Flight], Awaitable[None]]


@dataclass(frozen=True)
class Flown:
    """A flight from rest at ``HOME``: time from its goal on, the references, and where the vehicle truly was."""

    time_s: list[float]
    references: list[Reference]
    truths: list[Vec3]
    headings_rad: list[float]
    speeds_m_s: list[float]

    def wanted(self, name: str) -> np.ndarray[Any, Any]:
        """A field of the references, one row a tick."""
        return np.array([getattr(reference, name) for reference in self.references])


def flown(scenario: Scenario, config: dict[str, Any] | None = None) -> Flown:
    """What was wanted and what was flown while the scenario ran."""

    async def run(flight: Flight) -> Flown:
        headings: list[float] = []
        speeds: list[float] = []
        flight.vehicle.control.listeners.append(
            lambda _inputs, _record: (
                headings.append(frames.yaw_of(flight.px4.truth.attitude_wb)),
                speeds.append(frames.norm(flight.px4.truth.velocity_ned_m_s)),
            )
        )
        await flight.airborne(-HOME[2])
        await flight.result(await flight.goto(*HOME, yaw_deg=0.0, hold_s=1.0))
        since = len(flight.records)
        await scenario(flight)
        records = flight.records[since:]
        return Flown(
            [record.now_s - records[0].now_s for record in records],
            [record.reference for record in records if record.reference is not None],
            flight.truths[since:],
            headings[since:],
            speeds[since:],
        )

    return fly(run, config=config)


def to_its_end(**goal: Any) -> Scenario:
    """Submit a goal and fly until it has succeeded."""

    async def scenario(flight: Flight) -> None:
        entry = await flight.result(await flight.submit(**goal))
        assert entry.outcome == "succeeded", entry

    return scenario


def seen_from_above(axes: Axes, title: str, flight: Flown, noses: int = 14) -> None:
    """The way from above, with the heading of the vehicle at even spacing in time."""
    wanted, way = flight.wanted("position_ned_m"), np.array(flight.truths)
    axes.plot(wanted[:, 1], wanted[:, 0], color=WANTED, lw=3.2, alpha=0.45, solid_capstyle="round", label="reference")
    axes.plot(way[:, 1], way[:, 0], color=FLOWN, lw=1.2, label="flown")
    span = max(np.ptp(way[:, 0]), np.ptp(way[:, 1]), SMALLEST_VIEW_M)
    middle = 0.5 * (way.max(axis=0) + way.min(axis=0))
    half = 0.5 * SMALLEST_VIEW_M
    axes.update_datalim([(middle[1] - half, middle[0] - half), (middle[1] + half, middle[0] + half)])
    for index in np.linspace(0, len(way) - 1, noses).astype(int):
        yaw = flight.headings_rad[index]
        axes.annotate(
            "",
            (way[index, 1] + 0.09 * span * sin(yaw), way[index, 0] + 0.09 * span * cos(yaw)),
            (way[index, 1], way[index, 0]),
            arrowprops={"arrowstyle": "-|>,head_width=0.14,head_length=0.3", "color": INK, "lw": 0.7, "shrinkA": 0},
        )
    axes.plot(way[0, 1], way[0, 0], "o", color=INK, ms=4)
    axes.set(title=title, xlabel="east, m", ylabel="north, m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.14)
    axes.autoscale_view()


def over_time(axes: Axes, label: str, flight: Flown, wanted: Any, way: Any = None) -> None:
    """What was wanted and what was flown, over the time since the goal."""
    axes.plot(flight.time_s, wanted, color=WANTED, lw=3.2, alpha=0.45, label="reference")
    if way is not None:
        axes.plot(flight.time_s, way, color=FLOWN, lw=1.2, label="flown")
    axes.set_ylabel(label)


def height_below(axes: Axes, flight: Flown) -> None:
    """The height over time, in the row below a way from above."""
    over_time(axes, "height, m", flight, -flight.wanted("position_ned_m")[:, 2], [-p[2] for p in flight.truths])
    axes.set_xlabel("time, s")
    low, high = axes.get_ylim()
    middle, half = 0.5 * (low + high), max(1.0, 0.5 * (high - low))
    axes.set_ylim(middle - half, middle + half)


def waypoint_modes() -> Figure:
    """Each mode, given the same pose: 6 m north, 4 m east, 3 m up, heading 120 degrees."""
    pose = {"position": [6.0, 4.0, -13.0], "yaw_deg": 120.0}
    figure = style.figure(7.4)
    halves = figure.subplots(4, 3, height_ratios=(2.6, 1.0, 2.6, 1.0))
    modes = (
        ("full_pose", "position_and_yaw", "only_position"),
        ("forward_heading", "xy_and_yaw", "only_orientation"),
    )
    for half, row in enumerate(modes):
        for column, mode in enumerate(row):
            flight = flown(to_its_end(waypoint=pose | {"mode": mode}))
            above, below = halves[2 * half][column], halves[2 * half + 1][column]
            seen_from_above(above, mode, flight, noses=8)
            height_below(below, flight)
    halves[0][0].legend(loc="upper left")
    return figure


def profiles() -> Figure:
    """The same goal by both profiles, moved half-way."""

    async def moved(flight: Flight) -> None:
        since_s = flight.now_s
        await flight.goto(14.0, 0.0, -10.0)
        await flight.until(lambda: flight.now_s > since_s + 2.5)
        await flight.result(await flight.goto(9.0, 8.0, -12.0))

    figure = style.figure(5.8)
    panels = figure.subplots(4, 2, sharey="row", sharex=True)
    for column, profile in enumerate(("jerk_limited", "reference_filter")):
        flight = flown(moved, {"guidance": {"profile": profile}})
        way = np.array(flight.truths)
        wanted = flight.wanted("position_ned_m")
        names = (("north, m", 0), ("east, m", 1))
        for row, (label, axis) in enumerate(names):
            over_time(panels[row][column], label, flight, wanted[:, axis], way[:, axis])
        speed = np.linalg.norm(flight.wanted("velocity_ned_m_s"), axis=1)
        over_time(panels[2][column], "speed, m/s", flight, speed, flight.speeds_m_s)
        acceleration = flight.wanted("acceleration_ned_m_s2")
        for axis, (colour, name) in enumerate(((WANTED, "north"), (THIRD, "east"), (FOURTH, "down"))):
            panels[3][column].plot(flight.time_s, acceleration[:, axis], color=colour, label=name)
        panels[3][column].set(ylabel="acceleration of\nthe reference, m/s²", xlabel="time, s")
        panels[0][column].set_title(profile)
        for row in panels:
            row[column].axvline(2.5, color=MUTED, lw=0.8, ls=(0, (4, 3)))
            row[column].label_outer()
    panels[0][1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
    panels[3][1].legend(loc="lower right", ncols=3, fontsize=8)
    return figure


def trajectories() -> Figure:
    """Circle, lemniscate, polynomial with its candidates, hold out of a motion."""
    circle = {"kind": "circle", "center": [0.0, 6.0, -10.0], "radius_m": 4.0, "speed_m_s": 2.0, "heading": "target"}
    eight = {"kind": "lemniscate", "center": [4.0, 0.0, -11.0], "size_m": [6.0, 3.0], "speed_m_s": 2.5}
    push = {"kind": "polynomial", "jerk_m_s3": [2.0, 1.0, -0.5], "duration_s": 1.2}
    tilted = circle | {"center": [0.0, 5.0, -12.0], "radius_m": 3.0, "axis": [0.5, 0.0, 1.0], "speed_m_s": 1.5}

    async def held(flight: Flight) -> None:
        since_s = flight.now_s
        await flight.goto(20.0, 10.0, -10.0)
        await flight.until(lambda: flight.now_s > since_s + 2.0)
        await flight.result(await flight.submit(trajectory={"kind": "hold", "duration_s": 1.5}))

    shown: tuple[tuple[str, Scenario], ...] = (
        ("circle, heading: target", to_its_end(trajectory=circle)),
        ("circle, axis [0.5, 0, 1], heading: fixed", to_its_end(trajectory=tilted | {"heading": "fixed"})),
        ("lemniscate, heading: velocity", to_its_end(trajectory=eight | {"heading": "velocity"})),
        ("lemniscate, heading: a point", to_its_end(trajectory=eight | {"heading": {"point": [4.0, 8.0, -11.0]}})),
        ("polynomial, and its candidates", to_its_end(trajectory=push)),
        ("hold, 2 s after a waypoint", held),
    )
    figure = style.figure(8.4)
    halves = figure.subplots(4, 3, height_ratios=(2.6, 1.0, 2.6, 1.0))
    for index, (title, scenario) in enumerate(shown):
        flight = flown(scenario)
        half, column = divmod(index, 3)
        above = halves[2 * half][column]
        seen_from_above(above, title, flight)
        height_below(halves[2 * half + 1][column], flight)
        if "polynomial" in title:
            jerk = frames.norm((2.0, 1.0, -0.5))
            for one in candidates(flight.references[0], jerk, 1.2):
                path = np.array([r.position_ned_m for r in one.outline(20)])
                above.plot(path[:, 1], path[:, 0], color=THIRD, lw=1.6, ls=(0, (3, 2)), zorder=1, label="candidates")
            lines, names = above.get_legend_handles_labels()
            above.legend(lines[-1:], names[-1:], loc="upper left")
    halves[0][0].legend(loc="center")
    return figure


def paths() -> Figure:
    """A path with stops, the same path without, and a stream."""
    corners = [(7.0, 0.0, -10.0), (9.0, 6.0, -12.0), (2.0, 8.0, -12.0), (0.0, 3.0, -10.0)]
    given = [{"position": list(corner)} for corner in corners]

    async def streamed(flight: Flight) -> None:
        goal_id = await flight.submit(stream={"timeout_s": 0.5})
        begin_s = flight.now_s
        while (t := flight.now_s - begin_s) < 10.0:
            angle, rate = 0.5 * t, 0.5
            sample = {
                "goal_id": goal_id,
                "position": [5.0 - 4.0 * cos(angle), 4.0 * sin(angle), -10.0],
                "velocity": [4.0 * rate * sin(angle), 4.0 * rate * cos(angle), 0.0],
                "yaw_deg": 45.0,
            }
            flight.service.reference_set(ReferenceSet.model_validate(sample), CALLER)
            next_s = flight.now_s + 0.05
            await flight.until(lambda next_s=next_s: flight.now_s >= next_s)
        await flight.result(goal_id)
        rest_s = flight.now_s + 1.5
        await flight.until(lambda: flight.now_s > rest_s)

    figure = style.figure(6.0)
    panels = figure.subplots(3, 3, height_ratios=(2.8, 1.0, 1.0))
    shown: tuple[tuple[str, Scenario], ...] = (
        ("path through: stop", to_its_end(path={"waypoints": given, "through": "stop"})),
        ("path through: fly_by", to_its_end(path={"waypoints": given, "through": "fly_by"})),
        ("stream at 20 Hz, silent after 10 s", streamed),
    )
    for column, (title, scenario) in enumerate(shown):
        flight = flown(scenario)
        above, below, speeds = (panels[row][column] for row in range(3))
        seen_from_above(above, title, flight)
        if "path" in title:
            above.plot([c[1] for c in corners], [c[0] for c in corners], "s", color=INK, ms=4, mfc="none")
        height_below(below, flight)
        speed = np.linalg.norm(flight.wanted("velocity_ned_m_s"), axis=1)
        over_time(speeds, "speed, m/s", flight, speed, flight.speeds_m_s)
        speeds.set_xlabel("time, s")
        below.set_xlabel("")
    panels[0][0].legend(loc="center")
    return figure


def headings() -> Figure:
    """Headings turn the shorter way, along their limits."""

    async def turned(flight: Flight) -> None:
        await flight.result(await flight.submit(waypoint={"mode": "only_orientation", "yaw_deg": 150.0}))
        await flight.result(await flight.submit(waypoint={"mode": "only_orientation", "yaw_deg": -120.0}))

    flight = flown(turned)
    figure = style.figure(3.2)
    angle, rate = figure.subplots(2, 1, sharex=True)
    wanted = np.degrees(np.unwrap(flight.wanted("yaw_rad")))
    over_time(angle, "heading, deg", flight, wanted, np.degrees(np.unwrap(flight.headings_rad)))
    over_time(rate, "heading rate,\ndeg/s", flight, np.degrees(flight.wanted("yaw_rate_rad_s")))
    for wound_deg, goal in ((150.0, "goal: 150 deg"), (240.0, "goal: -120 deg")):
        angle.axhline(wound_deg, color=MUTED, lw=0.8, ls=(0, (4, 3)))
        angle.annotate(goal, (0.0, wound_deg), (3, 3), textcoords="offset points", color=MUTED, fontsize=8.5)
    angle.set_ylim(-15.0, 280.0)
    angle.legend(loc="lower right")
    rate.set_xlabel("time, s")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "guidance-waypoint-modes": waypoint_modes,
    "guidance-profiles": profiles,
    "guidance-trajectories": trajectories,
    "guidance-paths": paths,
    "guidance-headings": headings,
}


def draw(name: str, directory: Path) -> Path:
    """Draw one figure as PNG."""
    path, drawn = directory / f"{name}.png", BytesIO()
    with style.styled():
        FIGURES[name]().savefig(drawn, dpi=DPI, facecolor="white")
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    return path


if __name__ == "__main__":
    for wanted_name in sys.argv[1:] or FIGURES:
        draw(wanted_name, IMAGES)
