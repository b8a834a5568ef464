import json
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.goals.errors import MAX_LINE_BYTES, ErrorCode, ProtocolError
from daemon.goals.lines import LineSplitter
from daemon.goals.methods import METHODS
from daemon.goals.protocol import (
    Call,
    Refusal,
    encode,
    encode_error,
    interpret,
    parse,
)


def ask(method, params=None, **envelope):
    return {"jsonrpc": "2.0", "id": 1, "method": method} | ({} if params is None else {"params": params}) | envelope


def refusal_of(method, params):
    found = interpret(json.loads(json.dumps(ask(method, params))), operator=True)
    assert isinstance(found, Refusal), found
    return found.error.code, found.error.field, found.error.reason


def submit(**goal):
    return refusal_of("goal.submit", goal)


def waypoint(**keys):
    return submit(waypoint={"position": [1, 2, -3]} | keys)


CIRCLE = {"kind": "circle", "center": [0, 0, -5], "radius_m": 3, "speed_m_s": 1}
TO_NOWHERE = {"heading": {"point": [1, 2]}}


@pytest.mark.parametrize(
    ("refused", "code", "field", "reason"),
    [
        (lambda: submit(), -32602, "waypoint", "is missing: give one of waypoint, path, trajectory and stream"),
        (lambda: submit(waypoint={}), -32602, "waypoint.position", "is missing"),
        (lambda: submit(waypoint=3), -32602, "waypoint", "must be an object, not a number"),
        (lambda: submit(stream={}, path={"waypoints": [{"position": [1, 2, 3]}]}), -32602, "stream", None),
        (lambda: submit(way={}), -32602, "way", "is not a known key"),
        (lambda: waypoint(position=[1, 2]), -32602, "waypoint.position[2]", "is missing"),
        (lambda: waypoint(position=[1, 2, 3, 4]), -32602, "waypoint.position", "must have at most 3 items, not 4"),
        (lambda: waypoint(position=[1, "2", 3]), -32602, "waypoint.position[1]", "must be a number, not a string"),
        (lambda: waypoint(position=[1, True, 3]), -32602, "waypoint.position[1]", "must be a number, not true"),
        (lambda: waypoint(position=[1, None, 3]), -32602, "waypoint.position[1]", "must be a number, not null"),
        (lambda: waypoint(position=[1, 10**400, 3]), -32602, "waypoint.position[1]", None),
        (lambda: waypoint(position="up"), -32602, "waypoint.position", "must be a list, not a string"),
        (lambda: waypoint(speed=3), -32602, "waypoint.speed", "is not a known key"),
        (
            lambda: waypoint(frame="moon"),
            -32602,
            "waypoint.frame",
            'must be "local_ned", "local_enu", "body_frd" or "global"',
        ),
        (lambda: waypoint(hold_s=-1), -32001, "waypoint.hold_s", "must be at least 0, not -1"),
        (lambda: waypoint(threshold=0), -32001, "waypoint.threshold", "must be greater than 0, not 0"),
        (lambda: waypoint(yaw_deg=1, orientation=[1, 0, 0, 0]), -32001, "waypoint.orientation", None),
        (lambda: waypoint(threshold=1, convergence={}), -32001, "waypoint.threshold", None),
        (lambda: waypoint(orientation=[2, 0, 0, 0]), -32001, "waypoint.orientation", None),
        (lambda: waypoint(orientation=[1e300, 0, 0, 0]), -32001, "waypoint.orientation", None),
        (lambda: waypoint(orientation=[0.9, 0.435889894354, 0, 0]), -32001, "waypoint.orientation", None),
        (lambda: waypoint(orientation=[1, 0, 0, 0], frame="local_enu"), -32001, "waypoint.orientation", None),
        (lambda: waypoint(position=[91, 8, 500], frame="global"), -32001, "waypoint.position[0]", None),
        (lambda: waypoint(convergence={"position_m": 0}, threshold="x"), -32602, "waypoint.threshold", None),
        (lambda: submit(path={"waypoints": []}), -32602, "path.waypoints", "must have at least 1 item, not 0"),
        (lambda: submit(path={"waypoints": [{}]}), -32602, "path.waypoints[0].position", "is missing"),
        (lambda: submit(trajectory={}), -32602, "trajectory.kind", "is missing"),
        (
            lambda: submit(trajectory={"kind": "knot"}),
            -32602,
            "trajectory.kind",
            'must be "circle", "lemniscate", "polynomial" or "hold"',
        ),
        (lambda: submit(trajectory=CIRCLE | {"radius_m": 0}), -32001, "trajectory.radius_m", None),
        (lambda: submit(trajectory=CIRCLE | {"period_s": 4}), -32001, "trajectory.period_s", None),
        (lambda: submit(trajectory=CIRCLE | {"axis": [0, 0, 0]}), -32001, "trajectory.axis", "must have a length"),
        (lambda: submit(trajectory=CIRCLE | {"heading": "up"}), -32602, "trajectory.heading", None),
        (
            lambda: submit(trajectory=CIRCLE | {"heading": {"point": [1, 2]}}),
            -32602,
            "trajectory.heading.point[2]",
            None,
        ),
        (
            lambda: submit(trajectory=CIRCLE | {"heading": {"point": [1, 2, 3], "x": 1}}),
            -32602,
            "trajectory.heading.x",
            "is not a known key",
        ),
        (lambda: submit(trajectory=CIRCLE | {"circle": 1}), -32602, "trajectory.circle", "is not a known key"),
        (lambda: submit(trajectory=CIRCLE | {"circle": {"axis": 1}, "axis": 1}), -32602, "trajectory.axis", None),
        (lambda: refusal_of("vehicle.takeoff", {"altitude_m": 0}), -32001, "altitude_m", None),
        (lambda: refusal_of("vehicle.takeoff", {}), -32602, "altitude_m", "is missing"),
        (lambda: refusal_of("vehicle.land", {"now": True}), -32602, "now", "is not a known key"),
        (lambda: refusal_of("telemetry.subscribe", {"topics": ["smell"]}), -32602, "topics[0]", None),
        (lambda: refusal_of("telemetry.subscribe", {"topics": ["state"], "rate_hz": 51}), -32001, "rate_hz", None),
        (lambda: refusal_of("config.set", {"path": "a", "value": {}}), -32602, "value", None),
        (lambda: refusal_of("goal.get", {"goal_id": ""}), -32602, "goal_id", "must have at least 1 character, not 0"),
        (lambda: refusal_of("goal.get", {"goal_id": "\ud800"}), -32602, "goal_id", "must be text that Unicode has"),
        (lambda: refusal_of("goal.get", {"goal_id": 3}), -32602, "goal_id", "must be a string, not a number"),
        (lambda: refusal_of("status.get", [1]), -32602, "params", "must be an object, not a list"),
    ],
)
def test_wrong_parameters_are_named_by_field_and_reason(refused, code, field, reason):
    found = refused()
    assert found[:2] == (code, field), found
    assert reason is None or found[2] == reason


