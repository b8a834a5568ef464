"""Dataclasses as JSON and back, by their type hints: parameters, status, states. Floats keep every bit.

NaN and infinities are written as the strings ``nan``, ``inf``, ``-inf``. Types that compare by identity
(``eq=False``) come back as one object wherever they were equal in value, because the flow recognizes a message that
it has seen by identity.
"""

import json
import types
import typing
from dataclasses import fields, is_dataclass
from enum import Enum
from math import isfinite
from typing import Any


class NotEncodableError(Exception):
    """A value that has no written form, by its type's name."""


class RecordError(Exception):
    """A record that cannot be read by this version; the text says what is missing or wrong."""


def encode(value: object) -> Any:
    """What ``json.dumps`` takes. Raises ``NotEncodableError``."""
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else str(value)
    if isinstance(value, tuple):
        return [encode(v) for v in value]
    if isinstance(value, frozenset):
        return [encode(v) for v in sorted(value)]
    if isinstance(value, dict):
        return {str(k): encode(v) for k, v in value.items()}
    if is_dataclass(value):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    raise NotEncodableError(type(value).__name__)


def text(value: object) -> str:
    """Compact JSON. Raises ``NotEncodableError``."""
    return json.dumps(encode(value), separators=(",", ":"), allow_nan=False)


class Decoder:
    """Rebuilds values of a type from what ``encode`` made; one for each record, for it remembers identities."""

    def __init__(self) -> None:
        self._known: dict[tuple[type, str], Any] = {}

    def decode(self, hint: Any, data: Any) -> Any:
        """The value of the hinted type. Raises ``RecordError``."""
        try:
            return self._decode(hint, data)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise RecordError(f"{getattr(hint, '__name__', hint)}: {error}") from None

    def seen(self, value: Any) -> Any:
        """The object that stands for all equal in value to this one: the first that came."""
        return self._known.setdefault((type(value), text(value)), value)

    def _decode(self, hint: Any, data: Any) -> Any:
        origin = typing.get_origin(hint)
        arguments = typing.get_args(hint)
        if origin in (types.UnionType, typing.Union):
            if data is None:
                return None
            return self._decode(next(a for a in arguments if a is not type(None)), data)
        if origin is tuple:
            kinds = arguments[:1] * len(data) if arguments[-1] is Ellipsis else arguments
            return tuple(self._decode(kind, item) for kind, item in zip(kinds, data, strict=True))
        if origin is frozenset:
            return frozenset(self._decode(arguments[0], item) for item in data)
        if hint is float:
            return float(data)
        if isinstance(hint, type) and issubclass(hint, Enum):
            return hint(data)
        if is_dataclass(hint):
            return self._object(typing.cast(type, hint), data)
        return data

    def _object(self, kind: type, data: dict[str, Any]) -> Any:
        known = {field.name for field in fields(kind)}
        unknown = set(data) - known
        if unknown:
            raise RecordError(f"{kind.__name__} has no field {sorted(unknown)[0]} in this version")
        hints = typing.get_type_hints(kind)
        value = kind(**{name: self._decode(hints[name], item) for name, item in data.items()})
        return value if "__eq__" in vars(kind) else self.seen(value)
