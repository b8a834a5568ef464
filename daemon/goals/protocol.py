"""JSON-RPC 2.0 over lines, without I/O: bytes to calls and refusals, results and errors to bytes.

https://www.jsonrpc.org/specification; narrower where the docs say so: an id is a string or a finite number, parameters
are an object, unknown keys are refused.
"""

import json
from codecs import BOM_UTF8
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NoReturn

from pydantic import ValidationError

from daemon.goals.errors import ErrorCode, ProtocolError
from daemon.goals.methods import METHODS, Method
from daemon.goals.schema import UNIONS, Params

MAX_BATCH = 100
MAX_VALUES = 1000
MAX_BATCH_VALUES = 5000
EXPLAINED = 20
MAX_ID_CHARS = 256
SHOWN_CHARS = 64

RequestId = str | int | float | None


@dataclass(frozen=True, slots=True)
class Call:
    """A request (or, if the method is a notification, what came without an id) whose parameters are right."""

    id: RequestId
    method: Method
    params: Params


@dataclass(frozen=True, slots=True)
class Refusal:
    """A message that is not done; ``reply`` is False for a notification's, which is reported as an event.

    ``goal_id`` is the one that the message gave.
    """

    id: RequestId
    error: ProtocolError
    reply: bool = True
    goal_id: str | None = None


class _NoLiteralError(ValueError):
    """NaN or Infinity, which Python takes and JSON has not."""


def _no_literal(name: str) -> NoReturn:
    raise _NoLiteralError(f"{name} is not JSON")


def parse(line: bytes) -> tuple[list[Any], bool]:
    """Messages of a line (nothing of them checked yet), and whether they came as a batch.

    Raises `ProtocolError`: PARSE when it is not JSON, INVALID_REQUEST when the batch is empty or too large.
    """
    if line.startswith(BOM_UTF8):
        raise ProtocolError(ErrorCode.PARSE, "not JSON: the line begins with a byte order mark (UTF-8 BOM); send none")
    try:
        message = json.loads(line.decode("utf-8"), parse_constant=_no_literal)
    except RecursionError:
        raise ProtocolError(ErrorCode.PARSE, "not JSON that can be read: it is nested too deep") from None
    except UnicodeDecodeError:
        raise ProtocolError(ErrorCode.PARSE, "not JSON: it is not UTF-8") from None
    except (json.JSONDecodeError, _NoLiteralError) as error:
        raise ProtocolError(ErrorCode.PARSE, f"not JSON: {error}") from None
    except ValueError:  # of int(), which takes so many digits and no more
        raise ProtocolError(ErrorCode.PARSE, "not JSON that can be read: it has a number of too many digits") from None
    if not isinstance(message, list):
        return [message], False
    if not message:
        raise ProtocolError(ErrorCode.INVALID_REQUEST, "the batch is empty")
    if len(message) > MAX_BATCH:
        raise ProtocolError(ErrorCode.INVALID_REQUEST, f"a batch has at most {MAX_BATCH} messages, not {len(message)}")
    if _values(message, MAX_BATCH_VALUES) > MAX_BATCH_VALUES:
        raise ProtocolError(ErrorCode.INVALID_REQUEST, f"the batch has more than {MAX_BATCH_VALUES} values")
    return message, True


def interpret(message: Any, *, operator: bool) -> Call | Refusal:
    """What a message asks for; ``operator`` tells whether the peer may act or only read."""
    if not isinstance(message, dict):
        return Refusal(None, ProtocolError(ErrorCode.INVALID_REQUEST, f"a request is an object, not {_kind(message)}"))
    request_id = message.get("id")
    reply_id = request_id if _is_id(request_id) else None
    name = message.get("method")
    silent = "id" not in message and isinstance(name, str) and name in METHODS and METHODS[name].notification
    try:
        method = _method_of(message)
        if method.operator and not operator:
            reason = "only operators may do this: root, the daemon's user and group, and those in its configuration"
            raise ProtocolError(ErrorCode.NOT_PERMITTED, f"{method.name}: {reason}")
        return Call(reply_id, method, _params_of(method, message.get("params")))
    except ProtocolError as error:
        error.__traceback__ = None  # it would keep what it was raised from alive, as garbage
        return Refusal(reply_id, error, reply=not silent, goal_id=_goal_id(message.get("params")))