@pytest.mark.parametrize(
    ("message", "code", "field"),
    [
        ({}, -32600, "jsonrpc"),
        (3, -32600, None),
        ({"jsonrpc": "1.0", "id": 1, "method": "status.get"}, -32600, "jsonrpc"),
        (ask("status.get", more=1), -32600, "more"),
        (ask(7), -32600, "method"),
        (ask("status.get", id=True), -32600, "id"),
        (ask("status.get", id=None), -32600, "id"),
        (ask("status.get", id={}), -32600, "id"),
        (ask("status.get", id=float("inf")), -32600, "id"),
        (ask("status.get", id="x" * 300), -32600, "id"),
        ({"jsonrpc": "2.0", "method": "status.get"}, -32600, "id"),
        (ask("reference.set", {}), -32600, "id"),
        (ask("status.got"), -32601, "method"),
    ],
)
def test_wrong_envelopes_are_refused(message, code, field):
    found = interpret(message, operator=True)
    assert isinstance(found, Refusal) and found.reply
    assert (found.error.code, found.error.field) == (code, field)


@pytest.mark.parametrize(
    "line",
    [b"{", b"\xff\xfe", b"NaN", b'{"a": Infinity}', b"-Infinity", b"[" * 30000, b'{"a":' * 9000, b"1" * 5000, b"\x00"],
)
def test_what_is_not_json_is_a_parse_error(line):
    with pytest.raises(ProtocolError) as caught:
        parse(line)
    assert caught.value.code == ErrorCode.PARSE


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"1" * 5000, "not JSON that can be read: it has a number of too many digits"),
        (b"\xff\xfe", "not JSON: it is not UTF-8"),
        (b"[NaN]", "not JSON: NaN is not JSON"),
        (b'\xef\xbb\xbf{"id": 1}', "not JSON: the line begins with a byte order mark (UTF-8 BOM); send none"),
        (b"[1,", "not JSON: Expecting value: line 1 column 4 (char 3)"),
    ],
)
def test_what_is_not_json_is_told_without_the_daemons_insides(line, reason):
    with pytest.raises(ProtocolError) as caught:
        parse(line)
    assert caught.value.reason == reason


