"""One self-contained page about a flight: a summary in sentences, goals, pictures, events; light and dark."""

from html import escape
from pathlib import Path
from string import Template
from typing import Any

from daemon.recording import figures, flight, paths, style
from daemon.recording.analysis import GoalSummary, goals, summary, traces
from daemon.recording.drawing import MARKED, Scene
from daemon.recording.flight import Flight

PAGE = Path(__file__).with_name("report.html")


def write_report(files: list[Path], directory: Path) -> Path:
    """Write ``report.html``, ``flight.png`` and one PNG a picture into the directory; returns the page.

    ``files`` are the parts of one flight in order. Raises ``RecordError``.
    """
    found = flight.load(files)
    scene = scene_of(found)
    directory.mkdir(parents=True, exist_ok=True)
    sections = []
    for name, (title, draw) in figures.PICTURES.items():
        picture = draw(scene)
        (directory / f"{name}.png").write_bytes(style.png(picture))
        sections.append(f'<section><h2 id="{name}">{title}</h2>\n{style.svg(picture, name)}</section>')
    (directory / "flight.png").write_bytes(style.png(paths.overview(scene)))
    page = Template(PAGE.read_text()).substitute(
        title=escape(f"Flight {found.about.get('flight', files[0].stem)}"),
        light=_colours(0),
        dark=_colours(1),
        facts=_facts(found),
        summary="\n".join(f"<p>{escape(line)}</p>" for line in summary(found, scene.traces, scene.goals)),
        goals=_goals(scene.goals),
        pictures="\n".join(sections),
        events=_events(scene),
    )
    file = directory / "report.html"
    file.write_text(page)
    return file


def scene_of(found: Flight) -> Scene:
    """Traces, goals and events of a flight."""
    of_ticks = traces(found)
    zero_s = float(found.ticks["now_s"][0])
    events = sorted([*found.events, *map(_told, found.goals)], key=lambda event: float(event["time_s"]))
    return Scene(of_ticks, goals(found, of_ticks), events, zero_s)


def _told(note: dict[str, Any]) -> dict[str, Any]:
    """What became of a goal, as an event."""
    words = [note["goal_id"] or "", note.get("outcome") or "", note.get("field") or "", note.get("reason") or ""]
    return {"time_s": note["time_s"], "code": f"goal.{note['what']}", "text": " ".join(word for word in words if word)}


def _colours(which: int) -> str:
    return " ".join(f"--{name}: {pair[which]};" for name, pair in style.COLOURS.items())


def _facts(found: Flight) -> str:
    names = {"version": "version", "config_hash": "configuration"}
    return " · ".join(f"{label} {escape(str(found.about[key]))}" for key, label in names.items() if key in found.about)


def _goals(ended: list[GoalSummary]) -> str:
    if not ended:
        return "<p>No goal was submitted.</p>"
    head = ("goal", "kind", "outcome", "time", "final error", "largest error", "largest tilt")
    rows = []
    for number, goal in enumerate(ended, 1):
        duration = None if goal.end_s is None else goal.end_s - goal.begin_s
        outcome = escape(goal.outcome or "active") + (f" ({escape(goal.reason)})" if goal.reason else "")
        cells = (
            f"{number}",
            escape(goal.kind),
            outcome,
            _number(duration, "s", 1),
            f"{_number(goal.final_error_m, 'm', 2)}, {_number(goal.final_error_deg, '°', 1)}",
            _number(goal.largest_error_m, "m", 2),
            _number(goal.largest_tilt_deg, "°", 0),
        )
        rows.append(f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    heads = "".join(f"<th>{name}</th>" for name in head)
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _number(value: float | None, unit: str, digits: int) -> str:
    space = "" if unit == "°" else " "
    return "–" if value is None else f"{value:.{digits}f}{space}{unit}"


def _events(scene: Scene) -> str:
    rows = []
    for event in scene.events:
        mark = ' class="bad"' if event["code"] in MARKED else ""
        time_s = event["time_s"] - scene.zero_s
        rows.append(
            f"<tr{mark}><td>{time_s:.2f} s</td><td>{escape(event['code'])}</td><td>{escape(event['text'])}</td></tr>"
        )
    return f"<table class='events'><tbody>{''.join(rows)}</tbody></table>"
