"""The controller with its default parameters, on a vehicle at a point that it is to hold."""

from daemon.control import controller
from daemon.control.controller import ControlState
from daemon.control.parameters import ControlParameters
from daemon.messages import IDENTITY, ZERO3, EstimatedState, Quat, Reference, Setpoint, Vec3

P = ControlParameters()
DT = 0.01
HERE = (3.0, -2.0, -10.0)


def at(time_s: float, position: Vec3 = HERE, velocity: Vec3 = ZERO3, attitude: Quat = IDENTITY) -> EstimatedState:
    return EstimatedState(time_s, position, velocity, attitude, ZERO3)


def flown(
    state: ControlState, ticks: int, parameters: ControlParameters = P, **of: object
) -> tuple[ControlState, Setpoint]:
    """Step with the vehicle as it is at the reference, and return the last setpoint."""
    start = 0.0 if state.setpoint is None else state.time_s
    setpoint = Setpoint(ZERO3, 0.0)
    for i in range(1, ticks + 1):
        t = start + i * DT
        now = at(t, **of)  # type: ignore[arg-type]
        state, setpoint, _ = controller.step(state, now, now, Reference(t, HERE), DT, parameters=parameters)
    return state, setpoint
