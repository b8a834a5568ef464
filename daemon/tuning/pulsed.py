"""An autopilot whose setpoints carry pulses, for as long as somebody goes on permitting them."""

from collections.abc import Callable
from dataclasses import dataclass

from daemon.autopilot.port import Autopilot, Command
from daemon.control import limits
from daemon.control.parameters import ControlParameters
from daemon.messages import FlightMode, Setpoint
from daemon.tuning.pulses import Programme, with_pulse


@dataclass(frozen=True, slots=True)
class Sent:
    """A setpoint that left, and when."""

    time_s: float
    setpoint: Setpoint


class PulsedAutopilot:
    """Implements ``Autopilot``. Without a permission that is still good, setpoints leave as they came.

    A pulsed setpoint keeps the limits of ``parameters``: rates, thrust and how fast they change.
    """

    def __init__(self, autopilot: Autopilot, parameters: ControlParameters, clock: Callable[[], float]) -> None:
        self.odometry = autopilot.odometry
        self.imu = autopilot.imu
        self.status = autopilot.status
        self.clock = autopilot.clock
        self.slow_streams = autopilot.slow_streams
        self.sent: list[Sent] = []
        self._autopilot = autopilot
        self._parameters = parameters
        self._clock = clock
        self._programme: Programme = ()
        self._begun_s = 0.0
        self._permitted_until_s = float("-inf")

    def begin(self, programme: Programme) -> float:
        """The programme starts now; returns the time of that."""
        self._programme, self._begun_s = programme, self._clock()
        self.sent = []
        return self._begun_s

    def permit(self, until_s: float) -> None:
        """Pulses may leave until then. Whoever permits has to do so again every tick."""
        self._permitted_until_s = until_s

    async def run(self) -> None:
        """See ``Autopilot``."""
        await self._autopilot.run()

    async def close(self) -> None:
        """See ``Autopilot``."""
        await self._autopilot.close()

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send the setpoint with its pulse; from the dead-man's thread, when nobody permits, as it is."""
        now_s = self._clock()
        if now_s <= self._permitted_until_s:
            setpoint = self._pulsed(setpoint, now_s)
        left = self._autopilot.send_setpoint(setpoint)
        if left:
            self.sent.append(Sent(now_s, setpoint))
        return left

    def request_mode(self, mode: FlightMode) -> bool:
        """See ``Autopilot``."""
        return self._autopilot.request_mode(mode)

    async def command(self, command: Command, timeout_s: float) -> None:
        """See ``Autopilot``."""
        await self._autopilot.command(command, timeout_s)

    def withdraw_commands(self) -> None:
        """See ``Autopilot``."""
        self._autopilot.withdraw_commands()

    def ask_mode(self) -> None:
        """See ``Autopilot``."""
        self._autopilot.ask_mode()

    def stood_still(self) -> None:
        """See ``Autopilot``."""
        self._autopilot.stood_still()

    async def read_parameter(self, name: str, timeout_s: float) -> float | int | None:
        """See ``Autopilot``."""
        return await self._autopilot.read_parameter(name, timeout_s)

    def _pulsed(self, setpoint: Setpoint, now_s: float) -> Setpoint:
        p, time_s = self._parameters, now_s - self._begun_s
        last = self.sent[-1] if self.sent else Sent(now_s, setpoint)
        wanted = setpoint
        for pulse in self._programme:
            if pulse.start_s <= time_s < pulse.end_s:
                wanted = with_pulse(setpoint, pulse, time_s)
        dt_s = now_s - last.time_s
        slewed = limits.toward(
            last.setpoint,
            wanted,
            rate_step_rad_s=p.rate_slew_max_rad_s2 * dt_s,
            thrust_step=p.thrust_slew_max_1_s * dt_s,
        )
        return limits.within(
            slewed,
            rate_max_rad_s=p.rate_max_rad_s,
            yaw_rate_max_rad_s=p.yaw_rate_max_rad_s,
            thrust_min=p.thrust_min,
            thrust_max=p.thrust_max,
            fallback_thrust=setpoint.thrust,
        )
