"""How much later than modelled the vehicle follows commanded body rates: by a delay that nobody configured.

A model of the rate loop runs beside the vehicle: its lag after the moment at which a command should act, then a
second lag. A vehicle that is late by t has the model's rates minus t times their derivative, to first order: t by least
squares over the last turns. Only the guard of the tilt limit acts on it, by more care.
"""

from math import exp

from daemon.frames import clamp
from daemon.values import value

_SECOND_LAG_S = 0.03  # rotors and gyro filter; without it the model jumps off at a step and any vehicle looks late
_BEGIN_RAD2_S3 = 1.0  # information taken for granted of a vehicle in time
_FULL_RAD2_S3 = 15.0  # beyond it the estimate forgets: a step of 35 degrees gives four times as much
_LATE_MAX_S = 0.1

Tilting = tuple[float, float]


@value
class Lateness:
    """``late_s`` is the estimate, negative for a vehicle that is quicker than the model; the rest is memory.

    ``information_rad2_s3``: squared angular acceleration of the model, summed over the time. ``lagged_rad_s``: roll and
    pitch rate of the model after its first lag, ``rates_rad_s`` after both.
    """

    late_s: float = 0.0
    information_rad2_s3: float = _BEGIN_RAD2_S3
    lagged_rad_s: Tilting = (0.0, 0.0)
    rates_rad_s: Tilting = (0.0, 0.0)


IN_TIME = Lateness()


def learn(
    lateness: Lateness, commanded_rad_s: Tilting, measured_rad_s: Tilting, dt_s: float, *, lag_s: float
) -> Lateness:
    """The estimate after ``dt_s`` in which a command should have acted; roll and pitch rates, measured at its end.

    Within 0.1 s either way.
    """
    kept = exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0
    (lx, ly), (x, y) = lateness.lagged_rad_s, lateness.rates_rad_s
    (cx, cy), (mx, my) = commanded_rad_s, measured_rad_s
    lx, ly = cx + (lx - cx) * kept, cy + (ly - cy) * kept
    share = 1.0 - exp(-dt_s / _SECOND_LAG_S)
    dx, dy = share * (lx - x), share * (ly - y)
    x, y = x + dx, y + dy
    before = lateness.information_rad2_s3
    information = before + (dx * dx + dy * dy) / dt_s
    late_s = (lateness.late_s * before + (x - mx) * dx + (y - my) * dy) / information
    return Lateness(clamp(late_s, -_LATE_MAX_S, _LATE_MAX_S), min(information, _FULL_RAD2_S3), (lx, ly), (x, y))
