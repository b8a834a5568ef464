"""The live link: MAVSDK's synchronous ``MavlinkDirect``, the only file that imports mavsdk.

MAVSDK's threads call back; ODOMETRY and HIGHRES_IMU go straight into their cells, everything else is handed to the
event loop. Nothing here uses the offboard plugin, which would repeat setpoints by itself.
"""

import asyncio
import contextlib
import json
import math
import struct
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pydantic_core
from mavsdk.component_type import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.system import System

from daemon import logs
from daemon.autopilot.px4 import SET_ATTITUDE_TARGET_RATES_MASK, Fields, Message, is_sendable
from daemon.autopilot.serial_port import SerialPort
from daemon.autopilot.session import SAMPLES, Px4Session, SessionParams
from daemon.autopilot.session_link import SessionLink
from daemon.autopilot.threads import ThreadStates, aside
from daemon.messages import AutopilotStatus, FlightMode, Setpoint

_POLL_S = 0.1
_RETRY_S = 1.0
_TRIES_A_LINE = 10
_CLOSE_S = 0.8
_REMEMBERED_LINES = 256
_AUTOPILOT_COMPONENT = 1
_PARAM_TYPES_BYTEWISE = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}  # MAV_PARAM_TYPE, PX4 packs bytewise
_SEND_ERRORS = (MavsdkError, RuntimeError, ValueError)

_log = logs.get("mavsdk")
_LOG_METHODS = {LogLevel.DEBUG: "debug", LogLevel.INFO: "info", LogLevel.WARN: "warning", LogLevel.ERROR: "error"}


