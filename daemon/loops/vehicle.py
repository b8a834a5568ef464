"""The tasks of one vehicle, wired together; the same live and in virtual time."""

import asyncio
import contextlib
from collections.abc import Callable, Iterator

from daemon import logs
from daemon.autopilot.port import Autopilot, CommandTimeoutError
from daemon.guidance.parameters import GuidanceParameters
from daemon.latest import Latest
from daemon.loops.asking import CommandTimeouts
from daemon.loops.commander import Commander
from daemon.loops.control_task import ControlTask
from daemon.loops.flown_parameters import FlownParameters
from daemon.loops.garbage import Garbage
from daemon.loops.grid import Alarm, Grid
from daemon.loops.health_task import HealthTask
from daemon.loops.trajectory_task import TrajectoryTask
from daemon.messages import FlightMode, RequestKind, VehicleRequest
from daemon.pipeline import Parameters, Record
from daemon.safety.dead_man import SetpointGate, boot_clock
from daemon.safety.geofence import Geofence
from daemon.safety.supervisor import OURS
from daemon.settings import Config

RELEASE_S = 1.2
HOLD_TRIES, HOLD_PAUSE_S = 4, 0.1
FORGOTTEN_S = 1.0  # after a longer standstill nobody expects that what was asked before is still done

log = logs.get("vehicle")


class Vehicle:
    """Cells, tasks and the commander. ``alarm`` makes what wakes a grid: timerfd live, loop timer in virtual time.

    ``clock`` tells the gate of a gap: it goes on while the machine is suspended. ``forgetters`` are called after
    a standstill of more than ``FORGOTTEN_S``: what was asked before it neither takes nor moves the vehicle.
    """

    def __init__(
        self,
        config: Config,
        autopilot: Autopilot,
        alarm: Callable[[], Alarm],
        clock: Callable[[], float] = boot_clock,
    ) -> None:
        self.autopilot = autopilot
        self.flown = FlownParameters(config)
        self.parameters: Latest[Parameters] = self.flown.cell
        self.request: Latest[VehicleRequest | None] = Latest(None)
        self.record: Latest[Record | None] = Latest(None)
        self.gate = SetpointGate(autopilot, clock, config.safety.clock_gap_s)
        self.gate.gap_listeners.append(self._stood_still)
        control_grid = Grid(1.0 / config.loops.control_rate_hz, alarm())
        trajectory_grid = Grid(1.0 / config.loops.trajectory_rate_hz, alarm())
        self.trajectory = TrajectoryTask(
            trajectory_grid,
            self.record,
            self.request,
            autopilot.status,
            lambda: self.parameters.value.limits,
            lambda: self.flown.guidance,
            lambda: self.fence,
            config.loops.window_s,
        )
        self.control = ControlTask(
            autopilot,
            self.gate,
            control_grid,
            self.record,
            self.trajectory.window,
            self.request,
            self.parameters,
        )
        self.control.listeners.append(self.trajectory.on_control_tick)
        self.garbage = Garbage(control_grid)
        self.commander = Commander(
            autopilot, self.gate, self.record, self.request, CommandTimeouts(), self.flown.cannot_hover
        )
        self.control.listeners.append(self.commander.on_control_tick)
        self.forgetters: list[Callable[[], None]] = [self.commander.stood_still]
        self.health = HealthTask(self, Grid(0.2, alarm()))

    @property
    def config(self) -> Config:
        """The configuration that is flown now."""
        return self.flown.config

    @property
    def guidance(self) -> GuidanceParameters:
        """How references are made now."""
        return self.flown.guidance

    @property
    def fence(self) -> Geofence:
        """The geofence where it is called now."""
        return self.parameters.value.bounds.fence

    async def run(self) -> None:
        """Run all tasks until cancelled; the first that fails ends all, after it has handed over the vehicle."""
        try:
            async with asyncio.TaskGroup() as tasks:
                for part in (self.autopilot, self.control, self.trajectory, self.health):
                    tasks.create_task(self._handing_over(part))
        finally:
            await self.autopilot.close()

    async def _handing_over(self, part: Autopilot | ControlTask | TrajectoryTask | HealthTask) -> None:
        """Link and control task must not go down with a failed task before the autopilot has the vehicle."""
        try:
            await part.run()
        except Exception as error:
            with _noting(error):
                if self.trajectory.goal_id is not None:
                    self.trajectory.abort(self.trajectory.goal_id, "task_failed")
            with _noting(error):
                if part is not self.control:
                    await self.release()
            self.gate.latch()
            log.error("task_failed", exc_info=error)  # reads sources from disk: not before the vehicle is given away
            await self._let_go()
            raise

    async def _let_go(self) -> None:
        """Ask for Hold again, as the message may have been lost, until the autopilot has left offboard."""
        for _ in range(HOLD_TRIES):
            await asyncio.sleep(HOLD_PAUSE_S)
            if self.autopilot.status.value.mode is not FlightMode.OFFBOARD:
                return
            self.autopilot.request_mode(FlightMode.HOLD)

    def _stood_still(self, gap_s: float) -> None:
        self.autopilot.stood_still()
        log.warning("stood_still", seconds=round(gap_s, 2))
        if gap_s > FORGOTTEN_S:
            for forget in self.forgetters:
                forget()

    @property
    def stopping(self) -> bool:
        """Whether the vehicle was handed over for good."""
        return self.commander.stopping

    def set_config(self, config: Config) -> None:
        """Fly with other gains and limits from the next tick on. Raises ``ValueError`` and changes nothing."""
        self.flown.set_config(config, self.control.state.control.model.hover_thrust)

    async def release(self) -> None:
        """Hand the vehicle over to Hold if it is ours or about to be, within ``RELEASE_S``; take it no more.

        One that was armed here and stands on the ground is disarmed.
        The active goal ends ``aborted``, ``stopping``; there is none after it.
        """
        self.commander.stop()
        taken = self._is_taken()
        if taken:
            self.commander.post(RequestKind.HOLD)
        if self.trajectory.goal_id is not None:
            self.trajectory.abort(self.trajectory.goal_id, "stopping")
        if taken:
            with contextlib.suppress(CommandTimeoutError):
                await self.commander.wait_for(lambda: self.commander.state not in OURS, RELEASE_S, "released")
        else:
            await self.commander.stand_down(RELEASE_S)

    def _is_taken(self) -> bool:
        """Whether the vehicle is ours, or an engage is on its way to the supervisor."""
        last = self.request.value
        engages = last is not None and last.kind is RequestKind.ENGAGE
        return self.commander.state in OURS or (engages and not self.commander.read)


@contextlib.contextmanager
def _noting(error: Exception) -> Iterator[None]:
    """What fails on the way of giving the vehicle away is added to the error that began it, and stops nothing."""
    try:
        yield
    except Exception as further:  # noqa: BLE001 - whatever else is broken, the vehicle is given away
        error.add_note(f"and then: {further!r}")
