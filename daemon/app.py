"""The composition root: what ``flightd run`` starts, in the order in which it starts, and stops."""

import asyncio
import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon import logs
from daemon.autopilot.mavsdk_link import MavsdkLink
from daemon.config import ConfigError, load
from daemon.endpoint import EndpointInUseError, claim
from daemon.flight_service import Service
from daemon.goals.hub import Hub
from daemon.goals.server import GoalServer
from daemon.goals.slack import Slack
from daemon.goals.sockets import Listener, Operators, SocketInUseError, activated, listen, server_path
from daemon.journal import Journal
from daemon.log_thread import stderr_beside
from daemon.loops.grid import live_alarm
from daemon.loops.phase_lock import PhaseLock
from daemon.loops.vehicle import Vehicle
from daemon.notify import notify
from daemon.parameters import dead_man_timing
from daemon.realtime import apply as apply_realtime
from daemon.realtime import preload
from daemon.reports import Reports
from daemon.safety.dead_man import DeadMan
from daemon.settings import Config
from daemon.telemetry import Telemetry

if TYPE_CHECKING:
    from daemon.recording.recorder import Recorder

EXIT_OK = 0
EXIT_CONFIG = 2
EXIT_IN_USE = 3
EXIT_FAILED = 1

log = logs.get("app")


def run(
    config_files: list[Path],
    connection: str | None,
    socket: Path | None,
    watch: Callable[[Vehicle], None] = lambda _vehicle: None,
    **overrides: Any,
) -> int:
    """Run the daemon until it is told to stop; returns the exit code (2: the configuration is bad).

    ``watch`` is shown the vehicle before its tasks start (benchmarks).
    """
    if connection is not None:
        overrides = {**overrides, "link": {**overrides.get("link", {}), "connection": connection}}
    try:
        config = load(config_files, overrides)
    except ConfigError as error:
        return _complain(error)
    with stderr_beside(lambda lost: logs.get("log").warning("log_lines_lost", lost=lost)):
        logs.configure(config.log.level)
        return asyncio.run(_main(config, socket, watch))


def _complain(error: ConfigError) -> int:
    logs.configure("error")
    for fault in error.faults:
        logs.get("config").error("configuration_refused", fault=fault)
    return EXIT_CONFIG


async def _main(config: Config, socket: Path | None, watch: Callable[[Vehicle], None]) -> int:
    loop = asyncio.get_running_loop()
    stop = _Stop(loop)
    try:
        listener = activated(os.environ) or await listen(server_path(socket, os.environ))
    except (SocketInUseError, OSError) as error:
        log.error("socket_unavailable", reason=str(error))
        return EXIT_IN_USE
    try:
        claimed = claim(config.link.connection)
    except EndpointInUseError as error:
        log.error("vehicle_unavailable", reason=str(error))
        listener.close()
        return EXIT_IN_USE
    refused = apply_realtime(config.loops)
    loop.set_default_executor(ThreadPoolExecutor(1, "beside"))
    await loop.run_in_executor(None, preload)  # its thread starts here: the loop would wait for that in flight
    link = MavsdkLink(config.link.connection, link_timeout_s=config.link.lost_s)
    vehicle = Vehicle(config, link, lambda: live_alarm(loop))
    vehicle.control.listeners.append(PhaseLock(vehicle.control.grid, vehicle.autopilot.odometry).on_tick)
    vehicle.health.warnings.update(refused)
    watch(vehicle)
    dead_man = DeadMan(vehicle.gate, dead_man_timing(config), lambda event: log.error(event))
    log.info("started", connection=config.link.connection, config_hash=config.hash(), pid=os.getpid())
    try:
        return await _fly(config, vehicle, dead_man, listener, stop)
    finally:
        claimed.close()
        listener.close()


