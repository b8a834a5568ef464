"""Observer of the acceleration that the model does not know: wind, payload, a standing error of attitude.

A second-order Luenberger observer of velocity and disturbance with both poles at the bandwidth, discretized exactly.
Its input is the acceleration that the thrust command gives after the vehicle's delay, with the attitude that was
measured; saturation of the command is thereby known to it and nothing winds up.
"""

from dataclasses import dataclass
from math import exp

from daemon.frames import clamp
from daemon.messages import ZERO3, Vec3

STEP_MAX_S = 0.1  # a longer gap between samples starts the observer's velocity anew


@dataclass(frozen=True, slots=True, eq=False)
class Observer:
    """``disturbance_ned_m_s2`` acts besides gravity, thrust and modelled drag; the other fields are its memory."""

    time_s: float = float("-inf")
    velocity_ned_m_s: Vec3 = ZERO3
    disturbance_ned_m_s2: Vec3 = ZERO3
    model_ned_m_s2: Vec3 = ZERO3


START = Observer()


def update(
    observer: Observer,
    time_s: float,
    velocity_ned_m_s: Vec3,
    model_ned_m_s2: Vec3,
    *,
    bandwidth_rad_s: float,
    maximum_m_s2: float,
) -> Observer:
    """Take one velocity sample; ``model`` is the modelled acceleration at its time. Bandwidth 0 keeps it at zero.

    A sample that is not newer changes nothing. The disturbance is bounded by norm horizontally, and vertically.
    """
    if bandwidth_rad_s <= 0.0:
        return Observer(time_s, velocity_ned_m_s, ZERO3, model_ned_m_s2)
    dt_s = time_s - observer.time_s
    if dt_s <= 0.0:
        return observer
    if dt_s > STEP_MAX_S:
        return Observer(time_s, velocity_ned_m_s, observer.disturbance_ned_m_s2, model_ned_m_s2)
    pole = exp(-bandwidth_rad_s * dt_s)
    gain_v, gain_d = 1.0 - pole * pole, (1.0 - pole) ** 2 / dt_s
    velocity, disturbance = [0.0] * 3, [0.0] * 3
    for i in range(3):
        model = 0.5 * (model_ned_m_s2[i] + observer.model_ned_m_s2[i])
        ahead = observer.velocity_ned_m_s[i] + (model + observer.disturbance_ned_m_s2[i]) * dt_s
        error = velocity_ned_m_s[i] - ahead
        velocity[i] = ahead + gain_v * error
        disturbance[i] = observer.disturbance_ned_m_s2[i] + gain_d * error
    bounded = bound((disturbance[0], disturbance[1], disturbance[2]), maximum_m_s2)
    return Observer(time_s, (velocity[0], velocity[1], velocity[2]), bounded, model_ned_m_s2)


def bound(disturbance_ned_m_s2: Vec3, maximum_m_s2: float) -> Vec3:
    """The disturbance within its bound: horizontally by norm, and vertically."""
    x, y, z = disturbance_ned_m_s2
    horizontal = (x * x + y * y) ** 0.5
    part = maximum_m_s2 / horizontal if horizontal > maximum_m_s2 else 1.0
    return (x * part, y * part, clamp(z, -maximum_m_s2, maximum_m_s2))