def _goal_id(params: Any) -> str | None:
    given = params.get("goal_id") if isinstance(params, dict) else None
    return given if isinstance(given, str) and _is_id(given) else None


def _is_id(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    if isinstance(value, str):
        return len(value) <= MAX_ID_CHARS
    return isinstance(value, int) or (isinstance(value, float) and isfinite(value))


def _method_of(message: dict[str, Any]) -> Method:
    for key in ("jsonrpc", "method"):
        if key not in message:
            raise ProtocolError(ErrorCode.INVALID_REQUEST, "is missing", key)
    if message["jsonrpc"] != "2.0":
        raise ProtocolError(ErrorCode.INVALID_REQUEST, 'must be "2.0"', "jsonrpc")
    for key in message:
        if key not in ("jsonrpc", "id", "method", "params"):
            raise ProtocolError(ErrorCode.INVALID_REQUEST, "is not a key of a request", _shown(key))
    name = message["method"]
    if not isinstance(name, str):
        raise ProtocolError(ErrorCode.INVALID_REQUEST, f"must be a string, not {_kind(name)}", "method")
    if "id" in message and not _is_id(message["id"]):
        reason = f"must be a string of at most {MAX_ID_CHARS} characters or a finite number"
        raise ProtocolError(ErrorCode.INVALID_REQUEST, reason, "id")
    method = METHODS.get(name)
    if method is None:
        reason = f"there is no {_shown(name)}; system.info lists the methods"
        raise ProtocolError(ErrorCode.UNKNOWN_METHOD, reason, "method")
    if method.notification and "id" in message:
        raise ProtocolError(ErrorCode.INVALID_REQUEST, f"{name} is a notification: send it without an id", "id")
    if not method.notification and "id" not in message:
        raise ProtocolError(ErrorCode.INVALID_REQUEST, f"is missing: {name} has to be answered", "id")
    return method


def _params_of(method: Method, params: Any) -> Params:
    if params is None:
        params = {}
    if not isinstance(params, dict):
        raise ProtocolError(ErrorCode.INVALID_PARAMS, f"must be an object, not {_kind(params)}", "params")
    if _values(params, MAX_VALUES) > MAX_VALUES:  # each could be a mistake, and each mistake costs time
        raise ProtocolError(ErrorCode.INVALID_PARAMS, f"has more than {MAX_VALUES} values", "params")
    try:
        return method.params.model_validate(params)
    except ValidationError as error:
        found = [explained(dict(item), params) for item in error.errors(include_url=False)[:EXPLAINED]]
    raise min(found, key=lambda e: e.code)


def _values(given: dict[str, Any] | list[Any], most: int) -> int:
    """How many values there are, those inside of others too; counts no further than ``most``."""
    count = 0
    left: list[Any] = [given]
    while left and count <= most:
        value = left.pop()
        inner = value.values() if isinstance(value, dict) else value
        count += len(inner)
        left += [item for item in inner if isinstance(item, dict | list)] if count <= most else []
    return count


_SENTENCES = {
    "missing": "is missing",
    "extra_forbidden": "is not a known key",
    "finite_number": "must be a finite number",
    "union_tag_not_found": "is missing",
    "string_unicode": "must be text that Unicode has",
}
_WANTED = {
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "a string",
    "list_type": "a list",
    "tuple_type": "a list",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dict_type": "an object",
}
_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}
_LENGTHS = {
    "too_short": ("min_length", "at least"),
    "too_long": ("max_length", "at most"),
    "string_too_short": ("min_length", "at least"),
    "string_too_long": ("max_length", "at most"),
}


