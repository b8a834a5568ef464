import struct
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pytest

from daemon.messages import Odometry
from daemon.pipeline import Record
from daemon.recording.flight import Form
from daemon.recording.layout import Layout, parse_definition


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Inner:
    vector: tuple[float, float, float]
    count: int
    word: str


@dataclass(frozen=True)
class Outer:
    flag: bool
    colour: Colour
    inner: Inner
    value: float
    maybe: Inner | None = None
    number: int | None = None
    words: tuple[str, ...] = ()
    kinds: frozenset[str] = frozenset()


OUTER = Layout(Outer, "test/Outer")
FORM = Form.of(OUTER.definition)


def test_numbers_lie_where_cdr_wants_them_written_out_by_hand() -> None:
    packed = OUTER.pack(Outer(True, Colour.BLUE, Inner((1.5, -2.5, 0.1), 7, "hi"), 3.25))
    by_hand = b"\x00\x01\x00\x00" + struct.pack(
        "<d3d3dqqqB???", 3.25, 1.5, -2.5, 0.1, 0.0, 0.0, 0.0, 7, 0, 0, 1, False, False, True
    )
    assert packed.startswith(by_hand)
    offset = len(by_hand) - 4
    texts = packed[len(by_hand) :]
    assert offset % 4 == 0
    assert texts.startswith(struct.pack("<I", 3) + b"hi\x00")
    assert texts[7:12] == b"\x00" + struct.pack("<I", 1)  # the next length begins at a multiple of four


def test_what_was_packed_is_read_back_with_the_definition_alone() -> None:
    value = Outer(
        False, Colour.RED, Inner((0.1, 0.2, 0.3), -5, "a b"), 1e-300, Inner((9.0, 8.0, 7.0), 1, "ü"), 3, ("x", "y"),
        frozenset({"q", "p"}),
    )  # fmt: skip
    found = FORM.values(OUTER.pack(value))
    assert found == {
        "value": 1e-300, "inner_vector": (0.1, 0.2, 0.3), "maybe_vector": (9.0, 8.0, 7.0),
        "inner_count": -5, "maybe_count": 1, "number": 3, "colour": "red",
        "has_maybe": True, "has_number": True, "flag": False,
        "inner_word": "a b", "words": "x y", "kinds": "p q", "maybe_word": "ü",
    }  # fmt: skip


def test_none_is_told_from_zero() -> None:
    inner = Inner((0.0, 0.0, 0.0), 0, "")
    absent = FORM.values(OUTER.pack(Outer(True, Colour.RED, inner, 0.0)))
    present = FORM.values(OUTER.pack(Outer(True, Colour.RED, inner, 0.0, inner, 0)))
    assert (absent["has_maybe"], absent["has_number"]) == (False, False)
    assert (present["has_maybe"], present["has_number"]) == (True, True)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), 5e-324, 0.1 + 0.2, -0.0])
def test_floats_keep_every_bit(value: float) -> None:
    packed = OUTER.pack(Outer(True, Colour.RED, Inner((value, 0.0, 0.0), 0, ""), value))
    assert struct.pack("<d", FORM.values(packed)["value"]) == struct.pack("<d", value)


def test_nan_is_packed() -> None:
    assert np.isnan(
        FORM.values(OUTER.pack(Outer(True, Colour.RED, Inner((0.0, 0.0, 0.0), 0, ""), float("nan"))))["value"]
    )


@pytest.mark.parametrize("kind", [Record, Odometry])
def test_a_definition_describes_its_layout(kind: type) -> None:
    made = Layout(kind, "flightd/X")
    assert parse_definition(made.definition) == [*made.leaves, *made.texts]
    assert len({leaf.name for leaf in made.leaves}) == len(made.leaves)
