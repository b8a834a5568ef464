"""The simulated PX4 as an ``Autopilot`` in the same process, driven by the event loop's clock: for virtual time.

Nothing is encoded; the messages are those of the wire, and the session that reads them is the live link's.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Protocol

from daemon.autopilot.px4 import Fields, Message, attitude_target
from daemon.autopilot.session import Px4Session, SessionParams
from daemon.autopilot.session_link import SessionLink
from daemon.messages import FlightMode, Setpoint

STEP_S = 0.004  # PX4's stamp grid
_LARGEST_CATCH_UP = 250  # steps: a loop that stalled for longer than a second drops simulated time
_POLL_STEPS = 5
_HEARTBEAT_STEPS = 250
_OURS = SessionParams(system_id=1, component_id=195)  # as MAVSDK's companion
_TIME_EPSILON_S = 1e-6  # rounding of sums of times
_HEARTBEAT: Message = (
    "HEARTBEAT",
    {"type": 18, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 0, "mavlink_version": 3},
)


class SteppedPx4(Protocol):
    """What is needed of a simulated PX4: it steps 4 ms, takes messages and gives messages."""

    def step(self) -> None:
        """Advance 4 ms."""

    def receive(self, name: str, fields: Fields, *, sender_system: int = 1, sender_component: int = 195) -> None:
        """Take a message of the sender with these MAVLink ids; its acks go back to them."""

    def take_outgoing(self) -> list[Message]:
        """Messages sent since the last call."""


class InProcessAutopilot(SessionLink):
    """Implements ``Autopilot``. Delays are in seconds and act in steps of 4 ms; ``run`` must be running.

    ``cut`` True cuts the wire: time goes on for the vehicle, nothing passes either way.
    """

    def __init__(
        self,
        px4: SteppedPx4,
        *,
        downlink_delay_s: float = 0.0,
        uplink_delay_s: float = 0.0,
        params: SessionParams | None = None,
    ) -> None:
        super().__init__(Px4Session(params or _OURS), self._flush_session)
        self.px4 = px4
        self.downlink_delay_s = downlink_delay_s
        self.uplink_delay_s = uplink_delay_s
        self.cut = False
        self._downlink: deque[tuple[float, Message]] = deque()
        self._uplink: deque[tuple[float, Message]] = deque()
        self._steps = 0
        self._time: Callable[[], float] = lambda: 0.0

    async def run(self) -> None:
        """Step the vehicle on a 4 ms grid of the loop's clock until cancelled."""
        loop = asyncio.get_running_loop()
        self._time = loop.time
        finished: asyncio.Future[None] = loop.create_future()
        start_s, start_steps = loop.time(), self._steps
        handle: asyncio.TimerHandle | None = None

        def pump() -> None:
            nonlocal handle, start_s, start_steps
            try:
                due = int((loop.time() - start_s) / STEP_S + 0.5) + start_steps - self._steps
                if due > _LARGEST_CATCH_UP:
                    start_s, start_steps, due = loop.time(), self._steps, 1
                for _ in range(due):
                    self._advance(loop.time())
            except Exception as error:  # noqa: BLE001  # a fault of the simulation ends run() with it
                finished.set_exception(error)
                return
            handle = loop.call_at(start_s + (self._steps + 1 - start_steps) * STEP_S, pump)

        handle = loop.call_at(start_s + STEP_S, pump)
        try:
            await finished
        finally:
            handle.cancel()

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send one body-rate setpoint now; False when there is no autopilot."""
        if not self.status.value.connected:
            return False
        self._send(attitude_target(setpoint))
        return True

    def request_mode(self, mode: FlightMode) -> bool:
        """Ask for a mode; False when there is no autopilot or it has no such mode."""
        message = self.session.mode_message(mode)
        if message is None:
            return False
        self.session.mode_requested(mode, self._time())
        self._send(message)
        return True

    def _advance(self, now_s: float) -> None:
        uplink, downlink, px4 = self._uplink, self._downlink, self.px4
        px4.step()  # the step that ends now; what arrives now acts from here on
        self._steps += 1
        while uplink and uplink[0][0] <= now_s + _TIME_EPSILON_S:
            px4.receive(*uplink.popleft()[1])
        if self._steps % _HEARTBEAT_STEPS == 1:
            self._send(_HEARTBEAT)
        outgoing = px4.take_outgoing()
        if outgoing and not self.cut:
            arrival_s = now_s + self.downlink_delay_s
            downlink.extend((arrival_s, message) for message in outgoing)
        while downlink and downlink[0][0] <= now_s + _TIME_EPSILON_S:
            name, fields = downlink.popleft()[1]
            self.session.receive(name, fields, now_s)
        if self._steps % _POLL_STEPS == 0:
            self.session.poll(now_s)
        self._flush_session()

    def _flush_session(self) -> None:
        for message in self.session.take_outgoing():
            self._send(message)

    def _send(self, message: Message) -> None:
        if self.cut:
            return
        if self.uplink_delay_s > 0.0:
            self._uplink.append((self._time() + self.uplink_delay_s, message))
        else:
            self.px4.receive(*message)
