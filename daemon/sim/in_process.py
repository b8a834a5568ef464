"""The simulated PX4 as an ``Autopilot`` in the same process, driven by the event loop's clock: for virtual time.

Nothing is encoded; the messages are those of the wire, and the session that reads them is the live link's.
"""

import asyncio
from collections.abc import Callable
from typing import Protocol

from daemon.autopilot.px4 import Fields, Message, attitude_target, is_sendable
from daemon.autopilot.session import Px4Session, SessionParams
from daemon.autopilot.session_link import SessionLink
from daemon.messages import FlightMode, Setpoint

STEP_S = 0.004  # PX4's stamp grid
_LARGEST_CATCH_UP = 250  # steps: a loop that stalled for longer than a second drops simulated time
_POLL_STEPS = 5
_HEARTBEAT_STEPS = 250
_OURS = SessionParams(system_id=1, component_id=195)  # as MAVSDK's companion
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
    """Implements ``Autopilot``; ``run`` must be running. Delays and losses are the simulated PX4's own affair."""

    def __init__(self, px4: SteppedPx4, *, params: SessionParams | None = None) -> None:
        super().__init__(Px4Session(params or _OURS), self._flush_session)
        self.px4 = px4
        self._steps = 0
        self._time: Callable[[], float] = lambda: 0.0
        self._pumps: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Step the vehicle on a 4 ms grid of the loop's clock. Whatever ends this, it flies on until ``close``."""
        loop = asyncio.get_running_loop()
        self._time = loop.time
        failed: asyncio.Future[None] = loop.create_future()
        start_s, start_steps = loop.time(), self._steps

        def pump() -> None:
            nonlocal start_s, start_steps
            try:
                due = int((loop.time() - start_s) / STEP_S + 0.5) + start_steps - self._steps
                if due > _LARGEST_CATCH_UP:
                    start_s, start_steps, due = loop.time(), self._steps, 1
                for _ in range(due):
                    self._advance(loop.time())
            except Exception as error:  # noqa: BLE001  # a fault of session or simulation ends run() with it
                if not failed.done():
                    failed.set_exception(error)
            self._pumps = loop.call_at(start_s + (self._steps + 1 - start_steps) * STEP_S, pump)

        self._pumps = loop.call_at(start_s + STEP_S, pump)
        await failed

    async def close(self) -> None:
        """The vehicle stands still from now on."""
        if self._pumps is not None:
            self._pumps.cancel()

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send one body-rate setpoint now; False when there is no autopilot or it is not finite."""
        if not self.status.value.connected or not is_sendable(setpoint):
            return False
        self.px4.receive(*attitude_target(setpoint))
        return True

    def request_mode(self, mode: FlightMode) -> bool:
        """Ask for a mode; False when there is no autopilot or it has no such mode."""
        message = self.session.mode_message(mode)
        if message is None:
            return False
        self.session.mode_requested(mode, self._time())
        self.px4.receive(*message)
        return True

    def _advance(self, now_s: float) -> None:
        self._steps += 1
        self.px4.step()
        if self._steps % _HEARTBEAT_STEPS == 1:
            self.px4.receive(*_HEARTBEAT)
        for name, fields in self.px4.take_outgoing():
            self.session.receive(name, fields, now_s)
        if self._steps % _POLL_STEPS == 0:
            self.session.poll(now_s)
        self._flush_session()

    def _flush_session(self) -> None:
        for message in self.session.take_outgoing():
            self.px4.receive(*message)
