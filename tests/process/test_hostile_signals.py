"""The end of the terminal stops the daemon as SIGTERM does; under nohup it goes on."""

import asyncio
import signal
from pathlib import Path

import pytest
from support.processes import FLIGHTD, Child, answers, free_udp_port, running


@pytest.mark.parametrize("under_nohup", [False, True])
async def test_a_terminal_that_goes_away_stops_the_daemon_in_order_unless_it_was_told_not_to(
    tmp_path: Path, under_nohup: bool
) -> None:
    before = ("nohup",) if under_nohup else ()
    path, log_file = tmp_path / "f.sock", tmp_path / "log"
    where = ("run", "--connection", f"udpin://127.0.0.1:{free_udp_port()}", "--socket", str(path))
    with log_file.open("wb") as log:
        process = await asyncio.create_subprocess_exec(*before, *FLIGHTD, *where, stdout=log, stderr=log)
    async with running(Child(process, log_file, path)) as child:
        await answers(child)
        process.send_signal(signal.SIGHUP)
        if under_nohup:
            await answers(child)
            assert "signal" not in [event["event"] for event in child.events()]
        else:
            assert await asyncio.wait_for(process.wait(), 60.0) == 0
            assert child.events()[-1]["event"] == "stopped"
