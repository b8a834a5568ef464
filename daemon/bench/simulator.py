"""What the simulator costs: a minute of the daemon in virtual time, and a fleet over UDP in real time."""

import asyncio
import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

from daemon.config import load
from daemon.flight_service import Service
from daemon.goals.hub import Hub
from daemon.goals.methods import GoalSubmit
from daemon.goals.service import Caller
from daemon.journal import Journal
from daemon.loops.grid import LoopAlarm
from daemon.loops.vehicle import Vehicle
from daemon.reports import Reports
from daemon.safety.supervisor import State
from daemon.sim.airframe_files import load as load_airframe
from daemon.sim.in_process import STEP_S, InProcessAutopilot
from daemon.sim.mavlink_codec import MavlinkCodec
from daemon.sim.px4 import SimulatedPx4
from daemon.sim.virtual_time import run_virtual

_CORNERS = ((8.0, 0.0, -5.0), (8.0, 8.0, -7.0), (0.0, 8.0, -6.0), (0.0, 0.0, -5.0))
_LEG_S = 4.0
_CALLER = Caller(connection=1, pid=os.getpid(), uid=os.getuid(), operator=True)
_HOST = "127.0.0.1"
_STREAMS = {331: 10_000.0, 105: 20_000.0}  # ODOMETRY and HIGHRES_IMU as the daemon asks for them, in microseconds
_START_S = 30.0


@dataclass(frozen=True, slots=True)
class VirtualMinute:
    """CPU seconds of one core for a minute: of the whole flight, and of its vehicle alone with the same messages."""

    flight_s: float
    vehicle_s: float


@dataclass(frozen=True, slots=True)
class Fleet:
    """``summary`` is what `flightd sim` said at its end; ``silent_s``: the longest that any vehicle was not heard."""

    vehicles: int
    seconds: float
    summary: str
    cpu_percent: float
    datagrams: int
    silent_s: float


def virtual_minute(seconds: float, *, seed: int = 1) -> VirtualMinute:
    """Fly from waypoint to waypoint with noise; the least of three flights, because other work makes times longer."""
    flights = [run_virtual(_flight(seconds, seed)) for _ in range(3)]
    return VirtualMinute(min(flights) * 60.0 / seconds, _vehicle_alone(seconds, seed) * 60.0 / seconds)


async def _flight(seconds: float, seed: int) -> float:
    loop = asyncio.get_running_loop()
    autopilot = InProcessAutopilot(SimulatedPx4(airframe=load_airframe("sih"), seed=seed))
    vehicle = Vehicle(load([]), autopilot, lambda: LoopAlarm(loop), loop.time)
    hub = Hub()
    service = Service(vehicle, Reports(vehicle), hub, Journal(hub, None))
    running = asyncio.ensure_future(vehicle.run())
    commander = vehicle.commander
    await commander.wait_for(lambda: commander.state is State.STANDBY, _START_S, "connected")
    await commander.wait_for(lambda: autopilot.status.value.global_position is not None, _START_S, "located")
    await asyncio.sleep(1.0)
    await commander.takeoff(5.0)
    await commander.engage()
    before_s, until_s = time.process_time(), loop.time() + seconds
    for corner in cycle(_CORNERS):
        goal = GoalSubmit.model_validate({"waypoint": {"position": list(corner)}})
        await service.goal_submit(goal, _CALLER, hub.new_goal(_Nobody()))
        await asyncio.sleep(min(_LEG_S, until_s - loop.time()))
        if loop.time() >= until_s:
            break
    spent_s = time.process_time() - before_s
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    return spent_s


class _Nobody:
    def send(self, line: bytes, *, essential: bool) -> None:
        pass


