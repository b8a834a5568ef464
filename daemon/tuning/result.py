"""What was found, for people and for scripts."""

from math import degrees
from typing import Any

from daemon.control.identification import Margins
from daemon.tuning.measurement import Measured, Quantity, RateLoop, Thrust
from daemon.tuning.proposal import Proposal, overrides


def lines(measured: Measured, proposal: Proposal) -> list[str]:
    """The result as a table for people."""
    found = ["          dead time     lag           sum           gain   unexplained"]
    for name, loop in (("roll", measured.roll), ("pitch", measured.pitch), ("yaw", measured.yaw)):
        found.append(
            f"{name:<8}  {_ms(loop.dead_time_s)}  {_ms(loop.lag_s)}  {_ms(loop.total_s)}  "
            f"{loop.gain.value:5.2f}  {loop.unexplained:6.1%}"
        )
    thrust, p = measured.thrust, proposal.parameters
    found.append(
        f"thrust    hovers at {thrust.hover_thrust.value:.4f} ± {thrust.hover_thrust.error:.4f}, "
        f"dead time and lag {_ms(thrust.total_s).strip()}, {thrust.full_thrust_m_s2.value:.1f} m/s² at full thrust"
    )
    found.append(f"          ODOMETRY is {1e3 * measured.age_s:.0f} ms old on arrival")
    found.append(f"gains     position {_three(p.position_gain_1_s2)} 1/s², velocity {_three(p.velocity_gain_1_s)} 1/s")
    found.append(f"          attitude {_three(p.attitude_time_constant_s)} s")
    if proposal.slowed > 1.0:
        found.append(f"          slower by {proposal.slowed:.2f}, for the dead time is long")
    found.append(f"margins   {_margins(proposal.margins)}")
    found.append(f"          {_margins(proposal.margins_unpredicted)}, {1e3 * proposal.unpredicted_s:.0f} ms later")
    return found


def as_dict(measured: Measured, proposal: Proposal) -> dict[str, Any]:
    """The result as JSON has it; SI, margins in radians, infinite margins None."""
    return {
        "roll": _rate_loop(measured.roll),
        "pitch": _rate_loop(measured.pitch),
        "yaw": _rate_loop(measured.yaw),
        "thrust": _thrust(measured.thrust),
        "odometry_age_s": round(measured.age_s, 5),
        "margins": _finite(proposal.margins),
        "margins_unpredicted": _finite(proposal.margins_unpredicted),
        "unpredicted_s": round(proposal.unpredicted_s, 5),
        "slowed": round(proposal.slowed, 3),
        "config": overrides(proposal),
    }


def _rate_loop(loop: RateLoop) -> dict[str, Any]:
    named = {"sum_s": loop.total_s, "dead_time_s": loop.dead_time_s, "lag_s": loop.lag_s, "gain": loop.gain}
    return _quantities(named) | {"unexplained": round(loop.unexplained, 4)}


def _thrust(thrust: Thrust) -> dict[str, Any]:
    named = {
        "sum_s": thrust.total_s,
        "lag_s": thrust.lag_s,
        "hover_thrust": thrust.hover_thrust,
        "full_thrust_m_s2": thrust.full_thrust_m_s2,
        "drag_1_s": thrust.drag_1_s,
    }
    return _quantities(named) | {"slope": round(thrust.slope, 4), "unexplained": round(thrust.unexplained, 4)}


def _quantities(named: dict[str, Quantity]) -> dict[str, Any]:
    return {name: {"value": round(q.value, 5), "error": round(q.error, 5)} for name, q in named.items()}


def _finite(m: Margins) -> dict[str, float | None]:
    values = {"phase_rad": m.phase_rad, "gain": m.gain, "delay_s": m.delay_s, "crossover_rad_s": m.crossover_rad_s}
    return {name: round(value, 5) if value < float("inf") else None for name, value in values.items()}


def _margins(m: Margins) -> str:
    gain = f"gain {m.gain:.1f}" if m.gain < float("inf") else "any gain"
    return (
        f"phase {degrees(m.phase_rad):.0f} deg, {gain}, delay {1e3 * m.delay_s:.0f} ms at {m.crossover_rad_s:.1f} rad/s"
    )


def _ms(q: Quantity) -> str:
    return f"{1e3 * q.value:4.0f} ± {1e3 * q.error:3.0f} ms"


def _three(values: tuple[float, float, float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)
