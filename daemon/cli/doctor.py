"""`flightd doctor`: checks an installation and says how to mend what is wrong."""

import asyncio
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import cast

import typer

from daemon.cli.common import JsonOption, SilentDaemonError, SocketOption, answered, connected, examples, say, say_json
from daemon.cli.daemon_commands import ConfigFiles
from daemon.cli.output import colours
from daemon.goals.client import FlightClient
from daemon.goals.client_errors import FlightError, RequestError
from daemon.goals.results import HealthTelemetry, SystemInfo

IMPORT_TIMEOUT_S = 30.0
ANSWER_TIMEOUT_S = 5.0
FIRST_YEAR = 2025
LATE_PERIOD_MS = 15.0


class Level(StrEnum):
    """How a check went."""

    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: what was looked at, what was found, and how to mend it."""

    level: Level
    name: str
    text: str
    mend: str = ""


def check_python() -> Finding:
    """The interpreter's version."""
    return Finding(Level.GOOD, "Python", f"{platform.python_version()} ({sys.executable})")


def check_mavsdk() -> Finding:
    """MAVSDK's library, loaded in a process of its own: a broken one would take this one along."""
    try:
        text = version("mavsdk")
    except PackageNotFoundError:
        return Finding(Level.BAD, "MAVSDK", "is not installed", "pip install flightd")
    command = [sys.executable, "-c", "import daemon.autopilot.mavsdk_link"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=IMPORT_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return Finding(
            Level.BAD, "MAVSDK", f"{text} does not load within {IMPORT_TIMEOUT_S:g} s", "look at the CPU load"
        )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return Finding(Level.BAD, "MAVSDK", f"{text} does not load: {last}", "pip install --force-reinstall mavsdk")
    return Finding(Level.GOOD, "MAVSDK", text)


@dataclass(frozen=True, slots=True)
class Asked:
    """What the running daemon answered; ``silence``: why it did not."""

    silence: FlightError | None = None
    info: SystemInfo | None = None
    connection: str | None = None
    health: HealthTelemetry | None = None
    period_ms: float = 0.0

    @property
    def connected(self) -> bool:
        """Tell whether it hears its autopilot."""
        return self.health is not None and self.health["autopilot"]["connected"]


def ask_daemon(socket: Path | None) -> Asked:
    """Ask the running daemon; each question has its time."""

    async def ask() -> Asked:
        async with AsyncExitStack() as stack:
            flight = await connected(stack, socket, 0.0)
            info = await answered(flight.info(), flight)
            connection = None
            with suppress(RequestError):
                connection = str((await answered(flight.get_config("link.connection"), flight))["value"])
            status = await answered(flight.status(), flight)
            health = await _health(flight)
            return Asked(None, info, connection, health, status["loops"]["control"]["period_p99_ms"])

    try:
        return asyncio.run(ask())
    except FlightError as error:
        return Asked(error)


async def _health(flight: FlightClient) -> HealthTelemetry | None:
    stream = flight.telemetry("health", rate_hz=5.0)
    try:
        return cast(HealthTelemetry, (await asyncio.wait_for(anext(stream), ANSWER_TIMEOUT_S)).data)
    except TimeoutError:
        return None


def check_connection(files: list[Path], asked: Asked) -> Finding:
    """The connection of the running daemon, else the configured one; for a serial one whether its port is good."""
    from daemon.config import ConfigError, load

    try:
        url = asked.connection or load(files).link.connection
    except ConfigError as error:
        return Finding(Level.BAD, "configuration", str(error), "flightd check-config names each mistake")
    whose = "of the running daemon" if asked.connection else f"of {', '.join(map(str, files)) or 'the defaults'}"
    if not url.startswith("serial"):
        return Finding(Level.GOOD, "connection", f"{url} ({whose}, not serial)")
    port = Path(url.split("://", 1)[-1].rsplit(":", 1)[0])
    shown = f"{port} ({whose})"
    if asked.connected:
        return Finding(Level.GOOD, "serial port", f"{shown}, the autopilot is heard")
    if not port.exists():
        return Finding(Level.BAD, "serial port", f"there is no {shown}", "check the cable, or set link.connection")
    if not _is_terminal(port.resolve()):
        return Finding(Level.BAD, "serial port", f"{shown} is no serial port", "set link.connection")
    if asked.silence is not None and not os.access(port, os.R_OK | os.W_OK):
        mend = f"sudo usermod -aG {port.group()} $USER, log in again; the service has rights of its own"
        return Finding(Level.BAD, "serial port", f"{shown} may not be opened by this user", mend)
    return Finding(Level.GOOD, "serial port", shown)


def _is_terminal(device: Path) -> bool:
    return (Path("/sys/class/tty") / device.name).exists() or device.parent == Path("/dev/pts")


def check_clock() -> Finding:
    """The clocks: a monotonic one that is fine enough, a wall clock that is set (for log stamps only)."""
    resolution_s = time.get_clock_info("monotonic").resolution
    if resolution_s > 1e-4:
        return Finding(
            Level.BAD, "clock", f"ticks every {1e3 * resolution_s:g} ms", "use a kernel with high-resolution timers"
        )
    if time.gmtime().tm_year < FIRST_YEAR:
        return Finding(
            Level.WARNING, "clock", "the wall clock is not set", "enable NTP: records will carry wrong dates"
        )
    return Finding(Level.GOOD, "clock", f"resolution {1e9 * resolution_s:g} ns")


def check_realtime(asked: Asked) -> Iterator[Finding]:
    """Rights to run before everything else and to keep the memory in place; a daemon that runs warns of its own."""
    if asked.info is not None:
        return
    priority, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    if os.geteuid() == 0 or priority != 0:
        yield Finding(Level.GOOD, "real-time rights", "granted to this user")
        return
    mend = "run the daemon as the service, which has its own, or raise rtprio and memlock in limits.conf"
    yield Finding(Level.WARNING, "real-time rights", "this user has none", mend)


def check_governor() -> Finding:
    """The processor's frequency governor: a sleepy one makes ticks late."""
    file = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    governor = file.read_text().strip() if file.exists() else "none"
    if governor in ("powersave", "ondemand", "conservative"):
        return Finding(Level.WARNING, "CPU governor", governor, "sudo cpupower frequency-set -g performance")
    return Finding(Level.GOOD, "CPU governor", governor)


def check_daemon(asked: Asked) -> Iterator[Finding]:
    """The running daemon: its socket, the autopilot, and what it warns of (streams, parameters)."""
    info, health = asked.info, asked.health
    if info is None:
        level = Level.BAD if isinstance(asked.silence, SilentDaemonError) else Level.WARNING
        mend = "without its answers autopilot and streams go unchecked"
        yield Finding(level, "daemon", str(asked.silence), mend)
        return
    yield Finding(Level.GOOD, "daemon", f"{info['name']} {info['version']}, protocol {info['protocol']}")
    if health is None:
        yield Finding(Level.BAD, "autopilot", "the daemon tells nothing of its health", "look at its log")
        return
    if not health["autopilot"]["connected"]:
        mend = "check cable, baud rate and MAV_*_CONFIG on the autopilot"
        if asked.connection is not None and not asked.connection.startswith("serial"):
            mend = f"see that the autopilot, or its simulation, runs and uses the port of {asked.connection}"
        yield Finding(Level.BAD, "autopilot", "is not connected", mend)
        return
    yield Finding(Level.GOOD, "autopilot", f"connected, {health['autopilot']['mode']}")
    for reason in health["reasons"][1:]:
        text = reason["text"].removeprefix(reason["code"]).lstrip()
        yield Finding(Level.WARNING, reason["code"], text)
    late = asked.period_ms > LATE_PERIOD_MS
    mend = "look at the CPU load; grant real-time rights" if late else ""
    yield Finding(Level.WARNING if late else Level.GOOD, "control loop", f"period p99 {asked.period_ms:.1f} ms", mend)


def doctor(config: ConfigFiles = None, as_json: JsonOption = False, socket: SocketOption = None) -> None:
    """Check this installation and the running daemon, and say how to mend what is wrong.

    The connection is the running daemon's; without a daemon it is that of --config.
    """
    asked = ask_daemon(socket)
    findings = [check_python(), check_mavsdk(), check_connection(config or [], asked), check_clock()]
    findings += [*check_realtime(asked), check_governor(), *check_daemon(asked)]
    if as_json:
        say_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            _say(finding)
    raise typer.Exit(int(any(finding.level is Level.BAD for finding in findings)))


COLORS = {Level.GOOD: typer.colors.GREEN, Level.WARNING: typer.colors.YELLOW, Level.BAD: typer.colors.RED}


def _say(finding: Finding) -> None:
    level = f"{finding.level:<8}"
    shown = typer.style(level, fg=COLORS[finding.level]) if colours(sys.stdout) else level
    say(f"{shown} {finding.name}: {finding.text}")
    if finding.mend:
        say(f"         {finding.mend}")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(
        short_help="Check this installation and the running daemon.",
        epilog=examples("flightd doctor", "flightd doctor --config x500", exits="0 nothing is bad, 1 something is bad"),
    )(doctor)
