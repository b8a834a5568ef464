"""The collector over a flight: it works after control ticks only, what is alive stays bounded, status.get shows it."""

import gc
from typing import Any

from support.flight import CALLER, Flight, fly

from daemon.goals.methods import NoParams
from daemon.pipeline import Inputs, Record

MOST_OBJECTS = 2000  # thirty goals leave 550 behind: the book, the newest plan


def test_a_flight_is_collected_after_its_ticks_and_leaves_nothing_behind() -> None:
    elsewhere: list[Any] = []

    def on_collection(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            elsewhere.append(info)

    async def scenario(flight: Flight) -> None:
        await flight.airborne()
        garbage, control = flight.vehicle.garbage, flight.vehicle.control

        def on_tick(inputs: Inputs, record: Record) -> None:
            flight.records[:-1], flight.truths[:], flight.sent[:] = [], [], []
            seen = len(elsewhere)
            garbage.on_tick(inputs, record)
            del elsewhere[seen:]

        garbage.start()
        gc.callbacks.append(on_collection)
        control.listeners.append(on_tick)
        try:
            for north_m in range(30):
                await flight.goto(float(north_m % 5), 0.0, -5.0)
                since_s = flight.now_s
                await flight.until(lambda since_s=since_s: flight.now_s - since_s > 1.0)
            assert elsewhere == []
            assert len(gc.get_objects()) < MOST_OBJECTS
            report = (await flight.service.status_get(NoParams(), CALLER))["loops"]["garbage"]
            assert report["collections"] == garbage.report.collections >= 25
            assert report["longest_ms"] > 0.0
        finally:
            gc.callbacks.remove(on_collection)
            garbage.stop()

    fly(scenario)
