"""docs/protocol.md names all methods and notifications, in the shapes of the code; so do the generated documents."""

import json
import re
from pathlib import Path

import pytest

from daemon.goals.methods import METHODS, NOTIFICATIONS
from daemon.goals.openrpc import adapter_of, document, schema_document

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "protocol.md").read_text()
BLOCKS = re.findall(r"```text\n(.*?)```", TEXT, re.DOTALL)


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


def test_results_of_the_examples_have_their_documented_shape():
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
