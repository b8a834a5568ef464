"""Observer of what a model leaves unexplained: a quantity is measured, its derivative is known but for a slow part.

Two of them run in the law. Velocity with the modelled acceleration shows the disturbance: wind, payload, a standing
error of attitude. Position with the measured velocity shows the velocity's bias: PX4's estimate drifts by tenths of a
metre per second while its position does not, and the law would stand aside of the point by that.

Luenberger, second order, both poles at the bandwidth, discretized exactly.
"""

from math import exp, hypot

from daemon.frames import clamp
from daemon.messages import ZERO3, Vec3
from daemon.values import value

STEP_MAX_S = 0.1  # a longer gap between samples starts the observer's quantity anew


@value
class Observer:
    """``unexplained`` is the slow part, in units of the derivative; the other fields are memory. World: NED."""

    time_s: float = float("-inf")
    quantity: Vec3 = ZERO3
    derivative: Vec3 = ZERO3
    unexplained: Vec3 = ZERO3


START = Observer()


def update(
    observer: Observer,
    time_s: float,
    quantity: Vec3,
    derivative: Vec3,
    *,
    bandwidth_rad_s: float,
    maximum: float,
) -> Observer:
    """Take one sample: the measured quantity and its modelled derivative at ``time_s``.

    A sample that is not newer changes nothing. The unexplained part is bounded by ``maximum``, horizontally by norm
    and vertically; bandwidth 0 keeps it at zero.
    """
    dt_s = time_s - observer.time_s
    if not dt_s > 0.0:
        return observer
    if bandwidth_rad_s <= 0.0:
        return Observer(time_s, quantity, derivative)
    if dt_s > STEP_MAX_S:
        return Observer(time_s, quantity, derivative, observer.unexplained)
    pole = exp(-bandwidth_rad_s * dt_s)
    gain, gain_slow = 1.0 - pole * pole, (1.0 - pole) ** 2 / dt_s
    (q0, q1, q2), (d0, d1, d2), (u0, u1, u2) = observer.quantity, observer.derivative, observer.unexplained
    q0 += (0.5 * (d0 + derivative[0]) + u0) * dt_s
    q1 += (0.5 * (d1 + derivative[1]) + u1) * dt_s
    q2 += (0.5 * (d2 + derivative[2]) + u2) * dt_s
    e0, e1, e2 = quantity[0] - q0, quantity[1] - q1, quantity[2] - q2
    return Observer(
        time_s,
        (q0 + gain * e0, q1 + gain * e1, q2 + gain * e2),
        derivative,
        bounded((u0 + gain_slow * e0, u1 + gain_slow * e1, u2 + gain_slow * e2), maximum),
    )


def bounded(unexplained: Vec3, maximum: float) -> Vec3:
    """Within ``maximum``: horizontally by norm, and vertically."""
    x, y, z = unexplained
    horizontal = hypot(x, y)
    part = maximum / horizontal if horizontal > maximum else 1.0
    return (x * part, y * part, clamp(z, -maximum, maximum))
