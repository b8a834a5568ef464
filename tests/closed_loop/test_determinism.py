"""The whole daemon on the simulated PX4 in virtual time: the same seed is the same flight, to the last bit."""

import pickle

from support.flight import Flight, fly


def flown(seed: int) -> bytes:
    async def scenario(flight: Flight) -> bytes:
        await flight.airborne(3.0)
        await flight.result(await flight.goto(2.0, 0.0, -4.0))
        return pickle.dumps((flight.truths, flight.sent, flight.px4.take_outgoing()))

    return fly(scenario, seed=seed, noise=True)


def test_two_flights_with_a_seed_are_the_same_bytes_and_another_seed_is_another_flight() -> None:
    assert flown(4) == flown(4)
    assert flown(4) != flown(5)
