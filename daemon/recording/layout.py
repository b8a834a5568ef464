"""Flat binary messages of dataclasses: ROS 2 CDR with its text schema, which Foxglove, Lichtblick and PlotJuggler read.

A dataclass becomes one flat message, made from its type hints: nested names are joined by ``_``, float64 first, then
int64, then uint8 (enumerations, with their values as constants) and bool, strings last. Something that may be None has
a ``has_`` flag and zeros when it is. What has no fixed length (texts, sets, tuples of messages) becomes a string. The
fixed part lies at fixed offsets, so that numpy reads a whole flight at once. Floats keep every bit.
"""

import struct
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum, IntEnum
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
    """Leaves that exist together: those of one object that may be None, ``path`` away from its parent group."""

    parent: int
    path: str
    flag: str
    leaves: dict[str, list[tuple[str, Leaf, Any]]]  # by kind: attribute path, leaf, type

    def ordered(self, kind: str) -> list[tuple[str, Leaf, Any]]:
        """Those of a kind, single ones before vectors."""
        return sorted(self.leaves[kind], key=lambda item: item[1].count > 1)


class Layout:
    """How a dataclass is written. ``definition`` is the ROS 2 message, ``dtype`` the fixed part after the header."""

    def __init__(self, kind: type, name: str) -> None:
        self.name = name
        self._groups: list[_Group] = [_Group(-1, "", "", {k: [] for k in (*_ORDER, "string")})]
        _collect(kind, "", "", 0, self._groups)
        flags = [Leaf(group.flag, "bool") for group in self._groups[1:]]
        self.leaves: list[Leaf] = []
        for number_kind in _ORDER:
            self.leaves += flags if number_kind == "bool" else []
            self.leaves += [leaf for group in self._groups for _, leaf, _ in group.ordered(number_kind)]
        self.texts = [leaf for group in self._groups for _, leaf, _ in group.leaves["string"]]
        self.dtype = numpy_type(self.leaves)
        self._fixed = _packer(
            self._groups, "<4s" + "".join(f"{leaf.count}{_STRUCT[leaf.kind]}" for leaf in self.leaves)
        )
        self._texts = [_texts(group.leaves["string"]) for group in self._groups]

    @property
    def definition(self) -> str:
        """The message as ROS 2 writes it."""
        return definition([*self.leaves, *self.texts])

    def pack(self, value: object) -> bytes:
        """One message."""
        fixed, objects = self._fixed(value)
        if not self.texts:
            return fixed
        words: list[str] = []
        for found, texts in zip(objects, self._texts, strict=True):
            texts(found, words)
        return fixed + _strings(words, len(fixed) - len(HEADER))


def _packer(groups: list[_Group], layout: str) -> Callable[[Any], tuple[bytes, tuple[Any, ...]]]:
    """Makes the function that packs the fixed part, and gives the groups' objects with it.

    It is compiled from source, as ``dataclass`` makes ``__init__``: plain attribute access takes a third of the time of
    a general walk, which was most of what a record cost.
    """
    names: dict[str, Any] = {"pack": struct.Struct(layout).pack, "HEADER": HEADER}
    lines = ["def fixed(g0):"]
    for i, group in enumerate(groups[1:], 1):
        lines.append(f"    g{i} = None if g{group.parent} is None else g{group.parent}.{group.path}")
    numbers = ["HEADER"]
    for kind in _ORDER:
        if kind == "bool":
            numbers += [f"g{i} is not None" for i in range(1, len(groups))]
        for i, group in enumerate(groups):
            items = [_item(f"g{i}.{path}".rstrip("."), leaf, typ, names) for path, leaf, typ in group.ordered(kind)]
            if i == 0 or not items:
                numbers += items
            else:
                zeros = sum(leaf.count for _, leaf, _ in group.leaves[kind])
                numbers.append(f"*(({', '.join(items)},) if g{i} is not None else {(0,) * zeros})")
    objects = ", ".join(f"g{i}" for i in range(len(groups)))
    lines.append(f"    return pack({', '.join(numbers)}), ({objects},)")
    exec("\n".join(lines), names)
    made: Callable[[Any], tuple[bytes, tuple[Any, ...]]] = names["fixed"]
    return made


def _item(source: str, leaf: Leaf, kind: Any, names: dict[str, Any]) -> str:
    """The expression of a leaf: a number, an unpacked vector, or the place of an enumeration's member."""
    if leaf.kind == "uint8":
        table = f"members{len(names)}"
        names[table] = {member: i for i, member in enumerate(kind)}
        return f"{table}[{source}]"
    return f"*{source}" if leaf.count > 1 else source


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
            groups.append(_Group(index, here, f"{_front(below)}", {k: [] for k in (*_ORDER, "string")}))
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
