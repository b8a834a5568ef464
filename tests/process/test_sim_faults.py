"""`flightd sim` as a person starts it: faults from a file, from the command line and at run time; its summary."""

import asyncio
import contextlib
import json
import re
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from support.processes import START_S, STOP_S, Child, free_udp_port, running, start

from daemon.sim.mavlink_codec import MavlinkCodec

FLIGHTD = (sys.executable, "-m", "daemon.cli.main")
SCENARIO = "- {at_s: 0, fault: payload, mass_kg: 0.3}\n- {at_s: 3600, fault: reboot}\n"


async def command(*arguments: str) -> tuple[int, str, str]:
    process = await asyncio.create_subprocess_exec(
        *FLIGHTD, *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    try:
        out, err = await asyncio.wait_for(process.communicate(), START_S)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


@contextlib.asynccontextmanager
async def simulator(tmp_path: Path, port: int, *arguments: str) -> AsyncIterator[tuple[Child, Path]]:
    control = tmp_path / "sim.sock"
    child = await start(tmp_path, "sim", "sim", "--port", str(port), "--control", str(control), *arguments)
    async with running(child):
        async with asyncio.timeout(START_S):
            while not control.exists():  # the file system tells nobody
                assert child.process.returncode is None, child.log_file.read_text()
                await asyncio.sleep(0.02)
        yield child, control


async def fault(control: Path, *words: str) -> dict[str, Any]:
    code, out, err = await command("sim", "fault", *words, "--control", str(control))
    assert code == 0, err
    answer: dict[str, Any] = json.loads(out)
    return answer


def hears(listener: socket.socket, within_s: float) -> set[str]:
    """Names of the messages of one datagram; empty when none comes."""
    listener.settimeout(within_s)
    with contextlib.suppress(TimeoutError):
        return {name for name, *_ in MavlinkCodec(255).decode(listener.recv(65536))}
    return set()


async def test_a_running_simulator_has_the_faults_of_its_start_and_takes_more(tmp_path: Path) -> None:
    scenario = tmp_path / "bad_day.yaml"
    scenario.write_text(SCENARIO)
    arguments = ("--vehicles", "2", "--scenario", str(scenario), "--fault", "wind north_m_s=4 vehicle=2")
    async with simulator(tmp_path, free_udp_port(), *arguments) as (child, control):
        listed = await fault(control, "list")
        assert listed["active"] == {"1": ["payload"], "2": ["payload", "wind"]}
        assert "duration_s" in listed["known"]["gps_loss"]
        assert await fault(control, "gps_loss", "duration_s=600", "--vehicle", "1") == {
            "active": {"1": ["payload", "gps_loss"]}
        }
        assert await fault(control, "clear", "fault=payload") == {"active": {"1": ["gps_loss"], "2": ["wind"]}}
        assert await fault(control, "clear") == {"active": {"1": [], "2": []}}
        code, _, err = await command("sim", "fault", "link", "loss=2", "--control", str(control))
        assert (code, err) == (2, "link.loss: 2 is not in 0 to 1\n")
        assert await child.stop() == 0
    assert re.search(r"\d+ steps of 4 ms; \d+ late .*, \d+ lost", child.log_file.read_text())


async def test_a_fault_at_run_time_is_felt_on_the_wire(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        async with simulator(tmp_path, listener.getsockname()[1]) as (_, control):
            assert await asyncio.to_thread(hears, listener, STOP_S)
            await fault(control, "link", "direction=down", "silent=true")
            listener.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while listener.recv(65536):
                    pass
            assert await asyncio.to_thread(hears, listener, 1.0) == set()
            await fault(control, "clear")
            assert await asyncio.to_thread(hears, listener, STOP_S)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--fault", "gps_loss duration_s=long"), "--fault 'gps_loss duration_s=long': gps_loss.duration_s: 'long' is"),
        (("--fault", "payload vehicle=2"), "vehicle: 2; there is only 1 (--vehicles)"),
        (("--scenario", "nowhere.yaml"), "scenario nowhere.yaml: No such file"),
        (("--airframe", "boeing"), "known: sih, x500"),
        (("--port", "65535", "--vehicles", "2"), "need ports up to 65536"),
    ],
)
async def test_a_start_with_something_wrong_is_refused_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    code, _, err = await command("sim", *arguments)
    assert code == 2
    assert words in err
    assert err.count("\n") == 1


async def test_without_a_simulator_the_advice_is_to_start_one(tmp_path: Path) -> None:
    code, _, err = await command("sim", "fault", "list", "--control", str(tmp_path / "none.sock"))
    assert code == 5
    assert "start one with `flightd sim`" in err
