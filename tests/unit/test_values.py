"""Values are compared as they say, and have slots."""

import pytest

from daemon.values import value


@value
class Seen:
    """Compared by identity."""

    at_s: float


@value(eq=True)
class Told:
    """Compared by content."""

    at_s: float


def test_a_value_is_compared_by_identity_unless_it_says_otherwise() -> None:
    assert Seen(1.0) != Seen(1.0)
    assert Told(1.0) == Told(1.0)
    assert hash(Told(1.0)) == hash(Told(1.0))


def test_a_value_has_no_room_for_a_field_that_it_does_not_declare() -> None:
    with pytest.raises(AttributeError):
        Seen(1.0).seen = True
