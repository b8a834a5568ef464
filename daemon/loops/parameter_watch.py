"""Reads those of the autopilot's parameters that matter here: takes its hover thrust, and warns of what is dangerous.

What does not answer is asked for again, and what is not known is said.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from daemon import logs
from daemon.autopilot.port import CommandTimeoutError, NotConnectedError

if TYPE_CHECKING:
    from daemon.loops.vehicle import Vehicle
    from daemon.settings import Config

READ_TIMEOUT_S = 2.0
AGAIN_S = 10.0
HOVER_PARAMETER = "MPC_THR_HOVER"
THRUST_WARNING = "thrust_room"
HOVER_RANGE = (0.1, 0.9)

log = logs.get("health")


@dataclass(frozen=True, slots=True)
class Advice:
    """A parameter of the autopilot that is dangerous when ``bad`` says so of its value, what to set, and why.

    ``unless`` the configuration takes care of it.
    """

    name: str
    bad: Callable[[float], bool]
    text: str
    unless: Callable[[Config], bool] = lambda _: False


ADVICE = (
    Advice(
        "COM_RC_OVERRIDE",
        lambda value: not int(value) & 2,
        "set bit 1 (value 3), so that the pilot's sticks take the vehicle out of offboard",
    ),
    Advice(
        "COM_OF_LOSS_T",
        lambda value: not 0.5 <= value <= 1.0,
        "set 0.5 to 1.0 s: until then the vehicle keeps turning at the last rate when the daemon falls silent, and a "
        "shorter silence the daemon bridges, or hands over to Hold, by itself",
    ),
    Advice(
        "COM_OBL_RC_ACT",
        lambda value: int(value) in (1, 2, 6, 7),
        "set 5 (Hold) or 4 (Land), what the autopilot does when offboard is lost",
    ),
    Advice(
        "COM_LOW_BAT_ACT",
        lambda value: int(value) == 0,
        "set 3 (Return, then Land), or safety.battery_min_pct of flightd: nobody acts on an empty battery",
        lambda config: config.safety.battery_min_pct > 0.0,
    ),
)


class ParameterWatch:
    """Writes ``warnings`` by the parameter's name, and the hover thrust where none is configured."""

    def __init__(self, vehicle: Vehicle, warnings: dict[str, str]) -> None:
        self._vehicle = vehicle
        self._warnings = warnings
        self._judges: dict[str, Callable[[float], str | None]] = {HOVER_PARAMETER: self._take_hover}
        self._judges.update((advice.name, _judge(advice, vehicle)) for advice in ADVICE)

    async def run(self) -> None:
        """Ask for all, and every ``AGAIN_S`` for those that have not answered, until all have."""
        waiting = list(self._judges)
        while waiting:
            waiting = [name for name in waiting if not await self._answers(name)]
            if waiting:
                await asyncio.sleep(AGAIN_S)

    def judge_thrust(self) -> None:
        """Warn while the vehicle has less thrust than the configuration demands at the hover thrust that is known."""
        self._warn(THRUST_WARNING, "too_little_thrust", "; ".join(self._vehicle.flown.cannot_fly()) or None)

    async def _answers(self, name: str) -> bool:
        """Whether the autopilot has answered, be it that it does not know the parameter."""
        try:
            value = await self._vehicle.autopilot.read_parameter(name, READ_TIMEOUT_S)
        except NotConnectedError:
            return False
        except CommandTimeoutError:
            self._warn(name, "parameter_not_read", self._unread(name, "has not answered"))
            return False
        if value is None:
            self._warn(name, "parameter_not_read", self._unread(name, "is not known to the autopilot"))
        else:
            self._warn(name, "dangerous_parameter", self._judges[name](float(value)))
        return True

    def _warn(self, name: str, event: str, text: str | None) -> None:
        if text is None:
            self._warnings.pop(name, None)
        elif text != self._warnings.get(name):
            self._warnings[name] = text
            log.warning(event, name=name, text=text)

    def _unread(self, name: str, why: str) -> str | None:
        if name != HOVER_PARAMETER:
            return f"{name} {why}: whether it is dangerous cannot be said"
        return None if self._is_hover_configured else f"{name} {why}: {self._starts_at}"

    @property
    def _is_hover_configured(self) -> bool:
        return self._vehicle.config.control.hover_thrust is not None

    @property
    def _starts_at(self) -> str:
        flown = self._vehicle.flown.hover_thrust
        return f"the hover thrust starts at {flown:g}; where that is wrong, the vehicle sinks or climbs when it engages"

    def _take_hover(self, hover: float) -> str | None:
        """The autopilot's hover thrust becomes ours where none is configured; what is wrong with it, or None."""
        if self._is_hover_configured:
            return None
        if not HOVER_RANGE[0] <= hover <= HOVER_RANGE[1]:
            return f"{HOVER_PARAMETER} is {hover:g}, not {HOVER_RANGE[0]:g} to {HOVER_RANGE[1]:g}: {self._starts_at}"
        self._vehicle.flown.take_hover(hover)
        log.info("hover_thrust_from_autopilot", hover_thrust=round(hover, 4))
        return None


def _judge(advice: Advice, vehicle: Vehicle) -> Callable[[float], str | None]:
    """What to say of a value, or None."""

    def judge(value: float) -> str | None:
        dangerous = advice.bad(value) and not advice.unless(vehicle.config)
        return f"{advice.name} is {value:g}: {advice.text}" if dangerous else None

    return judge