def explained(item: dict[str, Any], params: dict[str, Any]) -> ProtocolError:
    """One of pydantic's errors as a code, a path in what the client sent, and a sentence."""
    kind, value, context = item["type"], item["input"], item.get("ctx") or {}
    field = _path(item["loc"], params, kind)
    if kind in ("refused", "shape"):
        code = ErrorCode.REFUSED if kind == "refused" else ErrorCode.INVALID_PARAMS
        return ProtocolError(code, context["reason"], f"{field}.{context['field']}".strip("."))
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return ProtocolError(ErrorCode.REFUSED, f"must be {words} {context[key]:g}, not {value:g}", field)
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        field = f"{field}.kind".lstrip(".")
    if kind in ("literal_error", "union_tag_invalid"):
        expected = str(context.get("expected") or " or ".join(context["expected_tags"].rsplit(", ", 1)))
        reason = f"must be {expected}".replace("'", '"')
    elif kind in _LENGTHS:
        key, words = _LENGTHS[kind]
        unit = "character" if isinstance(value, str) else "item"
        plural = "s" if context[key] != 1 else ""
        reason = f"must have {words} {context[key]} {unit}{plural}, not {len(value)}"
    elif kind in _WANTED:
        reason = f"must be {_WANTED[kind]}, not {_kind(value)}"
    else:
        reason = _SENTENCES.get(kind) or item["msg"].removeprefix("Input should ").removeprefix("Value error, ")
    return ProtocolError(ErrorCode.INVALID_PARAMS, reason, field or "params")


def _path(location: Sequence[str | int], params: Any, kind: str) -> str:
    """Path of a pydantic location in what the client sent: what follows the name of a union is its tag, left out."""
    path, value, before = "", params, ""
    for depth, step in enumerate(location):
        last = depth == len(location) - 1
        before, parent = str(step), before
        if parent in UNIONS:
            continue
        if isinstance(step, int):
            path += f"[{step}]"
            value = value[step] if isinstance(value, list) and step < len(value) else None
        elif isinstance(value, dict) and step in value:
            path += f".{_shown(step)}"
            value = value[step]
        elif last and kind == "missing":
            path += f".{step}"
    return path.lstrip(".")


def _shown(text: str) -> str:
    """Text of a client's in a message of ours: printable, and not long."""
    clean = "".join(c if c.isprintable() else "?" for c in text[:SHOWN_CHARS])
    return clean + ("..." if len(text) > SHOWN_CHARS else "")


def _kind(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and value.bit_length() > 1000:
        return "one that large"
    return {str: "a string", int: "a number", float: "a number", list: "a list"}.get(type(value), "an object")


def encode(message: Mapping[str, Any]) -> bytes:
    """One line; a number that is not finite becomes null."""
    try:
        text = json.dumps(message, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(message), separators=(",", ":"), allow_nan=False)
    return text.encode("ascii") + b"\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def encode_result(request_id: RequestId, result: Mapping[str, Any]) -> bytes:
    """Reply to a request that was done."""
    return encode({"jsonrpc": "2.0", "id": request_id, "result": result})


def encode_error(request_id: RequestId, error: ProtocolError) -> bytes:
    """Reply to a request that was not done."""
    data = {"field": error.field, "reason": error.reason}
    body = {"code": int(error.code), "message": str(error), "data": data}
    return encode({"jsonrpc": "2.0", "id": request_id, "error": body})


def encode_notification(method: str, params: Mapping[str, Any]) -> bytes:
    """A notification to a client."""
    return encode({"jsonrpc": "2.0", "method": method, "params": params})


def encode_batch(replies: Iterable[bytes]) -> bytes:
    """Replies, each as `encode` made it, as the one line that answers a batch."""
    return b"[" + b",".join(reply.rstrip(b"\n") for reply in replies) + b"]\n"
