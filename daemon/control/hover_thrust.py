"""Online estimate of the thrust command that hovers.

Thrust gain and vertical disturbance cannot both be seen from height alone. The split: the observer takes every quick
change as disturbance; what stays, near level, is moved into the hover thrust with a slow time constant. The move
leaves the command as it is, so nothing bumps.
"""

from daemon.frames import clamp


def learn(
    hover_thrust: float,
    disturbance_down_m_s2: float,
    dt_s: float,
    *,
    start: float,
    relative_range: float,
    time_constant_s: float,
    gravity_m_s2: float,
) -> tuple[float, float]:
    """New hover thrust and what is left of the downward disturbance (m/s2) after one step.

    To hover against a disturbance d takes thrust h (1 + d / g): a share of d becomes hover thrust, within
    ``start`` (1 +- ``relative_range``).
    """
    share = min(dt_s / time_constant_s, 1.0)
    low, high = start * (1.0 - relative_range), start * (1.0 + relative_range)
    pull = 1.0 + disturbance_down_m_s2 / gravity_m_s2
    kept = 1.0 + (1.0 - share) * disturbance_down_m_s2 / gravity_m_s2
    if kept < 0.1:
        return hover_thrust, disturbance_down_m_s2
    learned = clamp(hover_thrust * pull / kept, low, high)
    return learned, (hover_thrust * pull / learned - 1.0) * gravity_m_s2
