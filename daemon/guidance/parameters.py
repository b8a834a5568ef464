"""Settings of guidance that are not limits of motion."""

from dataclasses import dataclass
from enum import Enum


class Profile(Enum):
    """How a reference moves to a waypoint."""

    REFERENCE_FILTER = "reference_filter"
    JERK_LIMITED = "jerk_limited"


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidanceParameters:
    """How references are made; frequencies in rad/s. The defaults are those of the configuration.

    ``deviation_max_m``: a goal is given up when the vehicle stays farther from its reference.
    """

    profile: Profile = Profile.JERK_LIMITED
    omega_rad_s: float = 1.0  # natural frequency of the position's filter
    zeta: float = 1.0  # its damping, 1 or more: below 1 the reference may overshoot
    omega_yaw_rad_s: float = 1.0  # natural frequency of the heading's filter
    omega_stream_rad_s: float = (
        5.0  # of the filters that follow a stream, heading too: they lag its jerk by jerk / omega^3
    )
    deviation_max_m: float = 4.0
    velocity_yaw: bool = False  # head along the velocity, whatever heading a goal gives
