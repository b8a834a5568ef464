"""What of the estimate's jumps and slides comes through, and how fast.

A jump beyond the gate is refused, and coasted over; when the refused samples agree with each other, it is the estimate
that moved, and it is taken as a reset (a fast slide). Below the gate the position is followed, its excess over the
prediction at a bounded rate (a slow slide); when the excess outgrows what that rate can take, it is a fast slide too.
Velocity and heading below the gate pass as they are: the laws' own limits bound what they can do.

A reset of the velocity says that the velocity before was wrong, or that the one after is: GPS will tell within a
second. A reference that took it up would set out on a way of its own, so it fades in instead (hovering on PX4, a reset
of 1 m/s moves the vehicle by less than 0.1 m; a shifted reference by 1.3 m, a plain jump by 0.3 m at 28 degrees).
"""

from dataclasses import dataclass
from math import exp, hypot

from daemon.estimation.gate import Sample
from daemon.estimation.reset_tracker import Innovation
from daemon.frames import add, clip_norm, norm, scale, subtract
from daemon.messages import ZERO3, Reset, Vec3
from daemon.values import value

_NEGLIGIBLE_M_S = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class SlideParameters:
    """Bounds of what passes without a counter.

    ``jump_*``: gate on the innovation, five times the noise of recorded flights; widened with the time between the
    samples by ``acceleration_unknown_m_s2`` and ``yaw_acceleration_unknown_rad_s2``. ``agreeing_samples``: refused
    samples that must follow from each other. ``follow_m_s``: rate at which an excess of position is let through;
    recorded flights stay below it. ``excess_max_m``: an excess beyond it is a reset.
    ``velocity_fade_s``: time constant with which a reset of the velocity comes through, up to
    ``velocity_excess_max_m_s``; what is more comes at once.
    """

    jump_position_m: float = 0.2
    jump_velocity_m_s: float = 0.6
    jump_yaw_rad: float = 0.087
    acceleration_unknown_m_s2: float = 20.0
    yaw_acceleration_unknown_rad_s2: float = 10.0
    agreeing_samples: int = 3
    follow_m_s: float = 1.5
    excess_max_m: float = 0.4
    velocity_fade_s: float = 0.6
    velocity_excess_max_m_s: float = 3.0


@value
class SlideState:
    """``excess_*``: what has not yet been let through. ``refused``: newest refused sample, ``agreeing`` its run."""

    excess_ned_m: Vec3 = ZERO3
    excess_ned_m_s: Vec3 = ZERO3
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
    """Take up an accepted sample's excess of position, let through what the rate allows, fade that of the velocity."""
    x, y, z = add(state.excess_ned_m, found.position_ned_m)
    length, allowed = hypot(x, y, z), parameters.follow_m_s * found.dt_s
    speed = state.excess_ned_m_s
    if speed is not ZERO3:
        speed = scale(speed, exp(-found.dt_s / parameters.velocity_fade_s))
        speed = speed if norm(speed) > _NEGLIGIBLE_M_S else ZERO3
    if length > allowed:
        factor = 1.0 - allowed / length
        return SlideState((x * factor, y * factor, z * factor), speed)
    return SETTLED if speed is ZERO3 else SlideState(ZERO3, speed)


def absorbed(excess_ned_m_s: Vec3, reset: Reset, *, parameters: SlideParameters) -> tuple[Vec3, Reset]:
    """The excess of velocity with that of a reset, and the reset as it comes through. The truth comes through whole."""
    if reset.truth_returned:
        return ZERO3, reset
    if reset.velocity_ned_m_s == ZERO3:
        return excess_ned_m_s, reset
    total = add(excess_ned_m_s, reset.velocity_ned_m_s)
    kept = clip_norm(total, parameters.velocity_excess_max_m_s)
    through = subtract(total, kept)
    return kept, Reset(reset.time_s, reset.kinds, reset.position_ned_m, through, reset.yaw_rad)
