import errno
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from daemon.pipeline import Record
from daemon.recording import flight, writer
from daemon.recording.codec import RecordError
from daemon.recording.recorder import BACKLOG, Recorder, RecordingSettings

Run = Callable[..., list[Path]]


def test_every_tick_is_recorded_with_every_bit(record: Run, fly: Callable[..., None]) -> None:
    records: list[Record] = []
    fly(300, lambda state, inputs, made: records.append(made))
    ticks = flight.load(record(300)).ticks
    wanted = records[1:]  # the first tick is where a replay begins
    assert ticks["now_s"].tolist() == [r.now_s for r in wanted]
    assert ticks["setpoint_rates_frd_rad_s"].tolist() == [
        list(r.setpoint.rates_frd_rad_s) if r.setpoint else [0.0] * 3 for r in wanted
    ]
    assert ticks["has_setpoint"].tolist() == [r.setpoint is not None for r in wanted]
    assert ticks.names("supervision_state") == [r.supervision.state.value for r in wanted]
    assert ticks.text("supervision_reason") == [r.supervision.reason for r in wanted]


def test_a_record_that_power_loss_cuts_off_is_read_to_its_last_second(record: Run, tmp_path: Path) -> None:
    whole = record(200)[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    read = []
    for length in [*range(0, len(whole), len(whole) // 40), *range(len(whole) - 40, len(whole))]:
        cut.write_bytes(whole[:length])
        try:
            read.append(len(flight.load([cut]).ticks.rows))
        except RecordError:
            read.append(0)
    assert read[-1] == 199
    assert read == sorted(read)


@pytest.mark.parametrize("rest", [bytes(50_000), b"\xff" * 50_000])
def test_blocks_that_power_loss_left_unwritten_end_the_record(
    record: Run, tmp_path: Path, rest: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    whole = record(400)[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2] + rest)
    assert len(flight.load([cut]).ticks.rows) > 20  # how many a chunk holds, the writer's thread decides


def test_the_disk_has_all_but_the_last_second_while_the_flight_goes_on(
    tmp_path: Path, fly: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    fly(200, lambda *step: made.tick(writer.Step(*step)))
    made.flush_if_due()
    (file,) = tmp_path.glob("*.mcap")
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(file.read_bytes())
    assert len(flight.load([copy]).ticks.rows) == 199
    made.close()


def test_a_flight_has_its_own_record_with_the_seconds_around_it(record: Run) -> None:
    files = record(900, armed=lambda tick: 300 <= tick < 500, when="armed", before_s=1.0, after_s=2.0)
    (file,) = files
    times = flight.load([file]).ticks["now_s"]
    assert times[0] == pytest.approx(100.0 + 3.0 - 1.0 + 0.01, abs=0.011)
    assert times[-1] == pytest.approx(100.0 + 5.0 + 2.0, abs=0.03)


def test_two_flights_make_two_records(record: Run) -> None:
    files = record(1200, armed=lambda tick: tick % 600 > 300, when="armed", before_s=0.5, after_s=0.5)
    assert len(files) == 2
    assert len({flight.load([file]).about["flight"] for file in files}) == 2


def test_without_arming_nothing_is_written(record: Run) -> None:
    assert record(100, armed=lambda tick: False, when="armed") == []


def test_a_full_file_is_followed_by_the_next_part_of_the_flight(record: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    files = record(1500, max_file_mb=0.03)
    assert len(files) > 1
    parts = [flight.load([file]) for file in sorted(files, key=lambda f: int(f.stem.split("part")[1]))]
    assert len({part.about["flight"] for part in parts}) == 1
    times = np.concatenate([part.ticks["now_s"] for part in parts])
    assert (np.diff(times) > 0).all()
    assert len(times) == 1500 - len(parts)


def test_the_oldest_records_make_room(tmp_path: Path, record: Run) -> None:
    old = tmp_path / "20200101T000000Z-part1.mcap"
    old.write_bytes(bytes(2_000_000))
    other = tmp_path / "notes.txt"
    other.write_text("mine")
    record(50, keep_mb=3.0, max_file_mb=2.0)
    assert not old.exists()
    assert other.exists()
    assert len(list(tmp_path.glob("*.mcap"))) == 1


def test_a_hanging_disk_drops_and_counts_and_never_blocks_the_loop(
    tmp_path: Path, fly: Callable[..., None], close: Callable[[Recorder], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    release = threading.Event()
    slow = writer.RecordWriter.tick
    monkeypatch.setattr(writer.RecordWriter, "tick", lambda self, step: (release.wait(120.0), slow(self, step))[1])
    made = Recorder(RecordingSettings(directory=tmp_path, when="always"), {}, clock=lambda: 0.0)
    made.start()
    fly(BACKLOG + 200, made.tick)
    assert made.report.dropped >= 199
    release.set()
    close(made)
    (file,) = tmp_path.glob("*.mcap")
    assert len(flight.load([file]).ticks.rows) >= BACKLOG - 1


def test_after_a_gap_the_record_says_so_and_a_replay_can_begin_anew(tmp_path: Path, fly: Callable[..., None]) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    steps: list[Any] = []
    fly(100, lambda *step: steps.append(writer.Step(*step)))
    for step in steps[:40]:
        made.tick(step)
    made.gap(20, 0.0)
    for step in steps[60:]:
        made.tick(step)
    made.close()
    (file,) = tmp_path.glob("*.mcap")
    topics = [part.topic for part in flight.messages(file)]
    assert topics.count("/flightd/start") == 2
    assert "record_gap" in [event["code"] for event in flight.load([file]).events]


def test_a_full_disk_is_survived_and_recording_resumes(
    tmp_path: Path, fly: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "RETRY_S", 0.0)
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    full = True

    def fsync(descriptor: int) -> None:
        if full:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer.os, "fsync", fsync)

    def tick(*step: Any) -> None:
        nonlocal full
        made.tick(writer.Step(*step))
        made.flush_if_due()
        full = made.failures < 3

    fly(100, tick)
    made.close()
    assert made.failures == 3
    assert made.written > 80


def test_a_directory_that_cannot_be_made_costs_the_record_only(
    tmp_path: Path, fly: Callable[..., None], close: Callable[[Recorder], None]
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    made = Recorder(RecordingSettings(directory=blocked / "records", when="always"), {}, clock=lambda: 0.0)
    made.start()
    fly(50, made.tick)
    close(made)
    assert made.report.failures >= 1
    assert made.report.written == 0


def test_a_directory_that_takes_no_files_is_told_before_a_flight_until_it_does(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    made = writer.RecordWriter(RecordingSettings(directory=blocked / "records"), {}, lambda: 0.0)
    made.check()
    assert made.trouble == f"no flight record is written to {blocked}/records: Not a directory"
    made._retry_s = 0.0
    blocked.unlink()
    made.flush_if_due()
    assert made.trouble is None
    assert list((blocked / "records").iterdir()) == []


def test_trouble_is_warned_of_and_gaps_stay_told(tmp_path: Path, fly: Callable[..., None]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    made = Recorder(RecordingSettings(directory=blocked / "records", when="always"), {}, clock=lambda: 0.0)
    assert made.warning is None
    made._writer.check()
    assert made.warning is not None and "Not a directory" in made.warning
    blocked.unlink()
    made._writer.check()
    fly(1100, made.tick)  # more than the backlog takes
    assert made.warning == "the flight record has gaps: writing failed (1), entries were dropped (100)"


def test_no_directory_is_made_where_no_files_are_wanted(tmp_path: Path) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path / "records", enabled=False), {}, lambda: 0.0)
    made.check()
    assert list(tmp_path.iterdir()) == []


def test_events_goals_and_plans_are_kept(record: Run) -> None:
    def notes(made: Recorder) -> None:
        made.event("goal_refused", "outside the fence", field="waypoint.position[2]")
        made.goal("submitted", "g-1", {"kind": "waypoint"})
        made.goal("ended", "g-1", {"outcome": "succeeded", "error_m": 0.1})
        made.plan(
            {
                "time_s": 101.0,
                "goal_id": "g-1",
                "spacing_s": 0.1,
                "positions_ned_m": [[0.0, 0.0, -5.0], [1.0, 0.0, -5.0]],
            }
        )

    found = flight.load(record(50, notes=notes))
    assert ("goal_refused", "outside the fence") in [(e["code"], e["text"]) for e in found.events]
    assert [(g["what"], g["goal_id"]) for g in found.goals] == [("submitted", "g-1"), ("ended", "g-1")]
    assert found.plans[0]["positions_ned_m"][1] == [1.0, 0.0, -5.0]
    assert found.about["config_hash"] == "abc"


def test_what_a_tick_tells_becomes_events(tmp_path: Path, fly: Callable[..., None]) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    fly(150, lambda *step: made.tick(writer.Step(*step)))
    made.close()
    (file,) = tmp_path.glob("*.mcap")
    events = [(e["code"], e["text"]) for e in flight.load([file]).events]
    assert events == [
        ("mode", "autopilot mode hold"),
        ("armed", "armed"),
        ("landed_state", "in air"),
        ("mode", "autopilot mode offboard"),
    ]


def test_a_file_that_is_no_record_is_refused_in_words(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    file.write_text("hello, this is not a record at all")
    with pytest.raises(RecordError, match="is not a flight record"):
        flight.load([file])
    with pytest.raises(RecordError, match="No such file"):
        flight.load([tmp_path / "none.mcap"])


def test_what_happened_just_before_a_flight_is_in_its_record(tmp_path: Path, fly: Callable[..., None]) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, before_s=1.0), {}, lambda: 0.0)
    ticks = 0

    def tick(*step: Any) -> None:
        nonlocal ticks
        ticks += 1
        if ticks in (50, 250):
            event = {"time_s": step[2].now_s, "code": f"at_{ticks}", "text": "", "goal_id": None}
            made.note(writer.Note("event", step[2].now_s, event))
        made.tick(writer.Step(*step))

    fly(400, tick, armed=lambda tick: tick > 300)
    made.close()
    (file,) = tmp_path.glob("*.mcap")
    codes = [event["code"] for event in flight.load([file]).events]
    assert "at_250" in codes
    assert "at_50" not in codes


def test_a_flight_begins_at_the_wall_time_that_is_known_by_then(tmp_path: Path, fly: Callable[..., None]) -> None:
    wall_s = 0.0
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path), {}, lambda: wall_s)

    def tick(*step: Any) -> None:
        nonlocal wall_s
        wall_s = 1.8e9 if step[2].now_s > 102.0 else 0.0
        made.tick(writer.Step(*step))

    fly(400, tick, armed=lambda tick: tick > 300)
    made.close()
    (file,) = tmp_path.glob("*.mcap")
    assert file.name.startswith("20270115T08")
    with file.open("rb") as stream:
        assert all(message.log_time > 1.8e18 for _, _, message in make_reader(stream).iter_messages())
