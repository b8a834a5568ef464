"""The control task: read the newest, step the pipeline, publish; on a fixed grid, whatever telemetry does."""

from collections.abc import Callable
from time import perf_counter

from daemon import pipeline
from daemon.autopilot.port import Autopilot
from daemon.latest import Latest
from daemon.loops.grid import Grid
from daemon.loops.watchers import Watchers
from daemon.messages import ExternalPose, ReferenceWindow, VehicleRequest
from daemon.pipeline import Inputs, Parameters, PipelineState, Record
from daemon.safety.dead_man import SetpointGate
from daemon.safety.supervisor import State


class ControlTask:
    """Owns the pipeline's state; writes ``record``, reads everything else.

    ``listeners`` get the inputs and the record of each tick and fly with it: an error of theirs ends the task.
    ``watchers`` get them too, after the listeners, and take nothing down. Both must be quick.
    ``pose`` is written by whoever has poses from outside. ``step_s`` is what the last step of the pipeline cost.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        gate: SetpointGate,
        grid: Grid,
        record: Latest[Record | None],
        window: Latest[ReferenceWindow | None],
        request: Latest[VehicleRequest | None],
        parameters: Latest[Parameters],
    ) -> None:
        self.record = record
        self.listeners: list[Callable[[Inputs, Record], None]] = []
        self.watchers = Watchers()
        self.grid = grid
        self.pose: Latest[ExternalPose | None] = Latest(None)
        self.step_s = 0.0
        self._autopilot = autopilot
        self._gate = gate
        self._window = window
        self._request = request
        self._parameters = parameters
        self._state = pipeline.initial(parameters.value)

    @property
    def state(self) -> PipelineState:
        """The flow's memory after the newest tick, for the flight record."""
        return self._state

    async def run(self) -> None:
        """Tick until cancelled."""
        await self.grid.run(self.tick)

    def tick(self, now_s: float, dt_s: float) -> None:
        """Read, compute, publish."""
        self._gate.check_gap()
        inputs = self._read()
        begun_s = perf_counter()
        self._state, setpoint, record = pipeline.step(self._state, inputs, now_s, dt_s)
        self.step_s = perf_counter() - begun_s
        self._gate.tick(setpoint, self._state.control.model.hover_thrust)
        for mode in record.modes:
            self._autopilot.request_mode(mode)
        if record.supervision.state is State.ENGAGING:
            self._autopilot.ask_mode()
        self.record.set(record)
        for listener in self.listeners:
            listener(inputs, record)
        self.watchers.tell(inputs, record)

    def _read(self) -> Inputs:
        return Inputs(
            odometry=self._autopilot.odometry.value,
            imu=self._autopilot.imu.value,
            status=self._autopilot.status.value,
            window=self._window.value,
            request=self._request.value,
            latched=self._gate.latched,
            parameters=self._parameters.value,
            pose=self.pose.value,
            clock=self._autopilot.clock.value,
        )
