"""How far the estimate can be trusted: numbers for the supervisor's conditions."""

from dataclasses import dataclass
from math import exp

from daemon.estimation.reset_tracker import Innovation
from daemon.frames import norm
from daemon.values import value


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityParameters:
    """What is taken as good.

    ``innovation_*``: mean innovation that counts as 1; recorded flights have 0.004 m and 0.03 m/s.
    ``smoothing_s``: time constant of the means. ``growth_max_m2_s``: growth of the variance that foretells a loss (PX4
    says 0.04 in flight, 0.3 three seconds after GPS was lost, 0.9 after five).
    """

    growth_max_m2_s: float = 0.05
    innovation_position_m: float = 0.03
    innovation_velocity_m_s: float = 0.2
    smoothing_s: float = 0.5


@value
class Quality:
    """``innovation``: smoothed, 1 is the bound. ``variance_growth_m2_s``: smoothed, ``variance_grows`` by its bound."""

    innovation: float = 0.0
    variance_m2: float = 0.0
    variance_growth_m2_s: float = 0.0
    variance_grows: bool = False


def judged(before: Quality, variance_m2: float, found: Innovation, *, parameters: QualityParameters) -> Quality:
    """The quality after an accepted sample that is not a reset."""
    share = 1.0 - exp(-found.dt_s / parameters.smoothing_s)
    ratio = max(
        norm(found.position_ned_m) / parameters.innovation_position_m,
        norm(found.velocity_ned_m_s) / parameters.innovation_velocity_m_s,
    )
    innovation = before.innovation + (ratio - before.innovation) * share
    slope = (variance_m2 - before.variance_m2) / found.dt_s
    if slope - slope != 0.0:  # from or to an unknown variance there is no slope
        slope = 0.0
    growth = before.variance_growth_m2_s + (slope - before.variance_growth_m2_s) * share
    return Quality(innovation, variance_m2, growth, growth > parameters.growth_max_m2_s)


def restarted(variance_m2: float) -> Quality:
    """The quality of a first sample, or of one after a reset: no innovation is known."""
    return Quality(variance_m2=variance_m2)
