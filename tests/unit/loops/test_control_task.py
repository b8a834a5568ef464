"""What the control task gives to the gate."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from support.pipeline_rig import CONFIG, PARAMETERS

from daemon.latest import Latest
from daemon.loops.control_task import ControlTask
from daemon.messages import AutopilotStatus, Setpoint
from daemon.parameters import geofence, pipeline_parameters


@dataclass
class _Gate:
    latched: bool = False
    hover: list[float] = field(default_factory=list)

    def check_gap(self) -> None:
        pass

    def tick(self, _setpoint: Setpoint | None, hover_thrust: float) -> None:
        self.hover.append(hover_thrust)


def test_the_gate_levels_at_the_hover_thrust_of_this_vehicle() -> None:
    gate: Any = _Gate()
    autopilot: Any = SimpleNamespace(
        odometry=Latest(None), imu=Latest(None), status=Latest(AutopilotStatus()), clock=Latest(None)
    )
    grid: Any = None
    parameters = pipeline_parameters(CONFIG, geofence(CONFIG, (0.0, 0.0, 0.0)), 0.37)
    task = ControlTask(autopilot, gate, grid, Latest(None), Latest(None), Latest(None), Latest(parameters))
    task.tick(0.01, 0.01)
    assert gate.hover == [0.37]
    assert PARAMETERS.control.hover_thrust != 0.37
