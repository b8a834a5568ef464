"""The demo as a person starts it: two processes, a flight, a table, a report; and its faults in words."""

import asyncio
import json
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from support.standstill import where_it_runs

from daemon.cli.demo_children import Child, ChildError, free_udp_port
from daemon.cli.demo_flight import LEGS, Row, table
from daemon.goals.goal import Result

DEAF = "import signal, time; signal.signal(15, signal.SIG_IGN); print(flush=True); time.sleep(60)"
FLIGHTD = (sys.executable, "-m", "daemon.cli.main")


async def command(*arguments: str, limit_s: float) -> tuple[int, str, str]:
    process = await asyncio.create_subprocess_exec(
        *FLIGHTD, *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    try:
        out, err = await asyncio.wait_for(process.communicate(), limit_s)
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
            await process.wait()
    return process.returncode or 0, out.decode(), err.decode()


def children_of(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in path.read_text().split()] if path.exists() else []


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def written(file: str) -> bytes:
    return Path(file).read_bytes()


async def demo(folder: Path) -> None:
    code, out, err = await command("demo", "--json", "--out", str(folder), limit_s=190.0)
    assert code == 0, (out, err, (folder / "daemon.log").read_text()[-2000:])
    told: dict[str, Any] = json.loads(out)
    assert [goal["outcome"] for goal in told["goals"]] == ["preempted", "succeeded", "succeeded"]
    assert all(goal["final_error_m"] <= 0.3 and goal["final_error_deg"] <= 5.0 for goal in told["goals"][1:])
    assert written(told["report"]).count(b"<svg") > 5
    assert written(told["picture"]).startswith(b"\x89PNG")
    code, out, _ = await command("replay", told["record"], limit_s=60.0)
    assert (code, out.startswith("identical")) == (0, True), out


@pytest.mark.slow
async def test_the_demo_flies_its_goals_and_the_record_replays(tmp_path: Path) -> None:
    await where_it_runs(demo, tmp_path)


@pytest.mark.slow
async def test_a_demo_that_is_interrupted_leaves_no_process(tmp_path: Path) -> None:
    process = await asyncio.create_subprocess_exec(
        *FLIGHTD, "demo", "--out", str(tmp_path), stderr=asyncio.subprocess.PIPE
    )
    assert process.stderr is not None
    async with asyncio.timeout(150.0):
        while b"started" not in await process.stderr.readline():
            pass
    children = children_of(process.pid)
    assert len(children) == 2
    process.send_signal(signal.SIGINT)
    _, err = await asyncio.wait_for(process.communicate(), 60.0)
    assert process.returncode == 130, err
    assert [pid for pid in children if alive(pid)] == []


async def test_a_process_that_ends_by_itself_is_told_with_its_last_words(tmp_path: Path) -> None:
    child = await Child.start("the daemon", ["run", "--config", "/no/such/file.yaml"], tmp_path / "log")
    with pytest.raises(ChildError, match=r"the daemon ended with code 2: .*No such file"):
        await asyncio.wait_for(child.ended(), 60.0)
    await child.stop()


async def test_a_process_that_ignores_sigterm_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.cli.demo_children.STOP_S", 0.3)
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", DEAF, stdout=asyncio.subprocess.PIPE)
    assert process.stdout is not None
    await process.stdout.readline()
    await Child("it", process, tmp_path / "log").stop()
    assert await asyncio.wait_for(process.wait(), 60.0) == -signal.SIGKILL


def test_a_goal_counts_only_where_it_should_be() -> None:
    def row(outcome: str, expected: str, metres: float | None, degrees: float | None) -> bool:
        return Row("g", outcome, expected, 1.0, metres, degrees, None, None).good

    assert row("succeeded", "succeeded", 0.29, 4.9)
    assert row("preempted", "preempted", 7.0, None)
    assert not row("succeeded", "succeeded", 0.31, 1.0)
    assert not row("succeeded", "succeeded", 0.1, 5.1)
    assert not row("succeeded", "succeeded", None, None)
    assert not row("aborted", "succeeded", 0.1, 0.1)
    assert not row("succeeded", "preempted", 0.1, 0.1)


def test_the_table_has_a_row_for_each_leg() -> None:
    rows = table([Result(f"g{i}", "succeeded") for i in range(len(LEGS))], [])
    assert [row.goal for row in rows] == [leg.name for leg in LEGS]


def test_ports_are_free() -> None:
    assert 0 < free_udp_port() < 65536
