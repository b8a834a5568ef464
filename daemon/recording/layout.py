"""Flat binary messages of dataclasses: ROS 2 CDR with its text schema, which Foxglove, Lichtblick and PlotJuggler read.

A dataclass becomes one flat message, made from its type hints: nested names are joined by ``_``, float64 first, then
int64, then uint8 (enumerations, with their values as constants) and bool, strings last. Something that may be None has
a ``has_`` flag and zeros when it is. What has no fixed length (texts, sets, tuples of messages) becomes a string. The
fixed part lies at fixed offsets, so that numpy reads a whole flight at once. Floats keep every bit.
"""

import struct
import types
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum, IntEnum
from functools import partial
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np

from daemon.recording import codec

HEADER = b"\x00\x01\x00\x00"  # CDR, little endian
_NUMPY = {"float64": "<f8", "int64": "<i8", "uint8": "u1", "bool": "?"}
_STRUCT = {"float64": "d", "int64": "q", "uint8": "B", "bool": "?"}
_ORDER = ("float64", "int64", "uint8", "bool")


@dataclass(frozen=True, slots=True)
class Leaf:
    """One field of the message: its name, ROS 2 type, how many numbers, and an enumeration's members."""

    name: str
    kind: str
    count: int = 1
    members: tuple[str, ...] = ()


@dataclass(slots=True)
class _Group:
    """Leaves that exist together: those of one object that may be None, as seen from its parent group."""

    parent: int
    reach: Callable[[Any], Any]
    flag: str
    leaves: dict[str, list[tuple[str, Leaf, Any]]]  # by kind: attribute path, leaf, type


class Layout:
    """How a dataclass is written. ``definition`` is the ROS 2 message, ``dtype`` the fixed part after the header."""

    def __init__(self, kind: type, name: str) -> None:
        self.name = name
        self._groups: list[_Group] = [_Group(-1, lambda value: value, "", {k: [] for k in (*_ORDER, "string")})]
        _collect(kind, "", "", 0, self._groups)
        ordered = [(leaf, k) for k in _ORDER for leaf in self._ordered(k)]
        self.leaves = [leaf for leaf, _ in ordered]
        self.texts = [leaf for group in self._groups for _, leaf, _ in group.leaves["string"]]
        self.dtype = numpy_type(self.leaves)
        self._pack = struct.Struct("<4s" + "".join(f"{leaf.count}{_STRUCT[leaf.kind]}" for leaf in self.leaves)).pack
        self._takers = [self._taker(k) for k in ("float64", "int64", "uint8")]
        self._flags = self._taker("bool")
        self._texts = [_texts(group.leaves["string"]) for group in self._groups]

    @property
    def definition(self) -> str:
        """The message as ROS 2 writes it."""
        return definition([*self.leaves, *self.texts])

    def pack(self, value: object) -> bytes:
        """One message."""
        objects: list[Any] = []
        for group in self._groups:
            parent = value if group.parent < 0 else objects[group.parent]
            objects.append(None if parent is None else group.reach(parent))
        numbers: list[Any] = []
        for take in self._takers:
            take(objects, numbers)
        numbers.extend([found is not None for found in objects[1:]])
        self._flags(objects, numbers)
        fixed = self._pack(HEADER, *numbers)
        if not self.texts:
            return fixed
        words: list[str] = []
        for found, texts in zip(objects, self._texts, strict=True):
            texts(found, words)
        return fixed + _strings(words, len(fixed) - len(HEADER))

    def _ordered(self, kind: str) -> Iterator[Leaf]:
        if kind == "bool":
            yield from (Leaf(group.flag, "bool") for group in self._groups[1:])
        for group in self._groups:
            yield from (leaf for _, leaf, _ in sorted(group.leaves[kind], key=lambda item: item[1].count > 1))

    def _taker(self, kind: str) -> Callable[[list[Any], list[Any]], None]:
        """Appends the numbers of a kind, in the order of ``_ordered``: single ones of a group before its vectors."""
        parts: list[tuple[int, Callable[[Any, list[Any]], None]]] = []
        for index, group in enumerate(self._groups):
            single = [(path, typ) for path, leaf, typ in group.leaves[kind] if leaf.count == 1]
            vectors = [path for path, leaf, _ in group.leaves[kind] if leaf.count > 1]
            size = sum(leaf.count for _, leaf, _ in group.leaves[kind])
            if kind == "uint8" and single:
                parts.append((index, _members(single)))
            elif single:
                parts.append((index, _singles([path for path, _ in single])))
            if vectors:
                parts.append((index, _vectors(vectors)))
            if size:
                parts.append((index, partial(_zeros, size)))

        def take(objects: list[Any], numbers: list[Any]) -> None:
            for index, part in parts:
                found = objects[index]
                if (found is None) is (isinstance(part, partial)):
                    part(found, numbers)

        return take


def numpy_type(leaves: list[Leaf]) -> np.dtype[Any]:
    """Structured type of the fixed part."""
    return np.dtype(
        [
            (leaf.name, _NUMPY[leaf.kind], (leaf.count,)) if leaf.count > 1 else (leaf.name, _NUMPY[leaf.kind])
            for leaf in leaves
        ]
    )


