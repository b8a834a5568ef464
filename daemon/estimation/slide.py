"""Jumps and slides of the estimate that no counter announces.

A jump beyond the gate is refused, and coasted over; when the refused samples agree with each other, it is the estimate
that moved, and it is taken as a reset (a fast slide). Below the gate the position is followed, its excess over the
prediction at a bounded rate (a slow slide); when the excess outgrows what that rate can take, it is a fast slide too.
Velocity and heading below the gate pass as they are: the laws' own limits bound what they can do.
"""

from dataclasses import dataclass
from math import hypot

from daemon.estimation.gate import Sample
from daemon.estimation.reset_tracker import Innovation
from daemon.frames import norm
from daemon.messages import ZERO3, Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class SlideParameters:
    """Bounds of what passes without a counter.

    ``jump_*``: gate on the innovation, five times the noise of recorded flights; widened with the time between the
    samples by ``acceleration_unknown_m_s2`` and ``yaw_acceleration_unknown_rad_s2``. ``agreeing_samples``: refused
    samples that must follow from each other. ``follow_m_s``: rate at which an excess of position is let through;
    recorded flights stay below it. ``excess_max_m``: an excess beyond it is a reset.
    """

    jump_position_m: float = 0.2
    jump_velocity_m_s: float = 0.6
    jump_yaw_rad: float = 0.087
    acceleration_unknown_m_s2: float = 20.0
    yaw_acceleration_unknown_rad_s2: float = 10.0
    agreeing_samples: int = 3
    follow_m_s: float = 1.5
    excess_max_m: float = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class SlideState:
    """``excess_ned_m``: position not yet let through. ``refused``: newest refused sample, ``agreeing`` its run."""

    excess_ned_m: Vec3 = ZERO3
    refused: Sample | None = None
    agreeing: int = 0


SETTLED = SlideState()


def jumps(found: Innovation, *, parameters: SlideParameters) -> bool:
    """True when the innovation cannot be motion."""
    dt = found.dt_s
    unknown = parameters.acceleration_unknown_m_s2 * dt
    return (
        norm(found.position_ned_m) > parameters.jump_position_m + 0.5 * unknown * dt
        or norm(found.velocity_ned_m_s) > parameters.jump_velocity_m_s + unknown
        or abs(found.yaw_rad) > parameters.jump_yaw_rad + 0.5 * parameters.yaw_acceleration_unknown_rad_s2 * dt * dt
    )


def followed(state: SlideState, found: Innovation, *, parameters: SlideParameters) -> SlideState:
    """Take up an accepted sample's excess of position and let through what the rate allows."""
    (ex, ey, ez), (ix, iy, iz) = state.excess_ned_m, found.position_ned_m
    x, y, z = ex + ix, ey + iy, ez + iz
    length, allowed = hypot(x, y, z), parameters.follow_m_s * found.dt_s
    if length <= allowed:
        return SETTLED
    factor = 1.0 - allowed / length
    return SlideState((x * factor, y * factor, z * factor))