class _MavsdkLog:
    """Takes MAVSDK's log lines, from any thread; a line that repeats is written once in ``again_s``, with its count."""

    def __init__(self, again_s: float = 10.0) -> None:
        self._again_s = again_s
        self._lock = threading.Lock()
        self._lines: dict[str, tuple[float, int]] = {}

    def __call__(self, level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        now_s = time.monotonic()
        with self._lock:
            written_s, repeats = self._lines.get(text, (-math.inf, 0))
            fresh = now_s - written_s >= self._again_s
            if len(self._lines) >= _REMEMBERED_LINES:
                self._lines.clear()
            self._lines[text] = (now_s, 0) if fresh else (written_s, repeats + 1)
        if fresh:
            getattr(_log, _LOG_METHODS[level])("mavsdk", text=text, **({"repeats": repeats} if repeats else {}))
        return True  # handled: MAVSDK does not print it


class _Wire:
    """One connected system: its MavlinkDirect, and sends that are safe from any thread and against ``cut``."""

    def __init__(self, system: System, own_system_id: int, own_component_id: int) -> None:
        self.direct = MavlinkDirect(system)
        self.system_id = system.get_system_id()
        self._lock = threading.Lock()
        self._open = True
        self._ids = (own_system_id, own_component_id, self.system_id, _AUTOPILOT_COMPONENT)
        self._setpoint_json = (
            json.dumps(
                {
                    "target_system": self.system_id,
                    "target_component": _AUTOPILOT_COMPONENT,
                    "time_boot_ms": 0,
                    "type_mask": SET_ATTITUDE_TARGET_RATES_MASK,
                    "q": [1.0, 0.0, 0.0, 0.0],
                    "thrust_body": [0.0, 0.0, 0.0],
                }
            )[:-1]
            + ',"body_roll_rate":%.9g,"body_pitch_rate":%.9g,"body_yaw_rate":%.9g,"thrust":%.9g}'
        )

    def send_json(self, name: str, fields_json: str) -> bool:
        """Send; False when MAVSDK would not."""
        message = MavlinkMessage(name, *self._ids, fields_json)
        with self._lock:
            if not self._open:
                return False
            try:
                self.direct.send_message(message)
            except _SEND_ERRORS:
                return False
        return True

    def send(self, message: Message) -> bool:
        """Send a message of field dicts; NaN travels as null, MAVSDK fills in the target ids."""
        name, fields = message
        numbers = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in fields.items()}
        return self.send_json(name, json.dumps(numbers))

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send SET_ATTITUDE_TARGET; a number that is not finite is never sent."""
        if not is_sendable(setpoint):
            return False
        values = (*setpoint.rates_frd_rad_s, setpoint.thrust)
        return self.send_json("SET_ATTITUDE_TARGET", self._setpoint_json % values)

    def cut(self) -> None:
        """No send begins after this, and none is under way."""
        with self._lock:
            self._open = False


class MavsdkLink(SessionLink):
    """Implements ``Autopilot`` on MAVSDK. ``url`` as MAVSDK's: udpin://127.0.0.1:14540, serial:///dev/ttyAMA0:921600.

    ``run`` opens the connection (again and again while that fails, and anew for a serial device that was plugged in
    again), waits for an autopilot and keeps the cells fresh.
    """

    def __init__(self, url: str, *, link_timeout_s: float = 1.5) -> None:
        log_subscribe(_MavsdkLog())
        self._configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        own_ids = (self._configuration.system_id, self._configuration.component_id)
        params = SessionParams(link_timeout_s=link_timeout_s, system_id=own_ids[0], component_id=own_ids[1])
        super().__init__(Px4Session(params), self._flush_session)
        self.url = url
        self._own_ids = own_ids
        self._threads = ThreadStates()
        self._sdk: Mavsdk | None = None
        self._wire: _Wire | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._loop_thread = 0

    async def run(self) -> None:
        """Connect, ask for the streams on every (re)connect, keep the cells fresh, until cancelled."""
        self._loop, self._loop_thread = asyncio.get_running_loop(), threading.get_ident()
        sdk = Mavsdk(self._configuration)
        port = SerialPort(self.url)
        connection = await self._open(sdk, port)
        tasks = [asyncio.ensure_future(work) for work in (self._fly(sdk), self._reopen(sdk, port, connection))]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()

    async def _fly(self, sdk: Mavsdk) -> None:
        system = await self._first_autopilot(sdk)
        self._wire = _Wire(system, *self._own_ids)
        for name in self.session.wanted:
            self._wire.direct.subscribe_message(name, self._callback(name))
        _log.info("autopilot_found", system_id=self._wire.system_id)
        await self._keep(sdk)

    async def close(self) -> None:
        """Nothing is sent any more; ends MAVSDK, or leaves it behind after ``_CLOSE_S``."""
        sdk, wire = self._sdk, self._wire
        self._sdk = self._wire = None
        if sdk is None:  # it may still be opening: nothing may be taken from under it
            return

        def end() -> None:
            if wire is not None:
                wire.cut()  # waits for a send that is under way
            sdk.destroy()

        try:
            await asyncio.wait_for(aside(end), _CLOSE_S)
        except TimeoutError:
            _log.warning("mavsdk_left_behind")

    def send_setpoint(self, setpoint: Setpoint) -> bool:
        """Send one body-rate setpoint now, from any thread; False when there is no autopilot or it is not finite."""
        wire = self._wire
        return wire is not None and self.status.value.connected and wire.send_setpoint(setpoint)

    def request_mode(self, mode: FlightMode) -> bool:
        """Ask for a mode now, from any thread; the outcome shows in ``status``."""
        wire, loop = self._wire, self._loop
        message = self.session.mode_message(mode)
        if wire is None or loop is None or message is None:
            return False
        if threading.get_ident() == self._loop_thread:
            self.session.mode_requested(mode, loop.time())
        else:
            self._hand_over(self.session.mode_requested, mode, loop.time())
        return wire.send(message)

    # ---- opening

    async def _open(self, sdk: Mavsdk, port: SerialPort) -> Any:
        """Open the connection; returns MAVSDK's handle of it."""
        self._sdk = None
        tries = 0
        while True:
            tries += 1
            port.opened()
            try:
                connection = await aside(lambda: sdk.add_any_connection_with_handle(self.url))
            except MavsdkError as error:
                if tries % _TRIES_A_LINE == 1:
                    reason = str(error).rpartition(" ")[2]
                    _log.warning("connection_failed", url=self.url, result=reason, tries=tries)
                await asyncio.sleep(_RETRY_S)
                continue
            self._sdk = sdk
            _log.info("waiting_for_autopilot", url=self.url)
            return connection

    async def _reopen(self, sdk: Mavsdk, port: SerialPort, connection: Any) -> None:
        """MAVSDK never looks again at a device that went away: open the one that came instead of it."""
        while True:
            await asyncio.sleep(_POLL_S)
            if port.is_another():
                _log.warning("serial_device_came_back", url=self.url)
                self._sdk = None
                await aside(partial(sdk.remove_connection, connection))
                connection = await self._open(sdk, port)

    async def _first_autopilot(self, sdk: Mavsdk) -> System:
        loop = asyncio.get_running_loop()
        found: asyncio.Future[System] = loop.create_future()

        def settle(system: System) -> None:
            if not found.done():
                found.set_result(system)

        handle = sdk.first_autopilot_async(-1.0, lambda system: self._hand_over(settle, system))
        try:
            return await found
        finally:
            sdk.cancel_first_autopilot(handle)

    # ---- in flight

    async def _keep(self, sdk: Mavsdk) -> None:
        loop = asyncio.get_running_loop()
        said = _Said()
        while True:
            self.session.poll(loop.time())
            self._flush_session()
            said.changes(self.session, self.status.value, sdk.system_count())
            await asyncio.sleep(_POLL_S)

    def _flush_session(self) -> None:
        wire = self._wire
        messages = self.session.take_outgoing()
        failed = [message[0] for message in messages if wire is None or not wire.send(message)]
        if failed:
            _log.warning("messages_not_sent", names=failed)

    def _callback(self, name: str) -> Callable[[MavlinkMessage, Any], None]:
        loop, receive_sample = self._loop, self.session.receive_sample
        assert loop is not None
        now = loop.time
        is_sample = name in SAMPLES

        def on_message(message: MavlinkMessage, _user_data: Any) -> None:
            arrival_s = now()
            self._threads.keep()
            if message.component_id != _AUTOPILOT_COMPONENT:
                return
            fields: Fields = pydantic_core.from_json(message.fields_json)
            if is_sample and receive_sample(name, fields, arrival_s):
                return
            if name == "PARAM_VALUE":
                _unpack_parameter(fields)
            self._hand_over(self._receive, name, fields, arrival_s)

        return on_message

    def _receive(self, name: str, fields: Fields, arrival_s: float) -> None:
        self.session.receive(name, fields, arrival_s)
        self._flush_session()

    def _hand_over(self, function: Callable[..., None], *args: Any) -> None:
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the loop is closed: this message came after the end
            self._loop.call_soon_threadsafe(function, *args)


class _Said:
    """What was last logged, so that only changes are."""

    def __init__(self) -> None:
        self._connected = False
        self._boot_count = 0
        self._systems = 1

    def changes(self, session: Px4Session, status: AutopilotStatus, systems: int) -> None:
        """Log what differs from the last time."""
        if status.connected != self._connected:
            self._connected = status.connected
            _log.info("link_up" if status.connected else "link_lost", mode=status.mode.value, armed=status.armed)
        if status.boot_count != self._boot_count:
            self._boot_count = status.boot_count
            _log.warning("autopilot_rebooted", boot_count=status.boot_count)
        if systems > self._systems:
            self._systems = systems
            _log.warning("another_system_ignored", systems=systems)
        for text in session.take_events():
            _log.info("autopilot_says", text=text)


def _unpack_parameter(fields: Fields) -> None:
    """Integers lie bytewise in the float of PARAM_VALUE; one that reads as NaN there is lost in JSON: None."""
    layout, value = _PARAM_TYPES_BYTEWISE.get(fields["param_type"]), fields["param_value"]
    if layout is not None and value is not None:
        fields["param_value"] = struct.unpack_from(layout, struct.pack("<f", value))[0]
