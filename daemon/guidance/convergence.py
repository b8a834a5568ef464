"""When a waypoint counts as reached: a single threshold, or tolerances that have to hold for a while."""

from dataclasses import dataclass
from math import isfinite, radians

from daemon.guidance.waypoint_modes import PoseError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Reached when distance, angle and speed have stayed within these for ``dwell_s``."""

    position_m: float = 0.3
    angle_rad: float = radians(5.0)
    speed_m_s: float = 0.3
    dwell_s: float = 0.5

    def __post_init__(self) -> None:
        for name in ("position_m", "angle_rad", "speed_m_s"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name}: {getattr(self, name)} is not a positive, finite number")
        if not (isfinite(self.dwell_s) and self.dwell_s >= 0.0):
            raise ValueError(f"dwell_s: {self.dwell_s} is not zero or more")


@dataclass(frozen=True, slots=True)
class Threshold:
    """Reached as soon as the mode's combined error, metres and radians in one norm, is below ``value``."""

    value: float

    def __post_init__(self) -> None:
        if not (isfinite(self.value) and self.value > 0.0):
            raise ValueError(f"threshold: {self.value} is not a positive, finite number")


Convergence = Tolerance | Threshold


def converged(
    criterion: Convergence, since_s: float | None, error: PoseError, speed_m_s: float, now_s: float
) -> tuple[float | None, bool]:
    """Since when the criterion has held (None: it does not), and whether the waypoint is reached.

    State in, state out: ``since_s`` is what the last call returned, None at first. An error that is not a number is no
    convergence.
    """
    if isinstance(criterion, Threshold):
        reached = error.combined < criterion.value
        return (now_s if reached else None), reached
    within = (
        error.position_m < criterion.position_m
        and error.angle_rad < criterion.angle_rad
        and speed_m_s < criterion.speed_m_s
    )
    if not within:
        return None, False
    since_s = now_s if since_s is None else since_s
    return since_s, now_s - since_s >= criterion.dwell_s
