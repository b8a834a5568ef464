"""What a configuration demands of the thrust: to hover with some to spare, and to accelerate as the limits allow."""

from __future__ import annotations

from math import hypot
from typing import TYPE_CHECKING

from daemon.control.parameters import ControlParameters
from daemon.control.thrust_map import acceleration_from_command
from daemon.messages import GRAVITY_M_S2
from daemon.values import value

if TYPE_CHECKING:
    from daemon.settings import Config, Control, Limits

_SPARE = 0.1  # of the weight, for feedback, above and below whatever is flown
_LEAST_UPWARD = ControlParameters().vertical_thrust_min_m_s2 / GRAVITY_M_S2  # that the law always keeps


@value
class Demand:
    """``room``: what the thrust gives beyond the demand, in weights; ``text``: what to say when it is below zero."""

    room: float
    text: str


def hover(control: Control, hover_thrust: float) -> tuple[Demand, ...]:
    """Thrust from a tenth of the weight below to a tenth above what hovers."""
    least, full = _weights(control, hover_thrust)
    text = (
        f"thrust_min {control.thrust_min:g} to thrust_max {control.thrust_max:g} leaves less than a tenth about the "
        f"{hover_thrust:.2f} that hovers"
    )
    return Demand(1.0 - _SPARE - least, text), Demand(full - 1.0 - _SPARE, text)


def motion(control: Control, limits: Limits, hover_thrust: float) -> tuple[Demand, ...]:
    """The accelerations that the limits allow, down, and up and sideways at once, with the same to spare."""
    least, full = _weights(control, hover_thrust)
    sideways, vertical = limits.acceleration_m_s2 / GRAVITY_M_S2, limits.vertical_acceleration_m_s2 / GRAVITY_M_S2
    name = f"guidance.limits.vertical_acceleration_m_s2 {limits.vertical_acceleration_m_s2:g}"
    together = f"{name} with guidance.limits.acceleration_m_s2 {limits.acceleration_m_s2:g}"
    at = f"at the {hover_thrust:.2f} that hovers"
    down = 1.0 - _SPARE - vertical
    return (
        Demand(down - _LEAST_UPWARD, f"{name} falls quicker than the law lets a vehicle fall"),
        Demand(down - least, f"{name} needs less than control.thrust_min {control.thrust_min:g} gives {at}"),
        Demand(
            full - hypot(sideways, 1.0 + _SPARE + vertical),
            f"{together} needs more than control.thrust_max {control.thrust_max:g} gives {at}",
        ),
    )


def demands(config: Config, hover_thrust: float) -> tuple[Demand, ...]:
    """All of them, always in the same order."""
    motions = motion(config.control, config.guidance.limits, hover_thrust)
    return (*hover(config.control, hover_thrust), *motions)


def unmet(found: tuple[Demand, ...]) -> list[str]:
    """What is not met, in words, each once."""
    return list(dict.fromkeys(demand.text for demand in found if demand.room < 0.0))


def require(found: tuple[Demand, ...]) -> None:
    """Raise ``ValueError`` with the first that is not met."""
    for text in unmet(found):
        raise ValueError(text)


def require_no_worse(before: Config, after: Config, hover_thrust: float) -> None:
    """Raise ``ValueError`` when the change takes room from a demand that is not met after it.

    A vehicle that flies with too little to spare may be given more, and all that has nothing to do with it.
    """
    for was, now in zip(demands(before, hover_thrust), demands(after, hover_thrust), strict=True):
        if now.room < min(was.room, 0.0):
            raise ValueError(now.text)


def _weights(control: Control, hover_thrust: float) -> tuple[float, float]:
    """The thrust that the least and the largest command give, in weights."""
    least, full = (
        acceleration_from_command(command, hover_thrust, control.thrust_curve, 1.0)
        for command in (control.thrust_min, control.thrust_max)
    )
    return least, full
