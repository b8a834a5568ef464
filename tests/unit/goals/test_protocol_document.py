"""docs/protocol.md is run: each `>` line is sent to a daemon without a vehicle, each `<` line is what it answers."""

import asyncio
import json
import re
from pathlib import Path

import pytest
from fake_flight import serving

from daemon.goals.methods import METHODS, NOTIFICATIONS
from daemon.goals.openrpc import adapter_of, document, schema_document

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "protocol.md").read_text()
BLOCKS = re.findall(r"```text\n(.*?)```", TEXT, re.DOTALL)
VOLATILE = {"uptime_s", "time_s", "version", "methods"}


def steady(value):
    """A message without what differs from run to run."""
    if isinstance(value, dict):
        return {key: 0 if key in VOLATILE else steady(item) for key, item in value.items()}
    return [steady(item) for item in value] if isinstance(value, list) else value


async def play(path, block):
    """Lines of the block as they are when each `>` line is sent and everything that comes back is noted."""
    played = []
    async with serving(path):
        reader, writer = await asyncio.open_unix_connection(str(path))
        for line in (line for line in block.splitlines() if line.startswith(">")):
            played.append(line)
            end = {"jsonrpc": "2.0", "id": "end", "method": "system.info"}
            writer.write(line[2:].encode() + b"\n")
            for _ in range(10):  # the last comes after what the line set going, a batch too
                writer.write(json.dumps(end).encode() + b"\n")
                while (answer := json.loads(await reader.readline())) and not is_end(answer):
                    played.append("< " + json.dumps(answer))
        writer.close()
    return played


def is_end(answer):
    return isinstance(answer, dict) and answer.get("id") == "end"


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
async def test_examples_are_answered_as_written(tmp_path, block):
    played = await play(tmp_path / "s", block)
    written = block.splitlines()
    assert [line[0] for line in played] == [line[0] for line in written]
    for ours, theirs in zip(played, written, strict=True):
        if ours[0] == "<":
            assert steady(json.loads(ours[2:])) == steady(json.loads(theirs[2:]))


def sent():
    messages = [line[2:] for block in BLOCKS for line in block.splitlines() if line.startswith("> {")]
    return [json.loads(message) for message in messages]


def test_each_method_has_an_example():
    assert {message["method"] for message in sent()} >= set(METHODS)


def test_each_notification_has_an_example_of_its_shape():
    lines = [json.loads(line) for line in re.search(r"```json\n(.*?)```", TEXT, re.DOTALL)[1].splitlines()]
    assert {line["method"] for line in lines} == set(NOTIFICATIONS)
    for line in lines:
        adapter_of(NOTIFICATIONS[line["method"]]).validate_python(line["params"], strict=True)


async def test_results_of_the_examples_have_their_documented_shape(tmp_path):
    for block in BLOCKS:
        methods = {}
        for line in block.splitlines():
            message = json.loads(line[2:]) if line[2:3] == "{" else {}
            if line.startswith("> ") and "id" in message:
                methods[message["id"]] = METHODS.get(message["method"])
            elif "result" in message:
                adapter_of(methods[message["id"]].result).validate_python(message["result"], strict=True)


@pytest.mark.parametrize(("name", "generated"), [("openrpc.json", document), ("schemas.json", schema_document)])
def test_shipped_documents_are_those_of_the_code(name, generated):
    """If this fails: `flightd protocol > docs/openrpc.json; flightd protocol --schemas > docs/schemas.json`."""
    assert json.loads((DOCS / name).read_text()) == json.loads(json.dumps(generated()))


def test_openrpc_document_resolves_its_references():
    text = json.dumps(document())
    described = document()
    for reference in set(re.findall(r'"\$ref": "#/([^"]+)"', text)):
        found = described
        for key in reference.split("/"):
            found = found[key]
    assert [method["name"] for method in described["methods"]] == list(METHODS)
