"""The pulses that are added to the setpoints of a hovering vehicle."""

from dataclasses import dataclass, replace
from enum import Enum
from math import radians

from daemon.control.parameters import ControlParameters
from daemon.messages import Setpoint

LEAD_S = 0.3
_LIMIT_SHARE = 0.5  # of the configured limit that a pulse takes at most
_THRUST_SHARE = 0.15  # of hover thrust


class Axis(Enum):
    """What is pulsed: a body rate, or the collective thrust."""

    ROLL = "roll"
    PITCH = "pitch"
    YAW = "yaw"
    THRUST = "thrust"


RATE_AXES = (Axis.ROLL, Axis.PITCH, Axis.YAW)


@dataclass(frozen=True, slots=True)
class Pulse:
    """Up for a quarter, down for two, up for one, then rest: neither rate nor angle is left at its end.

    ``start_s`` counts from the programme's start; ``size`` is in rad/s, or of the normalized thrust, with its sign.
    """

    axis: Axis
    start_s: float
    size: float
    quarter_s: float
    rest_s: float

    @property
    def end_s(self) -> float:
        """When its rest is over."""
        return self.start_s + 4.0 * self.quarter_s + self.rest_s

    def at(self, time_s: float) -> float:
        """What is added at a time of the programme."""
        quarter = (time_s - self.start_s) / self.quarter_s
        if not 0.0 <= quarter < 4.0:
            return 0.0
        return -self.size if 1.0 <= quarter < 3.0 else self.size


Programme = tuple[Pulse, ...]


def programme(parameters: ControlParameters, repetitions: int = 6) -> Programme:
    """Pulses of both signs on every axis, one after the other, within the limits of the parameters."""
    tilt_rate = min(radians(35.0), _LIMIT_SHARE * parameters.rate_max_rad_s)
    yaw_rate = min(radians(35.0), _LIMIT_SHARE * parameters.yaw_rate_max_rad_s)
    room = min(parameters.thrust_max - parameters.hover_thrust, parameters.hover_thrust - parameters.thrust_min)
    thrust = min(_THRUST_SHARE * parameters.hover_thrust, _LIMIT_SHARE * max(room, 0.0))
    shapes = (
        Pulse(Axis.ROLL, 0.0, tilt_rate, 0.2, 1.2),
        Pulse(Axis.PITCH, 0.0, tilt_rate, 0.2, 1.2),
        Pulse(Axis.YAW, 0.0, yaw_rate, 0.6, 1.8),
        Pulse(Axis.THRUST, 0.0, thrust, 0.3, 1.5),
    )
    pulses: list[Pulse] = []
    for shape in shapes:
        for number in range(repetitions):
            start_s = pulses[-1].end_s if pulses else LEAD_S
            pulses.append(replace(shape, start_s=start_s, size=shape.size if number % 2 == 0 else -shape.size))
    return tuple(pulses)


def with_pulse(setpoint: Setpoint, pulse: Pulse, time_s: float) -> Setpoint:
    """The setpoint with what a pulse adds at a time of the programme."""
    added = pulse.at(time_s)
    x, y, z = setpoint.rates_frd_rad_s
    match pulse.axis:
        case Axis.ROLL:
            return Setpoint((x + added, y, z), setpoint.thrust)
        case Axis.PITCH:
            return Setpoint((x, y + added, z), setpoint.thrust)
        case Axis.YAW:
            return Setpoint((x, y, z + added), setpoint.thrust)
        case Axis.THRUST:
            return Setpoint((x, y, z), setpoint.thrust + added)