def definition(leaves: list[Leaf]) -> str:
    """The ROS 2 message definition of leaves."""
    lines: list[str] = []
    for leaf in leaves:
        lines += [f"uint8 {leaf.name.upper()}_{member.upper()}={i}" for i, member in enumerate(leaf.members)]
        lines.append(f"{leaf.kind}{f'[{leaf.count}]' if leaf.count > 1 else ''} {leaf.name}")
    return "\n".join(lines) + "\n"


def parse_definition(text: str) -> list[Leaf]:
    """The leaves of a definition that ``definition`` wrote, strings included; how a record of any version is read."""
    leaves: list[Leaf] = []
    members: list[str] = []
    for line in text.splitlines():
        kind, _, name = line.partition(" ")
        if "=" in name:
            members.append(name.split("=")[0].lower())
            continue
        base, _, count = kind.partition("[")
        names = tuple(member[len(name) + 1 :] for member in members)
        leaves.append(Leaf(name, base, int(count[:-1]) if count else 1, names))
        members = []
    return leaves


def read_strings(data: bytes, offset: int, count: int) -> tuple[list[str], int]:
    """``count`` strings from ``offset`` on, where the fixed part of a message with its header ends; and their end."""
    words: list[str] = []
    for _ in range(count):
        offset += -(offset - len(HEADER)) % 4
        (length,) = struct.unpack_from("<I", data, offset)
        words.append(data[offset + 4 : offset + 3 + length].decode())
        offset += 4 + length
    return words, offset


def _strings(words: list[str], offset: int) -> bytes:
    parts: list[bytes] = []
    for word in words:
        raw = word.encode() + b"\x00"
        part = bytes(-offset % 4) + struct.pack("<I", len(raw)) + raw
        parts.append(part)
        offset += len(part)
    return b"".join(parts)


def _collect(kind: type, name: str, path: str, index: int, groups: list[_Group]) -> None:
    """Sort the fields of a dataclass into the group that it is reached in, and into new groups below it."""
    hints = typing.get_type_hints(kind)
    for field in fields(kind):
        hint, below = hints[field.name], _join(name, field.name, "_")
        here = _join(path, field.name, ".")
        inner = _optional(hint)
        if inner is not None:
            groups.append(_Group(index, attrgetter(here), f"{_front(below)}", {k: [] for k in (*_ORDER, "string")}))
            if is_dataclass(inner):
                _collect(inner, below, "", len(groups) - 1, groups)  # type: ignore[arg-type]
            else:
                _put(inner, below, "", groups[-1])
        elif is_dataclass(hint):
            _collect(hint, below, here, index, groups)  # type: ignore[arg-type]
        else:
            _put(hint, below, here, groups[index])


def _put(hint: Any, name: str, path: str, group: _Group) -> None:
    leaf = _leaf(hint, name)
    group.leaves[leaf.kind].append((path, leaf, hint))


def _leaf(hint: Any, name: str) -> Leaf:
    if hint is bool:
        return Leaf(name, "bool")
    if hint is float:
        return Leaf(name, "float64")
    if hint is int or (isinstance(hint, type) and issubclass(hint, IntEnum)):
        return Leaf(name, "int64")
    if isinstance(hint, type) and issubclass(hint, Enum):
        return Leaf(name, "uint8", 1, tuple(member.name.lower() for member in hint))
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and arguments and all(a is float for a in arguments):
        return Leaf(name, "float64", len(arguments))
    return Leaf(name, "string")


def _optional(hint: Any) -> Any:
    """T of ``T | None``, else None."""
    if typing.get_origin(hint) not in (types.UnionType, typing.Union):
        return None
    inner = [a for a in typing.get_args(hint) if a is not type(None)]
    return inner[0] if len(inner) == 1 else None


def _join(front: str, name: str, by: str) -> str:
    return f"{front}{by}{name}" if front else name


def _front(name: str) -> str:
    return f"has_{name}"


def _getter(paths: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """All attributes at once as a tuple; the empty path is the value itself."""
    if paths == [""]:
        return lambda value: (value,)
    get = attrgetter(*paths)
    return get if len(paths) > 1 else lambda value: (get(value),)


def _singles(paths: list[str]) -> Callable[[Any, list[Any]], None]:
    get = _getter(paths)
    return lambda value, numbers: numbers.extend(get(value))


def _vectors(paths: list[str]) -> Callable[[Any, list[Any]], None]:
    get = _getter(paths)
    return lambda value, numbers: numbers.extend(chain.from_iterable(get(value)))


def _members(single: list[tuple[str, Any]]) -> Callable[[Any, list[Any]], None]:
    get = _getter([path for path, _ in single])
    tables = [{member: i for i, member in enumerate(kind)} for _, kind in single]
    return lambda value, numbers: numbers.extend(t[v] for t, v in zip(tables, get(value), strict=True))


def _zeros(size: int, value: Any, numbers: list[Any]) -> None:
    numbers.extend([0] * size)


def _texts(leaves: list[tuple[str, Leaf, Any]]) -> Callable[[Any, list[str]], None]:
    if not leaves:
        return lambda value, words: None
    get = _getter([path for path, _, _ in leaves])
    count = len(leaves)
    return lambda value, words: words.extend([""] * count if value is None else map(_text, get(value)))


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if not value:
        return ""
    parts = sorted(value) if isinstance(value, frozenset) else value
    return " ".join(p if isinstance(p, str) else p.value if isinstance(p, Enum) else codec.text(p) for p in parts)
