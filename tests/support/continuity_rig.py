"""Samples of a flight put through the estimator, with jumps added, and what it tells of them."""

from dataclasses import replace

from daemon import frames
from daemon.estimation import estimator
from daemon.estimation.estimator import EstimatorParameters
from daemon.messages import ZERO3

PARAMETERS = EstimatorParameters()
BEGIN_S, SPACING_S = 10.0, 0.01


def fly(messages, acceleration=ZERO3):
    state = estimator.initial(PARAMETERS)
    estimates = []
    for message in messages:
        state, estimate = estimator.step(state, message, None, acceleration, message.arrival_s, parameters=PARAMETERS)
        estimates.append(estimate)
    return estimates


def moved(message, position=ZERO3, velocity=ZERO3, yaw_rad=0.0, steps=0):
    return replace(
        message,
        position_m=frames.add(message.position_m, position),
        velocity_m_s=frames.add(message.velocity_m_s, velocity),
        attitude_wb=frames.multiply(frames.from_yaw(yaw_rad), message.attitude_wb),
        reset_counter=(message.reset_counter + steps) % 256,
    )


def resets(estimates):
    return [(i, estimate.reset) for i, estimate in enumerate(estimates) if estimate.reset]


def events(estimates):
    return [(i, event) for i, estimate in enumerate(estimates) for event in estimate.events]