@pytest.mark.parametrize("field", ["jsonrpc", "method"])
def test_what_a_request_lacks_is_missing(field):
    found = interpret({key: value for key, value in ask("status.get").items() if key != field}, operator=True)
    assert (found.error.code, found.error.field, found.error.reason) == (-32600, field, "is missing")


def test_empty_batch_is_not_a_request():
    with pytest.raises(ProtocolError) as caught:
        parse(b"[]")
    assert caught.value.code == ErrorCode.INVALID_REQUEST


def test_notification_that_is_wrong_is_not_replied_to():
    found = interpret({"jsonrpc": "2.0", "method": "reference.set", "params": {"goal_id": "a"}}, operator=True)
    assert isinstance(found, Refusal) and not found.reply


OBSERVERS = {
    "system.info",
    "status.get",
    "goal.get",
    "telemetry.subscribe",
    "telemetry.unsubscribe",
    "config.get",
}


@pytest.mark.parametrize("name", list(METHODS))
def test_observers_only_read(name):
    message = {"jsonrpc": "2.0", "method": name} | ({} if METHODS[name].notification else {"id": 1})
    found = interpret(message, operator=False)
    refused = isinstance(found, Refusal) and found.error.code == ErrorCode.NOT_PERMITTED
    assert refused == (name not in OBSERVERS)


def test_tilt_of_a_degree_is_let_through():
    half = 0.5 * 0.99 * 3.141592653589793 / 180
    orientation = [(1 - half * half) ** 0.5, half, 0, 0]
    found = interpret(
        ask("goal.submit", {"waypoint": {"position": [1, 2, 3], "orientation": orientation}}), operator=True
    )
    assert isinstance(found, Call)


def test_numbers_that_are_not_finite_become_null():
    line = encode({"a": [1.0, float("nan")], "b": {"c": float("inf")}, "d": (float("-inf"), 2)})
    assert json.loads(line) == {"a": [1.0, None], "b": {"c": None}, "d": [None, 2]}


BYTES = st.lists(st.sampled_from([b"\n", b"a", b"bc", b" ", b"\r\n"]), max_size=60).map(b"".join)


@settings(deadline=None, max_examples=200)
@given(BYTES, st.lists(st.integers(0, 100), max_size=8))
def test_lines_are_the_same_however_the_bytes_are_cut(data, cuts):
    whole, cut = LineSplitter(), LineSplitter()
    whole.feed(data)
    expected = lines_of(whole)
    found = []
    edges = [0, *sorted(min(c, len(data)) for c in cuts), len(data)]
    for begin, end in pairwise(edges):
        cut.feed(data[begin:end])
        found += lines_of(cut)
    assert found == expected == [line.strip() for line in data.split(b"\n")[:-1]]


def lines_of(splitter):
    lines = []
    while (line := splitter.take()) is not None:
        lines.append(line)
    return lines


@pytest.mark.parametrize("end", [b"", b"\n"])
def test_line_of_the_limit_passes_and_a_longer_one_does_not(end):
    splitter = LineSplitter()
    splitter.feed(b"x" * MAX_LINE_BYTES + b"\n")
    assert len(splitter.take()) == MAX_LINE_BYTES
    splitter.feed(b"x" * (MAX_LINE_BYTES + 1) + end)
    with pytest.raises(ProtocolError) as caught:
        splitter.take()
    assert caught.value.code == ErrorCode.INVALID_REQUEST


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
envelopes = st.fixed_dictionaries(
    {"jsonrpc": st.just("2.0") | json_values, "method": st.sampled_from(list(METHODS)) | json_values},
    optional={"id": json_values, "params": json_values | st.dictionaries(st.sampled_from(
        ["waypoint", "path", "trajectory", "stream", "goal_id", "topics", "position", "value", "limits"]
    ), json_values)},
)  # fmt: skip


@settings(deadline=None, max_examples=600)
@given(st.binary(max_size=200) | (envelopes | json_values).map(lambda v: json.dumps(v).encode()), st.booleans())
def test_no_line_does_more_than_be_refused(line, operator):
    try:
        messages, _ = parse(line)
    except ProtocolError as error:
        assert error.code in (ErrorCode.PARSE, ErrorCode.INVALID_REQUEST)
        return
    for message in messages:
        found = interpret(message, operator=operator)
        if isinstance(found, Refusal):
            reply = json.loads(encode_error(found.id, found.error))
            assert reply["error"]["data"]["reason"]
            assert len(reply["error"]["message"]) < 500
