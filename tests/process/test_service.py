"""The daemon as a service: one for a vehicle and a socket, what it tells systemd, its configuration file."""

import asyncio
import resource
import shutil
import signal
import socket
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from support.air import air, take
from support.processes import Child, daemon_on, free_udp_port, running, start, troubled_daemon

from daemon.goals.client import FlightClient
from daemon.messages import FlightMode

UNITS = Path(__file__).parents[2] / "systemd"
PATIENCE_S = 60.0


async def ends(tmp_path: Path, name: str, *args: str) -> tuple[int, str]:
    child = await start(tmp_path, name, *args)
    async with running(child):
        code = await asyncio.wait_for(child.process.wait(), PATIENCE_S)
    return code, child.log_file.read_text()


async def test_a_second_daemon_for_a_socket_or_a_vehicle_refuses_with_the_pid_of_the_first(tmp_path: Path) -> None:
    connection, other = (f"udpin://127.0.0.1:{free_udp_port()}" for _ in range(2))
    async with daemon_on(tmp_path, connection) as first:
        pid = str(first.process.pid)
        code, said = await ends(tmp_path, "b", "run", "--connection", other, "--socket", str(first.socket))
        assert (code, pid in said, "already listens" in said) == (3, True, True), said
        again = f"udpin://0.0.0.0:{connection.rpartition(':')[2]}"
        code, said = await ends(tmp_path, "c", "run", "--connection", again, "--socket", str(tmp_path / "c.sock"))
        assert (code, pid in said, "already flies" in said) == (3, True, True), said
        assert first.socket is not None
        async with FlightClient(first.socket) as flight:
            assert (await flight.info())["name"] == "flightd"


class Systemd:
    """The far end of sd_notify: a datagram socket."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.status: str | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)

    async def next(self, limit_s: float = PATIENCE_S) -> str:
        """The next message but for the status, which is kept."""
        loop = asyncio.get_running_loop()
        while (text := (await asyncio.wait_for(loop.sock_recv(self._socket, 4096), limit_s)).decode())[:7] == "STATUS=":
            self.status = text[7:]
        return text

    def drain(self) -> int:
        count = 0
        while True:
            try:
                self._socket.recv(4096)
            except BlockingIOError:
                return count
            count += 1


def is_stopped(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().split()[2] == "T"


@asynccontextmanager
async def notifying(tmp_path: Path) -> AsyncIterator[tuple[Child, Systemd]]:
    """A daemon that has told systemd that it is ready."""
    systemd = Systemd(tmp_path / "notify")
    connection = f"udpin://127.0.0.1:{free_udp_port()}"
    arguments = ("run", "--connection", connection, "--socket", str(tmp_path / "f.sock"))
    child = await start(tmp_path, "flightd", *arguments, environ={"NOTIFY_SOCKET": str(systemd.path)})
    async with running(child):
        child.socket = tmp_path / "f.sock"
        assert "READY=1" in await systemd.next()
        yield child, systemd


async def test_systemd_hears_ready_once_the_socket_listens_then_the_watchdog_then_stopping(tmp_path: Path) -> None:
    async with notifying(tmp_path) as (child, systemd):
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(child.socket))
        for _ in range(3):
            assert await systemd.next() == "WATCHDOG=1"
        assert systemd.status == "disconnected: no autopilot has been heard since the daemon started"
        child.process.send_signal(signal.SIGSTOP)
        while not is_stopped(child.process.pid):  # noqa: ASYNC110 - the kernel tells by asking only
            await asyncio.sleep(0.01)
        systemd.drain()
        with pytest.raises(TimeoutError):
            await systemd.next(1.5)
        child.process.send_signal(signal.SIGCONT)
        child.process.send_signal(signal.SIGTERM)
        heard = [await systemd.next()]
        while heard[-1] != "STOPPING=1":
            heard.append(await systemd.next())
        assert set(heard) <= {"WATCHDOG=1", "STOPPING=1"}
        assert await asyncio.wait_for(child.process.wait(), PATIENCE_S) == 0
    with pytest.raises(TimeoutError):
        await systemd.next(0.3)


async def test_the_watchdog_is_fed_by_a_daemon_that_may_open_nothing_more(tmp_path: Path) -> None:
    async with notifying(tmp_path) as (child, systemd):
        while "waiting_for_autopilot" not in [event["event"] for event in child.events()]:
            assert await systemd.next() == "WATCHDOG=1"
        resource.prlimit(child.process.pid, resource.RLIMIT_NOFILE, (3, 3))
        systemd.drain()
        for _ in range(5):
            assert await systemd.next() == "WATCHDOG=1"


async def test_a_fault_while_it_stops_shows_in_the_exit_code(tmp_path: Path) -> None:
    async with air() as seen, troubled_daemon(tmp_path, seen.connection, "dies_while_stopping") as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            await take(flight, seen)
            child.process.send_signal(signal.SIGUSR1)
            await flight.info()
            child.process.send_signal(signal.SIGTERM)
            assert await asyncio.wait_for(child.process.wait(), PATIENCE_S) == 1
        assert seen.px4.mode is FlightMode.HOLD
    assert [event["level"] for event in child.events() if event["event"] == "failed"] == ["error"]


async def test_a_configuration_file_replaced_while_the_daemon_runs_changes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text("guidance: {limits: {speed_m_s: 2.0}}\n")
    connection = f"udpin://127.0.0.1:{free_udp_port()}"
    async with daemon_on(tmp_path, connection, "--config", str(file)) as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            before = (await flight.info())["config_hash"]
            file.write_text("guidance: {limits: {speed_m_s: 20.0}}\n")
            file.write_text("no: such\n")
            assert (await flight.get_config("guidance.limits.speed_m_s"))["value"] == 2.0
            assert (await flight.info())["config_hash"] == before


async def test_rights_that_are_configured_and_refused_are_told_in_the_status(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text("loops: {cpu_affinity: [1023]}\n")
    async with daemon_on(tmp_path, f"udpin://127.0.0.1:{free_udp_port()}", "--config", str(file)) as child:
        assert child.socket is not None
        async with FlightClient(child.socket) as flight:
            told = {reason["code"]: reason["text"] for reason in (await flight.status())["reasons"]}
    assert told["cpu_affinity_refused"] == "loops.cpu_affinity 1023 was refused: Invalid argument"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_accepts_the_units(tmp_path: Path) -> None:
    for unit in [*UNITS.glob("*.service"), *UNITS.glob("*.socket")]:
        text = unit.read_text().replace("/opt/flightd/bin/flightd", "/bin/true")
        (tmp_path / unit.name).write_text(text)
    names = sorted(str(path) for path in tmp_path.iterdir() if not path.stem.endswith("@"))
    for template in tmp_path.glob("*@.*"):
        instance = tmp_path / template.name.replace("@", "@one")
        shutil.copy(template, instance)
        names.append(str(instance))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *names], capture_output=True, text=True, check=False
    )
    ours = [line for line in done.stderr.splitlines() if "flightd" in line]
    assert (done.returncode, ours) == (0, []), done.stderr


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("name", ["flightd.service", "flightd@.service"])
def test_the_service_is_exposed_by_two_of_ten_at_most(name: str, tmp_path: Path) -> None:
    path = shutil.copy(UNITS / name, tmp_path / name.replace("@", "@one"))
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-400:]
