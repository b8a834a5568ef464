"""Which standstills of the daemon make it forget what it was asked before."""

import pytest
from support.flight import Flight, fly

from daemon.safety.dead_man import SetpointGate


@pytest.mark.parametrize(
    ("gap_s", "heard", "forgotten"),
    [(0.29, True, False), (0.99, False, False), (1.01, False, True)],
)
def test_a_hiccup_is_not_what_nobody_waits_for_any_more(gap_s: float, heard: bool, forgotten: bool) -> None:
    """More than a second, as docs/protocol.md has it."""

    async def scenario(flight: Flight) -> None:
        await flight.until(lambda: flight.vehicle.autopilot.status.value.heard)
        forgot: list[None] = []
        flight.vehicle.forgetters.append(lambda: forgot.append(None))
        now_s = 0.0
        gate = SetpointGate(flight.vehicle.autopilot, lambda: now_s, flight.vehicle.config.safety.clock_gap_s)
        gate.gap_listeners += flight.vehicle.gate.gap_listeners
        gate.check_gap()
        now_s = gap_s
        gate.check_gap()
        assert (flight.vehicle.autopilot.status.value.heard, bool(forgot)) == (heard, forgotten)
        assert flight.vehicle.commander.standstills == forgotten

    fly(scenario)
