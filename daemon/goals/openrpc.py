"""The protocol described for machines: an OpenRPC document and JSON Schemas, made from the code."""

from typing import Any

from pydantic import ConfigDict, TypeAdapter
from typing_extensions import is_typeddict

from daemon.goals import results
from daemon.goals.errors import ErrorCode
from daemon.goals.methods import METHODS, NOTIFICATIONS, PROTOCOL_VERSION, Method

OPENRPC_VERSION = "1.3.2"
REFERENCE = "#/components/schemas/{model}"
ERRORS = {
    ErrorCode.PARSE: "not JSON",
    ErrorCode.INVALID_REQUEST: "not a request, or a line that is too long",
    ErrorCode.UNKNOWN_METHOD: "no such method",
    ErrorCode.INVALID_PARAMS: "wrong type, unknown or missing key",
    ErrorCode.INTERNAL: "a mistake of the daemon's",
    ErrorCode.REFUSED: "right type, unacceptable value",
    ErrorCode.WRONG_STATE: "not possible in this state",
    ErrorCode.NOT_PERMITTED: "not permitted",
    ErrorCode.AUTOPILOT_REFUSED: "the autopilot refused",
    ErrorCode.TIMED_OUT: "timed out; it may still take effect",
    ErrorCode.UNKNOWN_GOAL: "unknown goal",
}


def adapter_of(shape: type) -> TypeAdapter[Any]:
    """Validator of a parameter model, or of a result or notification, unknown keys forbidden."""
    return TypeAdapter(shape)


def _forbid_unknown_keys() -> None:
    """`daemon.goals.results` knows nothing of pydantic, so that clients start fast; here its shapes become strict."""
    name = "__pydantic_config__"
    for shape in vars(results).values():
        if is_typeddict(shape):
            setattr(shape, name, ConfigDict(extra="forbid"))


_forbid_unknown_keys()


def _shapes() -> dict[str, type]:
    shapes: dict[str, type] = {}
    for method in METHODS.values():
        shapes[f"{method.name} params"] = method.params
        if method.result is not None:
            shapes[f"{method.name} result"] = method.result
    return shapes | {f"{name} params": shape for name, shape in NOTIFICATIONS.items()}


def schemas(reference: str = "#/$defs/{model}") -> tuple[dict[str, Any], dict[str, Any]]:
    """Schema of each message by its name (such as "goal.submit params"), and the definitions that they share."""
    inputs = [(name, "validation", adapter_of(shape)) for name, shape in _shapes().items()]
    found, shared = TypeAdapter.json_schemas(inputs, ref_template=reference)  # type: ignore[arg-type]
    return {name: schema for (name, _), schema in found.items()}, shared.get("$defs", {})


def schema_document() -> dict[str, Any]:
    """All messages as one JSON Schema document."""
    found, definitions = schemas()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "flightd goal protocol",
        "version": PROTOCOL_VERSION,
        "messages": found,
        "$defs": definitions,
    }


def document() -> dict[str, Any]:
    """OpenRPC document (https://spec.open-rpc.org); notifications to the client are under x-notifications."""
    found, definitions = schemas(REFERENCE)
    return {
        "openrpc": OPENRPC_VERSION,
        "info": {"title": "flightd goal protocol", "version": str(PROTOCOL_VERSION)},
        "methods": [_method(method, found, definitions) for method in METHODS.values()],
        "x-notifications": [{"name": name, "params": found[f"{name} params"]} for name in NOTIFICATIONS],
        "components": {
            "schemas": definitions,
            "errors": {code.name: {"code": int(code), "message": text} for code, text in ERRORS.items()},
        },
    }


def _method(method: Method, found: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    schema = found[f"{method.name} params"]
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rsplit("/", 1)[1]]
    required = schema.get("required", [])
    described: dict[str, Any] = {
        "name": method.name,
        "summary": method.summary,
        "paramStructure": "by-name",
        "params": [
            {"name": name, "required": name in required, "schema": value}
            for name, value in schema.get("properties", {}).items()
        ],
        "x-role": "operator" if method.operator else "observer",
        "errors": [{"$ref": f"#/components/errors/{code.name}"} for code in ERRORS],
    }
    if method.result is not None:
        described["result"] = {"name": method.result.__name__, "schema": found[f"{method.name} result"]}
    return described
