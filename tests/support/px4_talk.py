"""Talks with a simulated PX4 without a link: lets time pass, picks messages, sends commands."""

from math import nan
from typing import Any

from daemon.sim.px4 import SimulatedPx4

STEP_S = 0.004


def fly(px4: SimulatedPx4, seconds: float) -> list[tuple[str, dict[str, Any]]]:
    """All that it sends meanwhile."""
    messages: list[tuple[str, dict[str, Any]]] = []
    for _ in range(round(seconds / STEP_S)):
        px4.step()
        messages += px4.take_outgoing()
    return messages


def named(messages: list[tuple[str, dict[str, Any]]], name: str) -> list[dict[str, Any]]:
    """The fields of those messages that have this name."""
    return [fields for n, fields in messages if n == name]


def command(px4: SimulatedPx4, number: int, *parameters: float, system: int | None = None) -> None:
    """Send COMMAND_LONG; parameters that are not given are NaN."""
    values = (*parameters, *[nan] * (7 - len(parameters)))
    fields = {"target_system": px4.system_id if system is None else system, "command": number}
    px4.receive("COMMAND_LONG", fields | {f"param{i + 1}": v for i, v in enumerate(values)})
