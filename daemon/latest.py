"""A cell between two tasks: one writer, any number of readers, the newest value only."""

from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Holds the newest value; ``version`` counts the writes, so that a reader knows whether it saw this one."""

    __slots__ = ("value", "version")

    def __init__(self, value: T) -> None:
        self.value = value
        self.version = 0

    def set(self, value: T) -> None:
        """Replace the value. Atomic under the interpreter lock, so a callback thread may write."""
        self.value = value
        self.version += 1
