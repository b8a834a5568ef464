"""Online estimate of the drag that nobody configured: the part of the disturbance that turns with the velocity.

The disturbance holds what the modelled drag leaves of the true one, -(d - d_modelled) v, beside wind and payload. A
steady wind is what stays while the velocity turns, so a high-pass takes it away. The rest is weighed with the velocity
of the *reference* (an instrumental variable; Soderstrom and Stoica 1983): gusts and errors of the estimate move the
measured velocity and the disturbance together, which would look like drag; the reference knows nothing of them. Without
a moving reference nothing is learned.
"""

from math import hypot

from daemon.frames import clamp, rotate_about_down
from daemon.messages import ZERO3, Reset, Vec3
from daemon.values import value

_WIND_S = 3.0  # a disturbance that stays for longer is wind
_BEGIN_M2_S = 6.0  # information taken for granted of no configured drag: little, the first turns decide
_FULL_M2_S = 600.0  # of a configured one, and where the estimate forgets: 24 s at 5 m/s
_RATE_MAX_1_S2 = 0.5  # no quicker change is drag
_APART_M_S = 1.0  # a vehicle that follows its reference worse is in doubt
_APART_SHARE = 0.3  # the same, of the reference's speed

Horizontal = tuple[float, float]


@value
class Drag:
    """``learned_1_s`` adds to the configured drag along each axis; the other fields are memory (NED, horizontal).

    ``information_m2_s``: squared reference velocity without its steady part, summed over the time. ``beside_1_s``: the
    configured drag that it was learned beside; another one starts it anew.
    """

    learned_1_s: float = 0.0
    information_m2_s: float = _BEGIN_M2_S
    steady_velocity_ne_m_s: Horizontal | None = None
    steady_disturbance_ne_m_s2: Horizontal = (0.0, 0.0)
    beside_1_s: Vec3 = ZERO3


UNKNOWN = Drag()


def learn(
    drag: Drag,
    reference_velocity_ned_m_s: Vec3,
    velocity_ned_m_s: Vec3,
    disturbance_ned_m_s2: Vec3,
    dt_s: float,
    *,
    configured_1_s: Vec3,
    maximum_1_s: float,
) -> Drag:
    """The estimate after ``dt_s`` with this disturbance, which the drag learned so far is no part of.

    Normalized gradient whose gain falls with the information as that of recursive least squares. The sum of configured
    and learned drag stays within 0 and ``maximum_1_s``; a configured drag changes slowly. Frozen while the vehicle does
    not follow the reference.
    """
    vx, vy, _ = reference_velocity_ned_m_s
    dx, dy, _ = disturbance_ned_m_s2
    if drag.beside_1_s != configured_1_s:
        drag = Drag(beside_1_s=configured_1_s)
    if drag.steady_velocity_ne_m_s is None:
        return Drag(drag.learned_1_s, drag.information_m2_s, (vx, vy), (dx, dy), configured_1_s)
    (sx, sy), (cx, cy) = drag.steady_velocity_ne_m_s, drag.steady_disturbance_ne_m_s2
    zx, zy, ux, uy = vx - sx, vy - sy, dx - cx, dy - cy
    share = dt_s / (_WIND_S + dt_s)
    steady_velocity = (sx + share * zx, sy + share * zy)
    steady_disturbance = (cx + share * ux, cy + share * uy)
    learned, information = drag.learned_1_s, drag.information_m2_s
    apart_m_s = hypot(vx - velocity_ned_m_s[0], vy - velocity_ned_m_s[1])
    if apart_m_s <= _APART_M_S + _APART_SHARE * hypot(vx, vy):
        known = _FULL_M2_S if any(configured_1_s) else information
        rate = clamp(-(zx * ux + zy * uy) / known, -_RATE_MAX_1_S2, _RATE_MAX_1_S2)
        low, high = min(-min(configured_1_s), 0.0), max(maximum_1_s - max(configured_1_s), 0.0)
        learned = clamp(learned + rate * dt_s, low, high)
        information = min(information + (zx * zx + zy * zy) * dt_s, _FULL_M2_S)
    return Drag(learned, information, steady_velocity, steady_disturbance, configured_1_s)


def shifted(drag: Drag, reset: Reset) -> Drag:
    """The estimate after a jump of the frame: the steady parts move with velocity and disturbance."""
    if drag.steady_velocity_ne_m_s is None:
        return drag
    (vx, vy), (dx, dy) = drag.steady_velocity_ne_m_s, drag.steady_disturbance_ne_m_s2
    dx, dy, _ = rotate_about_down((dx, dy, 0.0), reset.yaw_rad)
    velocity = (vx + reset.velocity_ned_m_s[0], vy + reset.velocity_ned_m_s[1])
    return Drag(drag.learned_1_s, drag.information_m2_s, velocity, (dx, dy), drag.beside_1_s)


def paused(drag: Drag) -> Drag:
    """The estimate without its memory of the last seconds."""
    return Drag(drag.learned_1_s, drag.information_m2_s, beside_1_s=drag.beside_1_s)


def total(drag: Drag, configured_1_s: Vec3) -> Vec3:
    """Configured and learned drag along the body axes, 1/s."""
    more = drag.learned_1_s
    return (configured_1_s[0] + more, configured_1_s[1] + more, configured_1_s[2] + more)
