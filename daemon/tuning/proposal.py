"""From the measured airframe to gains, the margins that they have, and the file that `flightd run` takes."""

from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Any

import yaml

from daemon.control.identification import Margins, margins
from daemon.control.parameters import ControlParameters, from_airframe
from daemon.messages import Vec3
from daemon.parameters import control_parameters
from daemon.settings import Config
from daemon.tuning.measurement import Measured, Thrust

PHASE_MIN_RAD = radians(15.0)  # with all the dead time that the prediction does not cover
_SLOWER = 1.05
_SLOWEST = 4.0
_LAG_ERROR_MAX = 0.2  # relative, of dead time and lag of thrust
_CURVE_MIN = 0.25  # a smaller share of the square cannot be told from none
_GAINS = ("position_gain_1_s2", "velocity_gain_1_s", "attitude_time_constant_s", "disturbance_bandwidth_rad_s")
_VEHICLE = ("hover_thrust", "thrust_curve", "thrust_lag_s", "rate_lag_s")


@dataclass(frozen=True, slots=True)
class Proposal:
    """Parameters of the control law. ``margins``: with the dead time predicted, and with what is left of it.

    ``slowed``: by how much the gains are slower than the lag of the rate loop alone would have them.
    """

    parameters: ControlParameters
    margins: Margins
    margins_unpredicted: Margins
    unpredicted_s: float
    slowed: float


def propose(measured: Measured, config: Config) -> Proposal:
    """Gains for a measured airframe; what is not measured stays as configured. Raises ``ValueError``.

    Where the rate loop's dead time leaves too little phase, the gains are those of a slower rate loop.
    """
    tilt_lag_s = 0.5 * (measured.roll.lag_s.value + measured.pitch.lag_s.value)
    dead_time_s = 0.5 * (measured.roll.dead_time_s.value + measured.pitch.dead_time_s.value)
    unpredicted_s = max(0.0, dead_time_s - config.loops.command_latency_s)
    slowed = 1.0
    while True:
        gains = from_airframe(
            measured.thrust.hover_thrust.value, slowed * tilt_lag_s, yaw_rate_lag_s=measured.yaw.lag_s.value
        )
        found = margins(gains, rate_lag_s=tilt_lag_s, unpredicted_delay_s=unpredicted_s)
        if found.phase_rad >= PHASE_MIN_RAD:
            break
        slowed *= _SLOWER
        if slowed > _SLOWEST:
            raise ValueError(
                f"a dead time of {1e3 * dead_time_s:.0f} ms is too long for a lag of {1e3 * tilt_lag_s:.0f} ms"
            )
    configured = control_parameters(config, None)
    parameters = replace(
        configured,
        **{name: getattr(gains, name) for name in _GAINS},
        hover_thrust=measured.thrust.hover_thrust.value,
        thrust_curve=thrust_curve(measured.thrust.slope, measured.thrust.hover_thrust.value),
        thrust_lag_s=_thrust_lag_s(measured.thrust, configured.thrust_lag_s),
        rate_lag_s=(measured.roll.lag_s.value, measured.pitch.lag_s.value, measured.yaw.lag_s.value),
    )
    return Proposal(
        parameters=parameters,
        margins=margins(parameters, rate_lag_s=tilt_lag_s),
        margins_unpredicted=found,
        unpredicted_s=unpredicted_s,
        slowed=slowed,
    )


def _thrust_lag_s(thrust: Thrust, configured_s: float) -> float:
    """The measured lag where it is sharp; over a noisy estimate of the velocity it often is not."""
    sharp = thrust.total_s.error <= _LAG_ERROR_MAX * thrust.total_s.value
    return thrust.lag_s.value if sharp else configured_s


def thrust_curve(slope: float, hover_thrust: float) -> float:
    """Share c of the square in force = c u^2 + (1 - c) u, from the relative slope at hover; 0 when it is small.

    slope = u F'(u) / F(u), so c = (slope - 1) / (2 u - 1 + slope (1 - u)).
    """
    below = 2.0 * hover_thrust - 1.0 + slope * (1.0 - hover_thrust)
    share = (slope - 1.0) / below if below > 0.0 else 1.0
    return 0.0 if share < _CURVE_MIN else min(share, 1.0)


def overrides(proposal: Proposal) -> dict[str, Any]:
    """The proposal as a configuration file has it: only what was measured or follows from it."""
    values = {name: _rounded(getattr(proposal.parameters, name)) for name in _VEHICLE + _GAINS}
    return {"control": values}


def as_yaml(proposal: Proposal, airframe: str) -> str:
    """A file for ``flightd run --config``."""
    m = proposal.margins_unpredicted
    text = yaml.safe_dump(overrides(proposal), sort_keys=False, default_flow_style=None, width=120)
    return (
        f"# {airframe}, as measured by `flightd tune`. Phase margin {degrees(m.phase_rad):.0f} deg, "
        f"gain margin {m.gain:.1f}, delay margin {1e3 * m.delay_s:.0f} ms.\n"
        f"# Set the autopilot's MPC_THR_HOVER to the same hover_thrust: its own modes fly with that.\n{text}"
    )


def _rounded(value: float | Vec3) -> float | list[float]:
    return [round(v, 4) for v in value] if isinstance(value, tuple) else round(value, 4)
