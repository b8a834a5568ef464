import json
from collections.abc import Callable

import pytest

from daemon.pipeline import Inputs, Parameters, PipelineState, Record
from daemon.recording import codec
from daemon.recording.codec import Decoder, NotEncodableError, RecordError
from daemon.recording.topics import Start


def test_the_flows_memory_and_inputs_come_back_as_they_were(fly: Callable[..., None]) -> None:
    kept: list[tuple[PipelineState, Inputs]] = []
    fly(120, lambda state, inputs, record: kept.append((state, inputs)), reset_at=100)
    for state, inputs in (kept[0], kept[50], kept[-1]):
        written = codec.text(Start(state, inputs))
        again = Decoder().decode(Start, json.loads(written))
        assert codec.text(again) == written
        assert again.inputs.status == inputs.status
        assert again.inputs.parameters.control == inputs.parameters.control


def test_a_message_that_the_estimator_has_seen_is_the_same_object_again(fly: Callable[..., None]) -> None:
    kept: list[tuple[PipelineState, Inputs]] = []
    fly(5, lambda state, inputs, record: kept.append((state, inputs)))
    again = Decoder().decode(Start, json.loads(codec.text(Start(*kept[-1]))))
    assert again.state.estimator.intake.seen is again.inputs.odometry


@pytest.mark.parametrize("number", [float("inf"), float("-inf"), 0.1 + 0.2, 5e-324, 1.7976931348623157e308])
def test_floats_keep_every_bit(number: float) -> None:
    assert Decoder().decode(float, json.loads(codec.text(number))) == number


def test_json_has_no_literals_that_viewers_refuse() -> None:
    assert codec.text((float("nan"), float("inf"))) == '["nan","inf"]'


def test_a_field_that_this_version_does_not_know_is_named() -> None:
    with pytest.raises(RecordError, match="Parameters has no field gone"):
        Decoder().decode(Parameters, {"gone": 1})


def test_what_has_no_written_form_is_named() -> None:
    with pytest.raises(NotEncodableError, match="object"):
        codec.text(object())


def test_records_are_not_decoded_by_accident(fly: Callable[..., None]) -> None:
    records: list[Record] = []
    fly(1, lambda state, inputs, record: records.append(record))
    with pytest.raises(RecordError):
        Decoder().decode(Record, {"now_s": 1.0})
