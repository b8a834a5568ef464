from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.pipeline import Parameters
from daemon.recording import flight, replay, writer
from daemon.recording.codec import RecordError
from daemon.recording.recorder import RecordingSettings
from daemon.recording.topics import WINDOW, pack_window, unpack_window

Run = Callable[..., list[Path]]


def test_a_flight_with_a_reset_comes_out_the_same_to_the_last_bit(tmp_path: Path, fly: Callable[..., None]) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    fly(300, lambda *step: made.tick(writer.Step(*step)), reset_at=150)
    made.close()
    found = replay.compare(list(tmp_path.glob("*.mcap")))
    assert found.ticks == 299
    assert found.identical, found


@pytest.mark.parametrize("no_window", [range(95, 98), range(150, 300), range(50)])
def test_a_window_that_is_withdrawn_is_none_in_the_replay_too(
    tmp_path: Path, fly: Callable[..., None], no_window: range
) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    fly(300, lambda *step: made.tick(writer.Step(*step)), no_window=no_window)
    made.close()
    found = replay.compare(list(tmp_path.glob("*.mcap")))
    assert found.identical, found


def test_each_part_of_a_flight_can_be_replayed_alone(record: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "FLUSH_S", 0.0)
    for file in record(800, max_file_mb=0.03):
        assert replay.compare([file]).identical


def test_a_replay_goes_on_after_a_gap(tmp_path: Path, fly: Callable[..., None]) -> None:
    made = writer.RecordWriter(RecordingSettings(directory=tmp_path, when="always"), {}, lambda: 0.0)
    steps: list[Any] = []
    fly(200, lambda *step: steps.append(writer.Step(*step)))
    for step in steps[:90]:
        made.tick(step)
    made.gap(20, 0.0)
    for step in steps[110:]:
        made.tick(step)
    made.close()
    found = replay.compare(list(tmp_path.glob("*.mcap")))
    assert (found.ticks, found.identical) == (89 + 89, True)


def test_another_parameter_shows_where_it_counts(record: Run) -> None:
    def stiffer(parameters: Parameters) -> Parameters:
        return replace(parameters, control=replace(parameters.control, position_gain_1_s2=(9.0, 9.0, 9.0)))

    found = replay.compare(record(200), stiffer)
    fields = {difference.field for difference in found.differences}
    assert not found.identical
    assert "control_feedback_ned_m_s2" in fields
    assert "estimate_newest_position_ned_m" not in fields
    assert all(difference.first_s >= 100.6 for difference in found.differences)


def test_one_bit_of_one_tick_is_noticed(record: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    files = record(100)
    step, count = replay.pipeline.step, 0

    def nudged(*arguments: Any) -> Any:
        nonlocal count
        state, setpoint, made = step(*arguments)
        count += 1
        return state, setpoint, replace(made, dt_s=made.dt_s + 2e-18) if count == 50 else made

    monkeypatch.setattr(replay.pipeline, "step", nudged)
    (difference,) = replay.compare(files).differences
    assert (difference.field, difference.ticks) == ("dt_s", 1)
    assert difference.largest == pytest.approx(1.7e-18, rel=0.1)


def test_windows_come_back_as_they_were(fly: Callable[..., None]) -> None:
    windows: list[Any] = []
    fly(1, lambda state, inputs, made: windows.append(inputs.window))
    packed = pack_window(windows[0])
    form = flight.Form.of(WINDOW.definition)
    again = unpack_window(form.values(packed), packed, form.end_of_strings(packed))
    assert again is not None
    assert pack_window(again) == packed
    assert again.samples[7].jerk_ned_m_s3 == windows[0].samples[7].jerk_ned_m_s3
    assert again.goal_id == "goal-1"


def test_a_record_without_a_beginning_says_so(tmp_path: Path, record: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay.Replay, "_take", lambda self, part: None)
    with pytest.raises(RecordError, match="nothing that can be replayed"):
        replay.compare(record(20))
