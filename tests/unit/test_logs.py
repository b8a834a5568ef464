"""Log lines: JSON off the terminal, the flight's id, repeats left out and counted."""

import io
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import structlog

from daemon import logs
from daemon.logs import BURST, WINDOW_S, Repeats


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    yield
    logs.flight.source = lambda: None
    structlog.reset_defaults()


def lines(stream: io.StringIO) -> list[dict[str, object]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_off_a_terminal_each_event_is_one_json_line_with_its_part_and_level() -> None:
    stream = io.StringIO()
    logs.configure("info", stream)
    logs.get("link").warning("lost", since_s=0.5)
    logs.get("link").debug("not written")
    (line,) = lines(stream)
    assert (line["part"], line["event"], line["level"], line["since_s"]) == ("link", "lost", "warning", 0.5)
    assert str(line["timestamp"]).endswith("Z")


def test_what_happened_comes_first_in_a_line() -> None:
    stream = io.StringIO()
    logs.configure("info", stream)
    logs.get("link").warning("lost", since_s=0.5)
    assert stream.getvalue().startswith('{"event": "lost", "level": "warning", "part": "link"')


@pytest.mark.parametrize("connected", [True, False])
def test_in_the_journal_each_line_has_its_level_and_nowhere_else(
    connected: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "log"
    with file.open("w") as stream:
        found = os.fstat(stream.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{found.st_dev}:{found.st_ino + (0 if connected else 1)}")
        logs.configure("debug", stream)
        for level in ("debug", "info", "warning", "error", "critical"):
            getattr(logs.get("link"), level)("said")
    prefixes = [line.partition("{")[0] for line in file.read_text().splitlines()]
    assert prefixes == (["<7>", "<6>", "<4>", "<3>", "<2>"] if connected else [""] * 5)


def test_every_line_of_a_flight_carries_its_id() -> None:
    stream = io.StringIO()
    logs.configure("info", stream)
    logs.get("a").info("before")
    logs.flight.source = lambda: "20260101T000000Z"
    logs.get("b").info("during")
    before, during = lines(stream)
    assert "flight" not in before
    assert during["flight"] == "20260101T000000Z"


def test_repeats_are_left_out_and_counted() -> None:
    now = [0.0]
    repeats = Repeats(lambda: now[0])
    passed = 0
    for i in range(500):
        now[0] = i * 0.01
        try:
            repeats(None, "warning", {"part": "link", "event": "rebooted", "count": i})
            passed += 1
        except structlog.DropEvent:
            pass
    assert passed == BURST
    assert repeats(None, "warning", {"part": "link", "event": "other"}) == {"part": "link", "event": "other"}
    now[0] = WINDOW_S + 1.0
    assert repeats(None, "warning", {"part": "link", "event": "rebooted"})["left_out"] == 500 - BURST


def test_a_reader_that_went_away_costs_lines_and_raises_nothing() -> None:
    class Gone(io.StringIO):
        def write(self, _text: str) -> int:
            raise BrokenPipeError

    logs.configure("info", Gone())
    logs.get("test").info("nobody reads this")
