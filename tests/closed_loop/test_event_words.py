"""What subscribers of the topic ``events`` read of the estimate while the daemon flies in virtual time."""

import json
from typing import Any

import pytest
from support.flight import Flight, fly

from daemon.goals.results import EventTelemetry
from daemon.journal import Journal
from daemon.reports import Reports
from daemon.sim.faults import ClockStep, EkfReset, Fault, StoppedTelemetry
from daemon.telemetry import Telemetry


class Subscriber:
    def __init__(self) -> None:
        self.events: list[EventTelemetry] = []

    def send(self, line: bytes, *, essential: bool) -> None:
        message: dict[str, Any] = json.loads(line)
        if message["method"] == "telemetry.events":
            self.events.append(message["params"])


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        (ClockStep(step_s=5.0), "clock_stepped", "stamps jumped"),
        (StoppedTelemetry(duration_s=1.0), "regained", "back after a gap"),
        (EkfReset(kind="position_ne", size_m=0.0), "reset", "nothing moved"),
        (EkfReset(kind="position_ne", size_m=3.0), "reset", "position_ne"),
    ],
)
def test_what_the_estimate_tells_is_a_sentence(fault: Fault, code: str, words: str) -> None:
    async def scenario(flight: Flight) -> list[EventTelemetry]:
        Telemetry(flight.vehicle, Reports(flight.vehicle), flight.hub, Journal(flight.hub, None))
        subscriber = Subscriber()
        await flight.airborne(5.0)
        flight.hub.subscribe(subscriber, ["events"], 10.0)
        flight.px4.inject(fault)
        await flight.until(lambda: any(event["code"] == code for event in subscriber.events))
        return subscriber.events

    text = next(event["text"] for event in fly(scenario) if event["code"] == code)
    assert words in text
