"""What the daemon knows of its PX4 and what it must tell it, without I/O: messages and times in, messages out.

Both links are thin transports around it. All of it belongs to one thread, except ``receive_sample``.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import inf

from daemon.autopilot import decode, events, param_reads, status_messages, streams
from daemon.autopilot.acks import Done
from daemon.autopilot.arrivals import QUIET_S, Arrivals
from daemon.autopilot.ordering import Order, SampleOrder
from daemon.autopilot.port import NotConnectedError
from daemon.autopilot.px4 import (
    CMD_SET_MESSAGE_INTERVAL,
    HEARTBEAT_ID,
    Fields,
    Message,
    is_requestable,
    request_message,
    set_mode,
)
from daemon.autopilot.requests import Requests
from daemon.autopilot.timesync import TimeSync
from daemon.latest import Latest
from daemon.messages import AutopilotStatus, ClockSync, FlightMode, Imu, Odometry

SAMPLES = ("ODOMETRY", "HIGHRES_IMU")
_EVENTS_KEPT = 64
_ASK_MODE_AGAIN_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionParams:
    """``link_timeout_s``: without any message for so long the link is lost, 1.5 s: a hand-over begins and ends before.

    ``system_id``, ``component_id``: our own MAVLink ids, to know our acks from others'; 0 takes every ack.
    """

    link_timeout_s: float = 1.5
    system_id: int = 0
    component_id: int = 0


class Px4Session:
    """The port's cells; ``receive`` and ``poll`` feed it, ``take_outgoing`` empties it.

    ``connected`` needs messages that keep coming and a HEARTBEAT of PX4 since they do, so that mode and armed state
    are never older than the connection. ``malformed`` counts messages that could not be read, by name.
    ``heard`` and ``connected`` count only what is of now (``Arrivals``); ``slow_streams`` tells when TIMESYNC fails it.
    """

    def __init__(self, params: SessionParams | None = None) -> None:
        self.params = params or SessionParams()
        self.odometry: Latest[Odometry | None] = Latest(None)
        self.imu: Latest[Imu | None] = Latest(None)
        self.status = Latest(AutopilotStatus())
        self.clock: Latest[ClockSync | None] = Latest(None)
        self.slow_streams: Latest[tuple[str, ...]] = Latest(())
        self.monitor = streams.StreamMonitor()
        self.malformed: dict[str, int] = {}
        self._events: deque[str] = deque(maxlen=_EVENTS_KEPT)
        self._arrivals = Arrivals()
        self._mode_asked_s = -inf
        self._flowing = False
        self._order = SampleOrder()
        self._time_sync = TimeSync()
        self._requests = Requests(self.params.system_id, self.params.component_id)
        self._outgoing: list[Message] = []
        self._handlers: dict[str, Callable[[Fields, float], None]] = {
            "EVENT": self._on_event,
            "TIMESYNC": self._on_timesync,
            "COMMAND_ACK": self._on_command_ack,
            "PARAM_VALUE": lambda fields, _now_s: self._requests.parameter(fields),
            "PARAM_ERROR": lambda fields, _now_s: self._requests.parameter_error(fields),
        }
        for name, after in status_messages.AFTER.items():
            self._handlers[name] = partial(self._on_status, after)
        for name, after in status_messages.MODE_AFTER.items():
            self._handlers[name] = partial(self._on_mode, after)

    @property
    def wanted(self) -> tuple[str, ...]:
        """Names of the messages that the session takes."""
        return (*SAMPLES, *self._handlers)

    # ---- in

    def receive(self, name: str, fields: Fields, now_s: float) -> None:
        """Take one message of the autopilot; one that cannot be read is counted and dropped."""
        self._note_arrival(now_s)
        if name in SAMPLES:
            if not self.receive_sample(name, fields, now_s):
                self._on_reboot(now_s)
                self.receive_sample(name, fields, now_s)
            return
        handler = self._handlers.get(name)
        if handler is None:
            return
        self.monitor.count(name)
        before = self.status.value
        try:
            handler(fields, now_s)
        except (KeyError, TypeError, ValueError, IndexError):
            self._count_malformed(name)
        status = self.status.value
        if status.mode is not before.mode:
            self._update(mode_before=before.mode)
        self._requests.status_changed(before, status)
        self._listen(now_s)

    def receive_sample(self, name: str, fields: Fields, now_s: float) -> bool:
        """The hot path of ODOMETRY and HIGHRES_IMU: only writes the cell, so another thread may call it.

        False: not taken, because the autopilot has rebooted; give this message to ``receive`` in the
        session's own thread.
        """
        try:
            sample = decode.odometry(fields, now_s) if name == "ODOMETRY" else decode.imu(fields, now_s)
        except (KeyError, TypeError, ValueError, IndexError):
            self._count_malformed(name)
            return True
        order = self._order.judge(name, sample.stamp_us, now_s)
        if order is not Order.NEWER:
            return order is Order.OVERTAKEN
        self._arrivals.note(now_s)
        self.monitor.count(name)
        if isinstance(sample, Odometry):
            self.odometry.set(sample)
        else:
            self.imu.set(sample)
        return True

    def poll(self, now_s: float) -> None:
        """Time passes: notice a lost link, repeat what was not answered. Call it every 0.1 s or so."""
        silent = self._arrivals.silent_for(self.params.link_timeout_s, now_s)
        if not self._flowing and not silent:
            self._begin_flow(now_s)  # samples alone came back, by the hot path
        elif self._flowing and silent:
            self._flowing = False
            self._update(connected=False)
            self._forget_clock()
            self._requests.forget("the link to the autopilot was lost")
        self._listen(now_s)
        if not self._flowing:
            return
        self._outgoing += self._time_sync.poll(now_s)
        self._publish_clock()
        self._outgoing += self._requests.commands_again(now_s, self.status.value)
        self._outgoing += self.monitor.check(now_s)
        self._publish_slow_streams()
        if self.odometry.value is not None:
            self._outgoing += self.monitor.follow(self.odometry.value.reset_counter)
        self._outgoing += self._requests.parameters_again(now_s)

    def _listen(self, now_s: float) -> None:
        """Notice a silence; as it ends ask for the mode, told within 0.5 s by itself, and for what proves it of now."""
        quiet = self._arrivals.silent_for(QUIET_S, now_s)
        heard = self.status.value.heard
        if heard and (quiet or not self._of_now):
            self._update(heard=False)
        elif not (quiet or heard) and now_s - self._mode_asked_s >= _ASK_MODE_AGAIN_S:
            self.ask_mode(now_s)

    def stood_still(self, now_s: float) -> None:
        """What has come, and waits for us, tells of the past."""
        self._arrivals.stood_still(now_s)
        self._update(heard=False)
        self.monitor.begin(now_s)
        if self._flowing:
            self.ask_mode(now_s)

    def ask_mode(self, now_s: float) -> None:
        """Ask what the autopilot flies now: ``status.told_s`` of the answer is not before this."""
        self._mode_asked_s = now_s
        self._outgoing += [self._time_sync.ask(now_s), request_message(HEARTBEAT_ID)]

    # ---- out

    def take_outgoing(self) -> list[Message]:
        """Messages to send now, in order."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def take_events(self) -> list[str]:
        """What PX4 said in EVENT messages since the last call, in words."""
        said = list(self._events)
        self._events.clear()
        return said

    def mode_message(self, mode: FlightMode) -> Message | None:
        """The message that asks for a mode; None before the first HEARTBEAT or when PX4 has no word for it. Any thread.

        A lost link does not hinder: the autopilot may still hear what we do not hear answered.
        """
        status = self.status.value
        if status.heartbeat_s == -inf or not is_requestable(mode):
            return None
        return set_mode(mode, armed=status.armed)

    def mode_requested(self, mode: FlightMode, now_s: float) -> None:
        """A ``mode_message`` was sent, or is about to be: its acks are expected."""
        self._requests.mode_requested(mode, now_s)
        self._update(mode_refusal=None)

    def start_command(self, message: Message, now_s: float, timeout_s: float, done: Done) -> None:
        """Send a command and call ``done`` with its error or None; NotConnectedError when there is no autopilot."""
        if not self.status.value.connected:
            raise NotConnectedError("no autopilot is connected")
        self._requests.start_command(message, now_s, timeout_s, done)
        self._outgoing.append(message)

    def drop_command(self, done: Done) -> None:
        """Nobody waits for this command any more: it is not sent again."""
        self._requests.drop_command(done)

    def withdraw_commands(self) -> None:
        """End every command that waits for its acknowledgement: none is sent again."""
        self._requests.withdraw_commands()

    def read_parameter(self, name: str, now_s: float, timeout_s: float, done: param_reads.Done) -> None:
        """Ask for a parameter and call ``done`` with it, None for one that PX4 does not know, or why none came."""
        self._outgoing.append(self._requests.start_parameter(name, now_s, timeout_s, done))

    # ---- messages

    def _update(self, **changes: object) -> None:
        self.status.set(replace(self.status.value, **changes))  # type: ignore[arg-type]

    def _on_status(self, after: status_messages.After, fields: Fields, now_s: float) -> None:
        before = self.status.value
        told = after(before, fields, now_s)
        if not self._of_now:
            told = replace(told, heard=False, connected=before.connected)
        self.status.set(told)

    def _on_mode(self, after: status_messages.After, fields: Fields, now_s: float) -> None:
        self._on_status(after, fields, now_s)
        self._update(told_s=self._arrivals.sent_after(self._time_sync.answered_s, now_s))

    def _count_malformed(self, name: str) -> None:
        self.malformed[name] = self.malformed.get(name, 0) + 1

    def _note_arrival(self, now_s: float) -> None:
        self._arrivals.note(now_s)
        if not self._flowing:
            self._begin_flow(now_s)

    @property
    def _of_now(self) -> bool:
        return self._arrivals.of_now(self._time_sync.answered_s)

    def _begin_flow(self, now_s: float) -> None:
        self._flowing = True
        self._outgoing += streams.requests()
        self.monitor.restart(now_s)

    def _on_reboot(self, now_s: float) -> None:
        self._order.restart()
        self._forget_clock()
        self._requests.rebooted()
        self.status.set(AutopilotStatus(boot_count=self.status.value.boot_count + 1))
        self._begin_flow(now_s)

    def _forget_clock(self) -> None:
        self._time_sync.restart()
        self._publish_clock()

    def _publish_slow_streams(self) -> None:
        if self.slow_streams.value != self.monitor.slow:
            self.slow_streams.set(self.monitor.slow)

    def _publish_clock(self) -> None:
        if self.clock.value is not self._time_sync.sync:
            self.clock.set(self._time_sync.sync)

    def _on_timesync(self, fields: Fields, now_s: float) -> None:
        answered_s = self._time_sync.answered_s
        self._outgoing += self._time_sync.receive(fields, now_s)
        if self._time_sync.answered_s > answered_s:
            self.monitor.count(streams.ANSWERS)
        self._publish_clock()

    def _on_event(self, fields: Fields, now_s: float) -> None:
        event = events.decode(fields)
        if event.text is not None and not event.check_states:
            self._events.append(event.text)
        refusal = self._requests.explained(event, now_s)
        if event.mode is not None:
            self._update(mode=event.mode, heard=self._of_now, intended_mode=event.intended_mode)
        if event.disarmed:
            self._update(armed=False)
        if refusal is not None:
            self._update(mode_refusal=refusal)

    def _on_command_ack(self, fields: Fields, now_s: float) -> None:
        if not self._requests.is_ours(fields):
            return
        command, result = int(fields["command"]), int(fields["result"])
        if command == CMD_SET_MESSAGE_INTERVAL:
            self.monitor.acknowledged()
            return
        refusal = self._requests.ack(command, result, now_s)
        if refusal is not None:
            self._update(mode_refusal=refusal)
