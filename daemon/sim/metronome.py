"""A light autopilot for benchmarks: it keeps time and notes what arrives when, and simulates nothing.

It says that it hovers in Hold, acknowledges every command, takes the modes that it is asked for, and sends in bursts on
a grid, as PX4 does: whatever is due at a time leaves within some tens of microseconds, HIGHRES_IMU, ODOMETRY, then the
rest (recorded). Packets are encoded once; stamp, number and checksum are written into them. Setpoints are stamped by
the kernel, so that its own waking up does not count. Each ODOMETRY has its number in ``x``, in micrometres.
"""

import gc
import json
import os
import select
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from daemon.messages import FlightMode
from daemon.sim.mavlink_codec import MavlinkCodec
from daemon.sim.modes import base_mode, custom_mode, from_numbers

NUMBERS = 4096  # ODOMETRY is counted modulo this
NUMBER_M = 1e-6  # what x grows by with each
_HOST = "127.0.0.1"
_PRIORITY = 50  # an autopilot has a processor of its own
_HEADER_BYTES = 10
_CHECKSUM_BYTES = 2
_STAMP_AT = _HEADER_BYTES
_NUMBER_AT = _HEADER_BYTES + 8  # of ODOMETRY, whose first float is x
_SO_TIMESTAMPNS = 35
_SET_ATTITUDE_TARGET, _COMMAND_INT, _COMMAND_LONG = 82, 75, 76
_DO_SET_MODE, _REQUEST_MESSAGE = 176, 512
_CRC_EXTRA = {"ODOMETRY": 91, "HIGHRES_IMU": 93}
_UNEVEN_GAPS = (0.008, 0.016)  # PX4 at 100 Hz, on its 4 ms grid


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (0x8408 if value & 1 else 0)
        table.append(value)
    return tuple(table)


_TABLE = _crc_table()