async def _fly(config: Config, vehicle: Vehicle, dead_man: DeadMan, listener: Listener, stop: "_Stop") -> int:
    hub = Hub(slack=Slack(lambda: vehicle.control.grid.due_s, vehicle.control.grid.period_s))
    recorder = _recorder(config)
    journal = Journal(hub, recorder)
    reports = Reports(vehicle)
    service = Service(vehicle, reports, hub, journal)
    Telemetry(vehicle, reports, hub, journal)
    if recorder is not None:
        logs.flight.source = lambda: recorder.report.flight
        recorder.start()
        vehicle.health.asked["recording"] = lambda: recorder.warning
        control = vehicle.control
        control.watchers.add("recorder", lambda inputs, record: recorder.tick(control.state, inputs, record))
    operators = Operators(uids=frozenset(config.goals.operator_uids), gids=frozenset(config.goals.operator_gids))
    server = GoalServer(service, hub, operators, vehicle.gate.check_gap)
    vehicle.forgetters.append(server.stood_still)
    tasks = asyncio.ensure_future(vehicle.run())
    dead_man.start()
    await server.start(listener)
    vehicle.garbage.start()
    vehicle.control.watchers.add("garbage", vehicle.garbage.on_tick)
    notify("READY=1")
    try:
        await asyncio.wait({tasks, stop.asked}, return_when=asyncio.FIRST_COMPLETED)
        notify("STOPPING=1")
        if not tasks.done():
            await vehicle.release()  # no hurry cuts this: the vehicle would be left on its last rates
    finally:
        log.info("stopping", state=vehicle.commander.state.value)
        await _first_of(server.stop(), stop.asked_again)
        dead_man.stop()
        tasks.cancel()
        (fault,) = await asyncio.gather(tasks, return_exceptions=True)
        failed = not isinstance(fault, asyncio.CancelledError)
        if failed:
            log.error("failed", exc_info=fault)
        if recorder is not None:
            recorder.close()
        vehicle.garbage.stop()
        log.info("stopped")
    return EXIT_FAILED if failed else EXIT_OK


def _recorder(config: Config) -> "Recorder | None":
    settings = config.recording
    if not (settings.enabled or settings.live):
        return None
    from daemon.recording.recorder import Recorder, RecordingSettings

    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    folder = settings.directory or os.environ.get("STATE_DIRECTORY", "").split(":")[0] or Path(home) / "flightd"
    return Recorder(
        RecordingSettings(
            directory=Path(folder),
            when=settings.when,
            before_s=settings.before_s,
            after_s=settings.after_s,
            max_file_mb=settings.max_file_mb,
            keep_mb=settings.keep_mb,
            path_poses=settings.path_poses,
            period_s=1.0 / config.loops.control_rate_hz,
            enabled=settings.enabled,
            live_port=settings.live_port if settings.live else None,
        ),
        about={"version": version("flightd"), "config_hash": config.hash(), "config": config.model_dump(mode="json")},
        clock=asyncio.get_running_loop().time,
    )


async def _first_of(work: Any, asked_again: "asyncio.Future[None]") -> None:
    """Do the work, unless somebody is in a hurry."""
    task = asyncio.ensure_future(work)
    await asyncio.wait({task, asked_again}, return_when=asyncio.FIRST_COMPLETED)
    if not task.done():
        task.cancel()
    await asyncio.gather(task, return_exceptions=True)


class _Stop:
    """SIGTERM, Ctrl-C and the end of the terminal: the first asks to stop, the second to hurry.

    Both may come at once: a wrapper forwards what the terminal has sent already.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.asked: asyncio.Future[None] = loop.create_future()
        self.asked_again: asyncio.Future[None] = loop.create_future()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_IGN:  # nohup
                continue
            loop.add_signal_handler(number, self._on_signal, number)

    def _on_signal(self, number: signal.Signals) -> None:
        log.info("signal", name=signal.Signals(number).name)
        for future in (self.asked, self.asked_again):
            if not future.done():
                future.set_result(None)
                return
