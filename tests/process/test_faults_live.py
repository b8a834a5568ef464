"""The rows of the fault matrix about the process, its machine and the link: the whole daemon over real MAVSDK."""

from pathlib import Path

import pytest
from support.air import air
from support.fault_cases_live import CASES
from support.fault_live import LiveCase, live_differences, strike_live
from support.processes import daemon_on


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
async def test_a_fault_of_the_process_is_answered(case: LiveCase, tmp_path: Path) -> None:
    assert live_differences(case, await strike_live(case, tmp_path)) == []


async def test_a_daemon_that_flies_nothing_stops_at_once_and_sends_nothing(tmp_path: Path) -> None:
    async with air() as seen, daemon_on(tmp_path, seen.connection) as child:
        assert await child.stop() == 0
        assert seen.sent == []
