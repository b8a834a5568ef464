import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from daemon.recording import analysis, figures, flight, report, style, writer
from daemon.recording.codec import RecordError
from daemon.recording.drawing import mark_targets, numbered, together
from daemon.recording.recorder import Recorder, RecordingSettings
from daemon.recording.topics import Step

Run = Callable[..., list[Path]]


def goal_notes(made: Recorder) -> None:
    made.goal("submitted", "goal-1", {"waypoint": {"position": [4.0, 3.0, -5.0]}})
    made.goal("ended", "goal-1", {"outcome": "succeeded", "error_m": 0.12, "error_deg": 1.5})
    made.plan({"goal_id": "goal-1", "spacing_s": 0.1, "positions_ned_m": [[0.0, 0.0, -5.0], [4.0, 3.0, -5.0]]})
    made.goal("refused", None, {"field": "waypoint.position[2]", "reason": "beyond the <fence>"})


@pytest.fixture(scope="module")
def folder(record_into: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("flight")
    return report.write_report(record_into(directory, 400, notes=goal_notes), directory / "report").parent


@pytest.fixture
def page(folder: Path) -> str:
    return (folder / "report.html").read_text()


def test_the_page_needs_nothing_from_outside(page: str) -> None:
    assert re.findall(r'(?:src|href)="(?!#)[^"]*"', page.replace("xlink:", "")) == []
    assert "@import" not in page
    assert "url(http" not in page


def test_each_picture_is_sound_svg_with_colours_of_the_page(page: str) -> None:
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(drawings) == len(figures.PICTURES)
    for drawing in drawings:
        ElementTree.fromstring(drawing.replace("xlink:", ""))
        assert "var(--" in drawing
        assert not any(light in drawing for light, _ in style.COLOURS.values())


def test_no_text_of_a_picture_begins_with_a_space_that_browsers_drop(page: str) -> None:
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", page)
    assert len(texts) > 100
    assert [text for text in texts if text.startswith(" ")] == []


def test_both_themes_name_each_colour(page: str) -> None:
    light, dark = re.search(r":root \{(.*?)\}\n@media.*?:root \{(.*?)\}", page, re.DOTALL).groups()  # type: ignore[union-attr]
    for name in style.COLOURS:
        assert f"--{name}:" in light
        assert f"--{name}:" in dark


def test_goals_and_events_are_told_and_escaped(page: str) -> None:
    assert "succeeded" in page
    assert "<td>waypoint</td>" in page
    assert "0.12 m, 1.5°" in page
    assert "<td>goal.refused</td><td>waypoint.position[2] beyond the &lt;fence&gt;</td>" in page


def test_pictures_are_written_beside_the_page(folder: Path) -> None:
    for name in [*figures.PICTURES, "flight"]:
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_record_of_the_ground_alone_has_a_page_too(record: Run, tmp_path: Path) -> None:
    page = report.write_report(record(20, armed=lambda tick: False), tmp_path / "report").read_text()
    assert "No goal was submitted" in page


@pytest.mark.parametrize("every", [1, 2])
def test_times_and_missed_ticks_follow_the_rate_that_was_configured(record: Run, every: int) -> None:
    found = flight.load(record(400, every=every))
    lines = " ".join(analysis.summary(found, analysis.traces(found), []))
    assert "The record covers 4.0 s, 3.7 s of them under the daemon's control" in lines
    assert f"The control period was {10 * every:.2f} ms" in lines
    assert "no ticks missed" in lines


def test_a_record_without_its_configuration_is_refused_in_words(record: Run) -> None:
    found = flight.load(record(100))
    found.about = {}
    with pytest.raises(RecordError, match="does not hold the configuration"):
        analysis.summary(found, analysis.traces(found), [])


@pytest.mark.parametrize("in_space", [False, True])
def test_a_goal_that_was_left_is_a_hollow_dot(record: Run, in_space: bool) -> None:
    def notes(made: Recorder) -> None:
        for goal_id, north_m, outcome in (("left", 9.0, "preempted"), ("reached", 4.0, "succeeded")):
            made.goal("submitted", goal_id, {"waypoint": {"position": [north_m, 3.0, -5.0]}})
            made.plan({"goal_id": goal_id, "spacing_s": 0.1, "positions_ned_m": [[north_m, 3.0, -5.0]]})
            made.goal("ended", goal_id, {"outcome": outcome})

    scene = report.scene_of(flight.load(record(100, notes=notes)))
    axes = style.figure(4.0).add_subplot(projection="3d" if in_space else None)
    mark_targets(axes, scene, in_space=in_space)
    dots = {str(line.get_label()): line for line in axes.get_lines()}
    assert dots["goal"].get_markerfacecolor() == style.INK
    assert dots["goal, not reached"].get_markerfacecolor() == "none"
    assert [text.get_text().strip() for text in axes.texts] == ["1", "2"]


def test_the_page_names_the_flight_once(page: str) -> None:
    (flight_id,) = re.findall("<title>Flight (.*)</title>", page)
    assert page.count(flight_id) == 2  # and in the title of the window


def test_resets_and_refusals_are_counted(tmp_path: Path, fly: Callable[..., None]) -> None:
    about = {"config": {"loops": {"control_rate_hz": 100.0}}}
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), about, lambda: 0.0)
    fly(200, lambda *step: made.tick(Step(*step)), reset_at=120)
    made.close()
    found = flight.load(list(tmp_path.glob("*.mcap")))
    lines = analysis.summary(found, analysis.traces(found), [])
    assert lines[-1].startswith("1 reset of the autopilot's estimate")


def test_errors_are_those_of_the_record(record: Run) -> None:
    found = flight.load(record(400))
    traces = analysis.traces(found)
    flown = found.ticks["has_control"]
    by_hand = np.hypot.reduce(found.ticks["control_position_error_ned_m"][flown], axis=1)
    assert np.nanmax(traces.distance_m) == pytest.approx(by_hand.max())
    assert traces.tracking.sum() == flown.sum()
    line = next(line for line in analysis.summary(found, traces, []) if line.startswith("It kept"))
    assert f"within {by_hand.max():.2f} m" in line


def test_thinning_keeps_the_peaks() -> None:
    time_s = np.arange(100_000) * 0.01
    values = np.zeros(100_000)
    values[54_321], values[77_777] = 9.0, -7.0
    thin_time, thin = style.thinned(time_s, values)
    assert len(thin) < 3000
    assert (thin.max(), thin.min()) == (9.0, -7.0)
    assert thin_time[thin.argmax()] == time_s[54_321]
    assert (np.diff(thin_time) >= 0).all()


def test_stretches_of_equal_states_are_joined() -> None:
    assert analysis.spans(np.arange(5.0), ["a", "a", "b", "b", "a"]) == [
        (0.0, 2.0, "a"),
        (2.0, 4.0, "b"),
        (4.0, 4.0, "a"),
    ]


def test_goals_that_lie_close_together_share_a_number():
    places = [(0.0,), (5.0,), (5.1,), (5.2,), (5.3,), (9.0,), (0.1,)]
    groups = together(places, 0.5)
    assert [numbered(group) for group in groups] == ["1, 7", "2–5", "6"]
