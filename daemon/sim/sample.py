"""What the simulated PX4 knows of one moment, and the form in which messages travel."""

from dataclasses import dataclass
from typing import Any

from daemon.messages import Vec3
from daemon.sim.estimator import Estimate
from daemon.sim.vehicle import VehicleState

Fields = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Estimate, filtered body rates and truth of one moment, as they wait to be sent."""

    stamp_us: int
    estimate: Estimate
    rates_frd_rad_s: Vec3
    truth: VehicleState