def _vehicle_alone(seconds: float, seed: int) -> float:
    """CPU seconds of the simulated PX4 itself, in Offboard with the daemon's streams and 100 Hz of setpoints."""
    px4 = SimulatedPx4(airframe=load_airframe("sih"), seed=seed)
    px4.start_in_air(5.0)
    for name, fields in _requests():
        px4.receive(name, fields)
    rates = dict.fromkeys(("body_roll_rate", "body_pitch_rate", "body_yaw_rate"), 0.0)
    setpoint = {"target_system": 1, "type_mask": 128, "q": [0.0] * 4, "thrust": 0.4905, **rates}
    before_s = time.process_time()
    for step in range(round(seconds / STEP_S)):
        if step % 3 == 0:
            px4.receive("SET_ATTITUDE_TARGET", setpoint)
        if step == 30:
            px4.receive("COMMAND_LONG", {"target_system": 1, "command": 176, "param1": 1.0, "param2": 6.0})
        px4.step()
        px4.take_outgoing()
    return time.process_time() - before_s


def _requests() -> list[tuple[str, dict[str, object]]]:
    return [
        ("COMMAND_LONG", {"target_system": 0, "command": 511, "param1": float(number), "param2": interval_us})
        for number, interval_us in _STREAMS.items()
    ]


class _Listener(threading.Thread):
    """Hears the fleet, asks each vehicle once for the streams of a daemon, and counts."""

    def __init__(self, vehicles: int) -> None:
        super().__init__(daemon=True)
        self.sockets = _neighbours(vehicles)
        self.datagrams = 0
        self.silent_s = 0.0
        self.heard_s: dict[socket.socket, float] = {}
        self._ends = threading.Event()

    def run(self) -> None:
        codec = MavlinkCodec(1, 195)
        while not self._ends.is_set():
            for sock in select.select(self.sockets, [], [], 0.1)[0]:
                _, vehicle = sock.recvfrom(65536)
                now_s = time.monotonic()
                if sock not in self.heard_s:
                    for name, fields in _requests():
                        sock.sendto(codec.encode(name, fields), vehicle)
                self.silent_s = max(self.silent_s, now_s - self.heard_s.get(sock, now_s))
                self.heard_s[sock] = now_s
                self.datagrams += 1

    def stop(self) -> None:
        """End it."""
        self._ends.set()
        self.join()
        for sock in self.sockets:
            sock.close()


def _neighbours(count: int) -> list[socket.socket]:
    """Bound sockets on neighbouring free ports of loopback."""
    for first in range(42000, 60000, 13):
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            socks = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
            for index, sock in enumerate(socks):
                sock.bind((_HOST, first + index))
            stack.pop_all()
            return socks
    raise OSError(f"no {count} neighbouring UDP ports are free")


def fleet(vehicles: int, seconds: float) -> Fleet:
    """`flightd sim --vehicles N` in a process of its own. Raises RuntimeError when it ends by itself."""
    listener = _Listener(vehicles)
    port = listener.sockets[0].getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="flightd-") as folder:
        control = ("--control", str(Path(folder) / "sim.sock"))
        command = [sys.executable, "-m", "daemon.cli.main", "sim", "--vehicles", str(vehicles), "--port", str(port)]
        process = subprocess.Popen([*command, *control], stdout=subprocess.PIPE, text=True)
        try:
            listener.start()
            begun_s = time.monotonic()
            while len(listener.heard_s) < vehicles:
                if process.poll() is not None or time.monotonic() - begun_s > _START_S:
                    raise RuntimeError("the simulator does not start")
                time.sleep(0.05)
            cpu_s, begun_s = _cpu_s(process.pid), time.monotonic()
            time.sleep(seconds)
            spent_s, flown_s = _cpu_s(process.pid) - cpu_s, time.monotonic() - begun_s
        finally:
            process.send_signal(signal.SIGTERM)
            output, _ = process.communicate()
            listener.stop()
    summary = output.strip().splitlines()[-1]
    return Fleet(vehicles, flown_s, summary, 100.0 * spent_s / flown_s, listener.datagrams, listener.silent_s)


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def lines(minute: VirtualMinute, flown: Fleet) -> list[str]:
    """The figures in words."""
    return [
        f"a minute of flight in virtual time: {minute.flight_s:.2f} s of one core",
        f"  the vehicle alone: {minute.vehicle_s:.2f} s",
        f"{flown.vehicles} vehicles over UDP, {flown.seconds:.0f} s in real time: {flown.cpu_percent:.0f} % of a core",
        f"  {flown.summary}",
        f"  {flown.datagrams} datagrams heard; longest silence of a vehicle {flown.silent_s * 1e3:.0f} ms",
    ]
