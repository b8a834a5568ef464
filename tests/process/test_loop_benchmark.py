"""The loop's benchmark flies: each client that needs nothing further, and the daemon recording for subscribers."""

import shutil
from math import isfinite

import pytest

from daemon.bench import loop, loop_report

CLIENTS = ("C, SCHED_FIFO", "synchronous plugin", "asyncio API", "pymavlink")
OURS = "flightd, recording, 5 subscribers"


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CLIENTS, OURS])
async def test_a_flight_has_figures(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name.startswith("C,") and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    monkeypatch.setattr(loop, "WARM_UP_S", 0.5)
    flights = [flight for flight in loop.programme(100.0, None) if flight.name == name]
    figures = await loop.measure(flights, 1.0, 1, lambda _text: None)
    flown = figures[name]
    assert "error" not in flown
    assert flown["setpoints"] > 10
    assert all(isfinite(value) for value in flown.values() if isinstance(value, float))
    assert 5.0 < flown["rss_mb"] < 1000.0
    assert ("stages_us" in flown) is (name == OURS)
    assert name in loop_report.table(figures)
