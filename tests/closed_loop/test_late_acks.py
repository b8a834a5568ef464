"""On a slow link the second ack of a mode request comes after a later request: that one is not refused by it."""

import asyncio
import contextlib
from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.autopilot.port import LinkError
from daemon.loops.turns import NotPossibleError
from daemon.messages import FlightMode
from daemon.safety.supervisor import State
from daemon.sim.faults import ModesRefused

Sent = tuple[str, dict[str, Any]]


def delay_second_acks(flight: Flight, by_s: float) -> None:
    """From now on every other ack of DO_SET_MODE, which is the second of its request, is late."""
    take, held, seen = flight.px4.take_outgoing, list[tuple[float, Sent]](), 0

    def taken() -> list[Sent]:
        nonlocal seen
        messages: list[Sent] = []
        for name, fields in take():
            is_ack = name == "COMMAND_ACK" and fields["command"] == 176
            seen += is_ack
            if is_ack and seen % 2 == 0:
                held.append((flight.now_s + by_s, (name, fields)))
            else:
                messages.append((name, fields))
        while held and held[0][0] <= flight.now_s:
            messages.append(held.pop(0)[1])
        return messages

    flight.px4.take_outgoing = taken  # type: ignore[method-assign]


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.06, 0.2])
def test_an_offboard_that_is_refused_late_does_not_make_a_hold_into_a_landing(late_s: float) -> None:
    async def scenario(flight: Flight) -> None:
        await flight.airborne(engage=False)
        flight.px4.inject(ModesRefused(modes=("offboard",)))
        delay_second_acks(flight, late_s)
        engaging = asyncio.ensure_future(flight.vehicle.commander.engage())
        await flight.until(lambda: FlightMode.OFFBOARD in [mode for _, mode in flight.asked])
        await flight.vehicle.commander.hold()
        with contextlib.suppress(NotPossibleError, LinkError):
            await engaging
        assert (flight.state, flight.px4.mode) == (State.READY, FlightMode.HOLD)
        assert FlightMode.LAND not in [mode for _, mode in flight.asked]

    fly(scenario)
