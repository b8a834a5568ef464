"""What is wrong with a text that is no YAML, and where: lines and columns counted by hand."""

import pytest

from daemon.yaml_text import parsed

UNCLOSED = "a: 1\n\nb: [1, 2\nc: 3\n"
KEY_TWICE = "a:\n  b: 1\n  c: 2\n\n  b: 3\n"


def test_a_list_that_is_not_closed_is_told_with_the_line_in_which_it_began() -> None:
    with pytest.raises(
        ValueError, match=r"^not YAML: line 4, column 2: .* \(while parsing a flow sequence in line 3\)$"
    ):
        parsed(UNCLOSED)


def test_a_key_that_is_there_twice_is_told_with_both_lines() -> None:
    with pytest.raises(ValueError, match=r"^not YAML: line 5, column 3: the key b is there already, in line 2$"):
        parsed(KEY_TWICE)


def test_the_same_key_in_two_sections_is_no_key_twice() -> None:
    assert parsed("a: {x: 1}\nb: {x: 2}\n") == {"a": {"x": 1}, "b": {"x": 2}}


@pytest.mark.parametrize("text", ["a: 2026-13-45", "a: \x00", "[" * 20000, "? [1]\n: 2"])
def test_whatever_is_no_yaml_is_a_value_error_of_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=r"^not YAML: [^\n]+$"):
        parsed(text)
