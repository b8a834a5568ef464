"""The examples of docs/protocol.md are what the daemon answers. After a change: `python -m support.protocol_page`."""

import json
from typing import Any

import pytest
from support.protocol_page import blocks, played

MEASURED = ("collections", "late", "missed", "config_hash", "version")


def steady(value: Any, key: str = "") -> Any:
    """A message without what is measured, and without what differs from one version to the next."""
    if key in MEASURED or (isinstance(value, float) and key not in ("value", "min", "max")):
        return 0
    if isinstance(value, dict):
        return {name: steady(item, name) for name, item in value.items()}
    return [steady(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("block", blocks(), ids=range(len(blocks())))
def test_examples_are_answered_as_written(block: str) -> None:
    written = [(line[0], json.loads(line[2:]) if line[0] == "<" else line[2:]) for line in block.splitlines()]
    assert steady([list(line) for line in played(block)]) == steady([list(line) for line in written])
