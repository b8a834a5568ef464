"""Thrust acceleration to PX4's normalized thrust command and back."""

from math import sqrt


def force_of(command: float, curve: float) -> float:
    """Part of full force that a command (0 to 1) gives: c u^2 + (1 - c) u, the model of PX4's THR_MDL_FAC."""
    return command * (curve * command + 1.0 - curve)


def command_of(force: float, curve: float) -> float:
    """Inverse of ``force_of`` for a force of zero and more; a negative force gives 0."""
    if force <= 0.0:
        return 0.0
    linear = 1.0 - curve
    return 2.0 * force / (linear + sqrt(linear * linear + 4.0 * curve * force))


def command_from_acceleration(
    acceleration_m_s2: float, hover_thrust: float, curve: float, gravity_m_s2: float
) -> float:
    """Command for an acceleration along the thrust axis, by the command that hovers; 0 and more, not limited above."""
    return command_of(acceleration_m_s2 / gravity_m_s2 * force_of(hover_thrust, curve), curve)


def acceleration_from_command(command: float, hover_thrust: float, curve: float, gravity_m_s2: float) -> float:
    """Acceleration along the thrust axis, m/s2, that a command gives; ``hover_thrust`` must not be zero."""
    return gravity_m_s2 * force_of(command, curve) / force_of(hover_thrust, curve)


def linear_command(acceleration_m_s2: float, gain: float, offset: float) -> float:
    """Command k a + offset, the hand-tuned line of mavros_controllers; not limited."""
    return gain * acceleration_m_s2 + offset
