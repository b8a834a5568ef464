"""The decorator of the types that are made anew at each tick: frozen to the type checker, plain slots at run time.

A frozen dataclass sets each field through ``object.__setattr__``, which made a fifth of a step's cost; mypy refuses the
same assignments before anything runs. What is made once (parameters, goals) is a frozen dataclass.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform, overload

T = TypeVar("T")


@overload
def value(cls: type[T], /) -> type[T]: ...
@overload
def value(*, eq: bool = False) -> Callable[[type[T]], type[T]]: ...
@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def value(cls: type[T] | None = None, /, *, eq: bool = False) -> type[T] | Callable[[type[T]], type[T]]:
    """A dataclass with slots that nothing may change; compared by identity, or field by field with ``eq``."""
    made = dataclass(slots=True, eq=eq, unsafe_hash=eq)
    return made if cls is None else made(cls)
