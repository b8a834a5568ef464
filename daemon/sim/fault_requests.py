"""Faults at run time: what the control socket of a simulator understands.

- ``{"inject": {"fault": "gps_loss", "duration_s": 10}}``: begin a fault now; keys as in a scenario;
- ``{"clear": "gps_loss"}``: end the active faults of this name, ``{"clear": null}``: all of them;
- ``{"list": true}``: which are active, and ``known``: fault names to their settings.

``"vehicle"`` with a system id chooses one vehicle; without it all are meant. Every answer has ``active``: system id to
names of the faults at work.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

from daemon.sim.control_socket import Handler
from daemon.sim.faults import FAULTS, from_mapping
from daemon.sim.px4 import SimulatedPx4

_NAMES = {kind: name for name, kind in FAULTS.items()}
_VERBS = ("inject", "clear", "list")
_KNOWN = {name: [field.name for field in fields(kind)] for name, kind in FAULTS.items()}


def fault_requests(vehicles: Sequence[SimulatedPx4]) -> Handler:
    """The handler for these vehicles; ValueError with the reason for a request that it refuses."""

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        verbs = [verb for verb in _VERBS if verb in request]
        unknown = sorted(set(request) - {*_VERBS, "vehicle"})
        if len(verbs) != 1 or unknown:
            raise ValueError(f"a request has one of {', '.join(_VERBS)} and may have vehicle; got {sorted(request)}")
        chosen = _chosen(vehicles, request.get("vehicle"))
        _ACTIONS[verbs[0]](chosen, request[verbs[0]])
        active = {str(px4.system_id): [_NAMES[type(fault)] for fault in px4.faults.active] for px4 in chosen}
        return {"active": active} | ({"known": _KNOWN} if verbs[0] == "list" else {})

    return handle


def _chosen(vehicles: Sequence[SimulatedPx4], system_id: object) -> list[SimulatedPx4]:
    chosen = [px4 for px4 in vehicles if system_id is None or px4.system_id == system_id]
    if not chosen:
        raise ValueError(f"vehicle: {system_id!r} is none of {', '.join(str(px4.system_id) for px4 in vehicles)}")
    return chosen


def _inject(vehicles: list[SimulatedPx4], data: Any) -> None:
    if not isinstance(data, dict):
        raise ValueError("inject: a mapping with the key fault is expected")
    fault = from_mapping(data)
    for px4 in vehicles:
        px4.inject(fault)


def _clear(vehicles: list[SimulatedPx4], name: Any) -> None:
    for px4 in vehicles:
        px4.faults.clear(name)


def _list(_vehicles: list[SimulatedPx4], _argument: Any) -> None:
    pass


_ACTIONS: dict[str, Callable[[list[SimulatedPx4], Any], None]] = {"inject": _inject, "clear": _clear, "list": _list}