def checksum(data: bytes) -> int:
    """MAVLink's CRC-16/MCRF4XX."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


class Template:
    """An encoded packet whose stamp (and number) are written in."""

    def __init__(self, packet: bytes, crc_extra: int) -> None:
        self._packet = bytearray(packet)
        self._extra = bytes((crc_extra,))

    def stamped(self, stamp_us: int, number: int | None = None) -> bytes:
        """The packet with this ``time_usec`` and, in the float after it, this number."""
        packet = self._packet
        struct.pack_into("<Q", packet, _STAMP_AT, stamp_us)
        if number is not None:
            struct.pack_into("<f", packet, _NUMBER_AT, number * NUMBER_M)
        body = bytes(packet[1:-_CHECKSUM_BYTES])
        struct.pack_into("<H", packet, len(packet) - _CHECKSUM_BYTES, checksum(body + self._extra))
        return bytes(packet)


@dataclass(slots=True)
class Log:
    """Seconds of CLOCK_MONOTONIC: each ODOMETRY's number and when it was sent; each setpoint's arrival and thrust."""

    odometry: list[tuple[int, float]] = field(default_factory=list)
    setpoints: list[tuple[float, float]] = field(default_factory=list)


class Metronome:
    """One UDP socket that talks to a port of loopback. ``uneven``: ODOMETRY comes in gaps of 8 and 16 ms in turn."""

    def __init__(self, port: int, rate_hz: float = 100.0, *, uneven: bool = False) -> None:
        self.log = Log()
        self._to = (_HOST, port)
        self._codec = MavlinkCodec(1)
        self._mode = FlightMode.HOLD
        self._number = 0
        self._start_s = time.monotonic()
        self._gaps = _UNEVEN_GAPS if uneven else (1.0 / rate_hz,)
        self._realtime_offset_s = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, 0))
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._odometry = Template(self._codec.encode("ODOMETRY", _odometry()), _CRC_EXTRA["ODOMETRY"])
        self._imu = Template(self._codec.encode("HIGHRES_IMU", _imu()), _CRC_EXTRA["HIGHRES_IMU"])
        self._streams: tuple[tuple[int, Callable[[], None]], ...] = (
            (2, self._send_imu),
            (1, self._send_odometry),
            (max(1, round(rate_hz / 2.0)), self._send_mode),
            (max(1, round(rate_hz / 5.0)), self._send_rest),
        )  # in every so many bursts
        self._running = True

    def stop(self) -> None:
        """End ``run``."""
        self._running = False

    def run(self) -> None:
        """Keep time until stopped."""
        due_s, burst = time.monotonic() + 0.1, 0
        while self._running:
            if self._wait(due_s - time.monotonic()):
                continue
            for every, send in self._streams:
                if burst % every == 0:
                    send()
            due_s += self._gaps[burst % len(self._gaps)]
            burst += 1

    def _wait(self, for_s: float) -> bool:
        """Take what arrives; True when something did, so that time has to be looked at again."""
        if not select.select([self._socket], [], [], max(0.0, for_s))[0]:
            return False
        data, ancillary, _, _ = self._socket.recvmsg(2048, 256)
        arrival_s = time.monotonic()
        for level, kind, value in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = struct.unpack("qq", value[:16])
                arrival_s = seconds + nanoseconds * 1e-9 - self._realtime_offset_s
        self._take(data, arrival_s)
        return True

    def _take(self, data: bytes, arrival_s: float) -> None:
        while len(data) > _HEADER_BYTES and data[0] == 0xFD:
            length, message_id = data[1], data[7] | data[8] << 8 | data[9] << 16
            payload = data[_HEADER_BYTES : _HEADER_BYTES + length]
            if message_id == _SET_ATTITUDE_TARGET:
                thrust = struct.unpack_from("<f", payload.ljust(39, b"\0"), 32)[0]
                self.log.setpoints.append((arrival_s, thrust))
            elif message_id in (_COMMAND_LONG, _COMMAND_INT):
                self._obey(payload.ljust(35, b"\0"), data[5], data[6])
            data = data[_HEADER_BYTES + length + _CHECKSUM_BYTES + (13 if data[2] & 1 else 0) :]

    def _obey(self, payload: bytes, system: int, component: int) -> None:
        command = struct.unpack_from("<H", payload, 28)[0]
        ack = {"command": command, "result": 0, "target_system": system, "target_component": component}
        self._say("COMMAND_ACK", ack)
        _, main, sub = struct.unpack_from("<3f", payload)
        if command == _DO_SET_MODE:
            mode = from_numbers(int(main), int(sub))
            self._mode = mode or self._mode
            self._say("COMMAND_ACK", ack)
            self._send_mode()
        elif command == _REQUEST_MESSAGE:
            self._send_rest()

    def _say(self, name: str, fields: dict[str, object]) -> None:
        self._socket.sendto(self._codec.encode(name, fields), self._to)

    def _stamp_us(self) -> int:
        return int((time.monotonic() - self._start_s) * 1e6) + 10_000_000

    def _send_odometry(self) -> None:
        self._number = (self._number + 1) % NUMBERS
        packet = self._odometry.stamped(self._stamp_us(), self._number)
        sent_s = time.monotonic()
        self._socket.sendto(packet, self._to)
        self.log.odometry.append((self._number, sent_s))

    def _send_imu(self) -> None:
        self._socket.sendto(self._imu.stamped(self._stamp_us()), self._to)

    def _send_mode(self) -> None:
        custom = custom_mode(self._mode)
        heartbeat = {"type": 2, "autopilot": 12, "base_mode": base_mode(self._mode, True), "custom_mode": custom}
        self._say("HEARTBEAT", {**heartbeat, "system_status": 4, "mavlink_version": 3})
        self._say("CURRENT_MODE", {"standard_mode": 0, "custom_mode": custom, "intended_custom_mode": custom})

    def _send_rest(self) -> None:
        stamp_us = self._stamp_us()
        place = {"lat": 473977418, "lon": 85455938, "alt": 500000}
        self._say("EXTENDED_SYS_STATE", {"landed_state": 2})
        self._say("SYS_STATUS", {"voltage_battery": 16000, "battery_remaining": 90})
        self._say("GLOBAL_POSITION_INT", {"time_boot_ms": stamp_us // 1000, **place, "relative_alt": 10000})
        self._say("GPS_GLOBAL_ORIGIN", {"latitude": 473977418, "longitude": 85455938, "altitude": 490000})


def _odometry() -> dict[str, object]:
    pose, velocity = [0.0] * 21, [0.0] * 21
    pose[0] = pose[6] = pose[11] = 0.04
    velocity[0] = velocity[6] = velocity[11] = 0.01
    return {
        "frame_id": 1,
        "child_frame_id": 1,
        "z": -10.0,
        "q": [1.0, 0.0, 0.0, 0.0],
        "rollspeed": 1e-4,
        "pose_covariance": pose,
        "velocity_covariance": velocity,
        "reset_counter": 1,
        "estimator_type": 8,
        "quality": 100,
    }


def _imu() -> dict[str, object]:
    return {"zacc": -9.80665, "xgyro": 1e-4, "xmag": 0.2, "zmag": 0.4, "fields_updated": 6719, "id": 1}


def main() -> None:
    """``python -m daemon.sim.metronome PORT RATE_HZ UNEVEN``: run until SIGTERM, then print the log as JSON."""
    port, rate_hz, uneven = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == "1"
    metronome = Metronome(port, rate_hz, uneven=uneven)
    signal.signal(signal.SIGTERM, lambda *_: metronome.stop())
    with suppress(OSError):  # where it is not permitted, it keeps time as well as the machine lets it
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    gc.disable()  # the log only grows; going through it would disturb the grid
    metronome.run()
    json.dump({"odometry": metronome.log.odometry, "setpoints": metronome.log.setpoints}, sys.stdout)


if __name__ == "__main__":
    main()
